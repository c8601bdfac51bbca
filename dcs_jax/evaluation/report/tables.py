"""The numbers of a summary as files: results.csv, summary.json, summary.md."""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dcs_jax.evaluation.metrics import Scores
from dcs_jax.evaluation.statistics import Spread, WelchTest, ranks
from dcs_jax.evaluation.summary import Row, Summary, mean_published, published_columns
from dcs_jax.io.files import atomic, write_table


def write_summary(summary: Summary, folder: Path) -> None:
    """Write results.csv (one row for each run), summary.json and summary.md into the folder."""
    ends = ("failures_at", "frames", "frames_per_second")
    header = ("sequence", "setting", "start", "seed", *Scores._fields, *ends)
    write_table(folder / "results.csv", header, map(_run_cells, summary.rows))
    with atomic(folder / "summary.json", text=True) as file:
        json.dump(_plain(as_dict(summary)), file, indent=1)
    with atomic(folder / "summary.md", text=True) as file:
        file.write(as_markdown(summary))


def _run_cells(row: Row) -> list[Any]:
    numbers = [f"{value:.6g}" for value in row.scores]
    failures_at = " ".join(map(str, row.failures_at))
    return [*row[:4], *numbers, failures_at, row.frames, f"{row.frames_per_second:.1f}"]


def as_dict(summary: Summary) -> dict[str, Any]:
    """The numbers of a summary by name, without the boxes."""
    abouts = {record.setting: record.about for record in summary.records.values()}
    return {
        "sequences": {
            name: {
                "frames": len(summary.labels[name].truth),
                "labelled": int((~np.isnan(summary.labels[name].truth).any(axis=1)).sum()),
                "data": summary.labels[name].data,
            }
            for name in summary.sequences
        },
        "settings": {
            name: {
                "code": abouts[name]["code"],
                "environment": abouts[name]["environment"],
                "track_frames_per_second": summary.speed[name],
                "overall": _named(summary.overall.get(name, {})),
                "success_curve": [curve.tolist() for curve in summary.curves.get(name, ())][:1],
                "precision_curve": [curve.tolist() for curve in summary.curves.get(name, ())][1:],
                "sequences": {
                    sequence: _named(summary.by_sequence[sequence, name])
                    for sequence in summary.sequences
                    if (sequence, name) in summary.by_sequence
                },
            }
            for name in summary.settings
        },
        "common": summary.common,
        "paired": [
            comparison._asdict()
            | {
                "centre_error": comparison.centre_error._asdict(),
                "success_rate": comparison.success_rate._asdict(),
            }
            for comparison in summary.paired
        ],
        "agreement": [
            {
                "sequence": a.sequence,
                "setting": a.setting,
                "ours": a.ours._asdict(),
                "published": a.published._asdict(),
                **(a.test._asdict() if a.test else dict.fromkeys(WelchTest._fields)),
            }
            for a in summary.agreement
        ],
        "published": [row._asdict() for row in summary.published],
        "notes": summary.notes,
    }


def as_markdown(summary: Summary) -> str:
    """A Markdown table of centre error / success rate by sequence and setting, the best bold."""
    columns = published_columns(summary)
    heads = [*summary.settings, *(f"{tracker} ({source})" for source, tracker in columns)]
    lines = [
        "| sequence | " + " | ".join(heads) + " |",
        "|---|" + "---|" * len(heads),
    ]
    for sequence in summary.sequences:
        found = [summary.by_sequence.get((sequence, setting)) for setting in summary.settings]
        ours = [(s["centre_error"].mean, s["success_rate"].mean) if s else None for s in found]
        theirs = [cells.get(sequence) for cells in columns.values()]
        cells = _cells([*ours, *((p.centre_error, p.success_rate) if p else None for p in theirs)])
        lines.append(f"| {sequence} | " + " | ".join(cells) + " |")
    if summary.overall:
        over = {sequence for sequence, _ in summary.common}
        ours = [(s["centre_error"].mean, s["success_rate"].mean) for s in summary.overall.values()]
        theirs_mean = [mean_published(cells, over) for cells in columns.values()]
        lines.append("| **mean** | " + " | ".join(_cells([*ours, *theirs_mean])) + " |")
    return "\n".join(lines) + "\n"


def _cells(values: Sequence[tuple[float, float] | None]) -> list[str]:
    """Texts of (centre error, success rate); the best of a row bold."""
    known = [value or (math.nan, math.nan) for value in values]
    errors = ranks([round(error, 1) for error, _ in known], least_is_best=True)
    rates = ranks([round(rate, 2) for _, rate in known], least_is_best=False)
    return [
        f"{_bold(f'{value[0]:.1f}', error == 1)} / {_bold(f'{value[1]:.2f}', rate == 1)}"
        if value
        else "-"
        for value, error, rate in zip(values, errors, rates, strict=True)
    ]


def _bold(text: str, wanted: bool) -> str:
    return f"**{text}**" if wanted else text


def _named(spreads: dict[str, Spread]) -> dict[str, dict[str, float]]:
    return {metric: values._asdict() for metric, values in spreads.items()}


def _plain(value: Any) -> Any:
    """The same with None for NaN, which JSON does not have."""
    if isinstance(value, dict):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
