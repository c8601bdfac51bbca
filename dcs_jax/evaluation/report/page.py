"""One page of all results: a single HTML file that opens without a network.

Needs matplotlib and jinja2 (the extra `report`). Everything on the page comes from a `Summary`.
"""

import math
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import jinja2
import numpy as np
from markupsafe import Markup

from dcs_jax.evaluation.metrics import PRECISION_AT
from dcs_jax.evaluation.report import plots
from dcs_jax.evaluation.report.strips import Picture, film_strip
from dcs_jax.evaluation.results import PICTURES
from dcs_jax.evaluation.statistics import FEWEST_SEEDS, Spread, ranks
from dcs_jax.evaluation.summary import Summary, mean_published, published_columns
from dcs_jax.io.files import atomic

SIGNIFICANT = 0.05
OVERVIEW_SEQUENCES = 12  # more would not fit into one picture


class Cell(NamedTuple):
    """A cell of a table: its text, a smaller note, the value to sort by, and the rank."""

    text: str
    note: str
    value: float
    rank: int


class Metric(NamedTuple):
    """A column of the table of settings.

    field: name of a field of `Scores`.
    least_is_best: whether the least value is the best one.
    """

    field: str
    heading: str
    digits: int
    least_is_best: bool


METRICS = (
    Metric("centre_error", "centre error, px", 1, True),
    Metric("success_rate", "success rate", 3, False),
    Metric("auc", "success AUC", 3, False),
    Metric("precision", "P@20", 3, False),
    Metric("normalised_precision", "normalised precision", 3, False),
    Metric("failures", "failures a run", 2, True),
)


class Column(NamedTuple):
    """A column of the tables by sequence.

    name: setting of ours, or published tracker.
    source: of a published tracker; otherwise "".
    colour: of a setting of ours; otherwise "".
    """

    name: str
    source: str
    colour: str


class Table(NamedTuple):
    """A table by sequence.

    rows: (name of the sequence, cells).
    mean: cells of the last row.
    """

    title: str
    columns: list[Column]
    rows: list[tuple[str, list[Cell]]]
    mean: list[Cell]


class Scene(NamedTuple):
    """What the page shows of one sequence.

    frames, labelled: numbers of frames, and of those with a label.
    error, confidence, seeds: plots, as SVG.
    failures: (setting, text) of each setting that lost the target.
    """

    name: str
    frames: int
    labelled: int
    strip: list[Picture]
    error: Markup
    confidence: Markup | None
    seeds: list[Markup]
    failures: list[tuple[str, str]]


def write_page(summary: Summary, path: str | Path) -> Path:
    """Write the page of a summary, and overview.png into the same folder; returns the page's path.

    Raises ValueError for a summary without results.
    """
    if not summary.rows:
        raise ValueError("there is no result to report")
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("dcs_jax.evaluation.report", "."),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    page = environment.get_template("report.html.jinja").render(
        summary=summary,
        title=_title(summary),
        facts=_facts(summary),
        date=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        colours=plots.colours(summary.settings),
        dashed=plots.dashed(summary.settings),
        metrics=METRICS,
        leaders=_leaders(summary),
        curves=_curves(summary),
        tables=[
            _by_sequence(summary, "Centre error", "centre_error", 1, True),
            _by_sequence(summary, "Success rate", "success_rate", 2, False),
        ],
        fewest_seeds=FEWEST_SEEDS,
        comparisons=[c for c in summary.paired if c.sequence == ""],
        scenes=[_scene(summary, sequence) for sequence in summary.sequences],
        significant=SIGNIFICANT,
        probability=_probability,
        published_name=_published_name,
        pictures=PICTURES,
    )
    path = Path(path)
    with atomic(path, text=True) as file:
        file.write(page)
    if len(summary.sequences) <= OVERVIEW_SEQUENCES:
        with atomic(path.with_name("overview.png")) as file:
            file.write(plots.overview(summary))
    return path


def _title(summary: Summary) -> str:
    names = summary.sequences
    return names[0] if len(names) == 1 else f"{len(names)} sequences"


def _facts(summary: Summary) -> list[tuple[str, str]]:
    seeds = [len(record.seeds) for key, record in summary.records.items() if "OpenCV" not in key[1]]
    starts = {start[:3] for _, _, start in summary.records}
    abouts = [record.about for record in summary.records.values()]
    environments = [about["environment"] for about in abouts]
    labelled = sum(
        int((~np.isnan(summary.labels[name].truth).any(axis=1)).sum()) for name in summary.sequences
    )
    frames = sum(len(summary.labels[name].truth) for name in summary.sequences)
    protocols = {"ope": "one pass", "tre": "20 starts", "sre": "12 disturbed boxes"}
    return [
        ("frames", f"{frames:,}, {labelled:,} labelled"),
        ("seeds", _range(seeds) if seeds else "none"),
        ("protocol", ", ".join(protocols[start] for start in sorted(starts))),
        ("dcs_jax", _listed(e["dcs_jax"] for e in environments)),
        ("code", _listed(about["code"] for about in abouts if "baseline" not in about["config"])),
        (
            "JAX, OpenCV",
            ", ".join(_listed(e[name] for e in environments) for name in ("jax", "opencv")),
        ),
        (
            "machine",
            _listed(f"{e['device']}, {e['cores']} cores, {e['system']}" for e in environments),
        ),
    ]


def _curves(summary: Summary) -> list[tuple[Markup, list[tuple[str, str]]]]:
    """Success and precision plot, each with its legend: settings and their value, best first."""
    if not summary.curves:
        return []
    plotted = (
        (plots.success_plot, {name: curves[0].mean() for name, curves in summary.curves.items()}),
        (
            plots.precision_plot,
            {name: curves[1][PRECISION_AT] for name, curves in summary.curves.items()},
        ),
    )
    return [
        (
            Markup(plot(summary)),
            [
                (name, f"{values[name]:.3f}")
                for name in sorted(values, key=values.__getitem__, reverse=True)
            ],
        )
        for plot, values in plotted
    ]


def _leaders(summary: Summary) -> list[tuple[str, int, list[Cell]]]:
    """Rows of the table of settings: name, seeds, a cell for each metric and one for the speed."""
    settings = list(summary.overall)
    columns = []
    for metric in METRICS:
        found = [summary.overall[setting][metric.field] for setting in settings]
        ranked = ranks([round(s.mean, metric.digits) for s in found], metric.least_is_best)
        columns.append(
            [
                _cell(s, metric.digits, rank, interval=True)
                for s, rank in zip(found, ranked, strict=True)
            ]
        )
    speeds = [summary.speed[setting] for setting in settings]
    ranked = ranks([round(speed) for speed in speeds], least_is_best=False)
    columns.append(
        [Cell(f"{speed:.0f}", "", speed, rank) for speed, rank in zip(speeds, ranked, strict=True)]
    )
    return [
        (setting, summary.overall[setting]["centre_error"].n, [column[row] for column in columns])
        for row, setting in enumerate(settings)
    ]


def _by_sequence(
    summary: Summary, title: str, field: str, digits: int, least_is_best: bool
) -> Table:
    colours = plots.colours(summary.settings)
    theirs = published_columns(summary)
    columns = [Column(setting, "", colours[setting]) for setting in summary.settings]
    columns += [Column(tracker, source, "") for source, tracker in theirs]

    def ranked(spreads: Sequence[Spread | None]) -> list[Cell]:
        means = [round(s.mean, digits) if s else math.nan for s in spreads]
        found = zip(spreads, ranks(means, least_is_best), strict=True)
        return [_cell(values, digits, rank) for values, rank in found]

    rows = []
    for sequence in summary.sequences:
        found: list[Spread | None] = []
        for setting in summary.settings:
            numbers = summary.by_sequence.get((sequence, setting))
            found.append(numbers[field] if numbers else None)
        for cells in theirs.values():
            one = cells.get(sequence)
            sd = one.sd if one and field == "centre_error" else math.nan
            found.append(_known(getattr(one, field), sd) if one else None)
        rows.append((sequence, ranked(found)))
    over = {sequence for sequence, _ in summary.common}
    means: list[Spread | None] = []
    for setting in summary.settings:
        means.append(summary.overall[setting][field] if setting in summary.overall else None)
    for cells in theirs.values():
        mean = mean_published(cells, over) if over else None
        means.append(_known(mean[field != "centre_error"], math.nan) if mean else None)
    return Table(title, columns, rows, ranked(means))


def _known(mean: float, sd: float) -> Spread:
    """A published number, of which at most the deviation is known."""
    return Spread(mean, sd, math.nan, math.nan, math.nan, math.nan, 0)


def _cell(values: Spread | None, digits: int, rank: int, interval: bool = False) -> Cell:
    """A mean with its 95 % interval or, by default, its standard deviation."""
    if values is None:
        return Cell("-", "", math.inf, 0)
    width = values.high - values.mean if interval else values.sd
    note = "" if math.isnan(width) else f"± {width:.{digits}f}"
    return Cell(f"{values.mean:.{digits}f}", note, values.mean, rank)


def _scene(summary: Summary, sequence: str) -> Scene:
    truth = summary.labels[sequence].truth
    confidence = plots.confidence_plot(summary, sequence)
    return Scene(
        sequence,
        len(truth),
        int((~np.isnan(truth).any(axis=1)).sum()),
        film_strip(summary, sequence, plots.colours(summary.settings)),
        Markup(plots.error_plot(summary, sequence)),
        None if confidence is None else Markup(confidence),
        [
            Markup(plots.seeds_plot(summary, sequence, metric))
            for metric in ("centre_error", "success_rate")
        ],
        _failures(summary, sequence),
    )


def _failures(summary: Summary, sequence: str) -> list[tuple[str, str]]:
    """For each setting that lost the target: in how many runs, and where first."""
    found = []
    for setting in summary.settings:
        rows = [r for r in summary.rows if (r.sequence, r.setting) == (sequence, setting)]
        first = [
            r.failures_at[0] + summary.records[sequence, setting, r.start].frame
            for r in rows
            if r.failures_at
        ]
        if first:
            frames = sorted(set(first))
            listed = ", ".join(map(str, frames[:8])) + " …" * (len(frames) > 8)
            found.append((setting, f"in {len(first)} of {len(rows)} runs, first at frame {listed}"))
    return found


def _published_name(source: str) -> str:
    return source.replace("_", " ")


def _probability(p: float) -> str:
    return "< 0.001" if p < 0.001 else f"{p:.3f}"


def _range(numbers: Sequence[int]) -> str:
    least, most = min(numbers), max(numbers)
    return str(least) if least == most else f"{least} to {most}"


def _listed(values: Iterable[str]) -> str:
    return " and ".join(sorted(set(values)))
