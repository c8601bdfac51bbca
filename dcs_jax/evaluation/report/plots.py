"""The plots of the report, as SVG in the page's colour of text: one plot for light and dark."""

import io
import re
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from dcs_jax.evaluation.metrics import (
    HELD,
    OVERLAP_THRESHOLDS,
    PIXEL_THRESHOLDS,
    PRECISION_AT,
    centre_error,
)
from dcs_jax.evaluation.results import Published
from dcs_jax.evaluation.summary import REPEATS, Summary

# Readable on white and on near-black, in an order with much contrast between neighbours.
COLOURS = (
    *("#2f80ed", "#e8710a", "#1a9e6c", "#b152d6", "#d93a5b", "#8a8f00"),
    *("#00a0b8", "#a0663c", "#6c6fd8", "#64a81e", "#d1459f", "#71808f"),
)
DASHES = ("-", (0, (5, 1.5)), (0, (1.5, 1.2)))
INK = "#010203"  # replaced by `currentColor`, the page's colour of text

# Points. Plots are as wide as a phone, so that their text is readable on one.
WIDTH, HEIGHT, POINTS_PER_INCH = 400, 210, 72

_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 10,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.grid": True,
    "grid.color": INK,
    "grid.alpha": 0.13,
    "axes.linewidth": 0.7,
    "lines.linewidth": 1.6,
}


def colours(settings: Sequence[str]) -> dict[str, str]:
    """The colour of each setting, the same throughout the report."""
    return {setting: COLOURS[n % len(COLOURS)] for n, setting in enumerate(settings)}


def dashed(settings: Sequence[str]) -> set[str]:
    """The settings that share the colour of an earlier one, whose lines are dashed."""
    return set(settings[len(COLOURS) :])


def success_plot(summary: Summary) -> str:
    """Success curves over the overlap threshold."""
    figure, axes = _figure()
    for setting, (curve, _) in summary.curves.items():
        _line(axes, summary, setting, OVERLAP_THRESHOLDS, curve)
    axes.axvline(HELD, color=INK, linewidth=0.7, alpha=0.4)
    axes.set(xlabel="overlap threshold", ylabel="success rate", xlim=(0, 1), ylim=(0, 1.02))
    return _svg(figure, "success")


def precision_plot(summary: Summary) -> str:
    """Precision curves over the centre error threshold."""
    figure, axes = _figure()
    for setting, (_, curve) in summary.curves.items():
        _line(axes, summary, setting, PIXEL_THRESHOLDS, curve)
    axes.axvline(PRECISION_AT, color=INK, linewidth=0.7, alpha=0.4)
    axes.set(xlabel="centre error threshold, px", ylabel="precision", xlim=(0, 50), ylim=(0, 1.02))
    return _svg(figure, "precision")


def error_plot(summary: Summary, sequence: str) -> str:
    """Centre error over the frames, for the first start of the protocol.

    The median over seeds, with a band from the 10th to the 90th percentile.
    """
    figure, axes = _figure()
    truth = summary.labels[sequence].truth
    for setting, start in _first_starts(summary, sequence):
        record = summary.records[sequence, setting, start]
        labels = truth[record.frame :]
        errors = np.array([centre_error(boxes, labels) for boxes in record.boxes])
        known = ~np.isnan(errors[0])
        frames = np.flatnonzero(known) + record.frame
        _band(axes, summary, setting, frames, errors[:, known])
    axes.set(ylabel="centre error, px", xlim=(0, len(truth) - 1))
    axes.set_ylim(0, None)
    axes.set_xlabel("frame")
    return _svg(figure, f"error-{summary.sequences.index(sequence)}")


def confidence_plot(summary: Summary, sequence: str) -> str | None:
    """Confidence over the frames, as `error_plot`; None unless a tracker has a confidence."""
    figure, axes = _figure()
    drawn = False
    for setting, start in _first_starts(summary, sequence):
        record = summary.records[sequence, setting, start]
        if np.isnan(record.confidence).all():
            continue
        frames = np.arange(record.confidence.shape[1]) + record.frame
        _band(axes, summary, setting, frames, record.confidence)
        drawn = True
    if not drawn:
        return None
    length = len(summary.labels[sequence].truth)
    axes.set(xlabel="frame", ylabel="confidence", xlim=(0, length - 1), ylim=(0, 1.04))
    return _svg(figure, f"confidence-{summary.sequences.index(sequence)}")


def seeds_plot(summary: Summary, sequence: str, metric: str) -> str:
    """Every seed as a dot on a box of quartiles, one column for each setting.

    Published means, with their deviation, are to the right of the settings that repeat them.
    """
    figure, axes = _figure()
    _draw_seeds(axes, summary, sequence, metric)
    return _svg(figure, f"seeds-{metric}-{summary.sequences.index(sequence)}")


def _draw_seeds(axes: Axes, summary: Summary, sequence: str, metric: str) -> None:
    settings = [s for s in summary.settings if (sequence, s) in summary.by_sequence]
    rng = np.random.default_rng(0)
    for column, setting in enumerate(settings):
        values = np.array(
            [
                getattr(row.scores, metric)
                for row in summary.rows
                if (row.sequence, row.setting) == (sequence, setting)
            ]
        )
        colour = colours(summary.settings)[setting]
        if len(values) > 1:
            axes.boxplot(
                [values],
                positions=[column],
                widths=0.5,
                showfliers=False,
                patch_artist=True,
                boxprops={"facecolor": colour + "30", "edgecolor": colour},
                medianprops={"color": colour, "linewidth": 2},
                whiskerprops={"color": colour},
                capprops={"color": colour},
            )
        scatter = rng.uniform(-0.16, 0.16, len(values)) if len(values) > 1 else [0]
        axes.plot(column + np.array(scatter), values, ".", color=colour, markersize=5, alpha=0.75)
        for theirs in repeated(summary, sequence, setting):
            value = theirs.centre_error if metric == "centre_error" else theirs.success_rate
            sd = theirs.sd if metric == "centre_error" and theirs.sd > 0 else None
            axes.errorbar(
                column + 0.38, value, sd, fmt="D", color=INK, markersize=5, capsize=3, linewidth=1.2
            )
    axes.set_xticks(range(len(settings)), [_wrapped(s) for s in settings])
    axes.set_xlim(-0.5, len(settings) - 0.3)
    axes.grid(False, axis="x")
    if metric == "success_rate":
        axes.set_ylim(-0.02, 1.04)
        axes.set_ylabel("success rate")
    else:
        axes.set_ylim(0, None)
        axes.set_ylabel("centre error, px")


def overview(summary: Summary) -> bytes:
    """A PNG on white, for documents: the seeds of every sequence, centre error above success."""
    wide = len(summary.sequences)
    inches = max(1.9 * wide + 0.4, 6)
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(inches, 4.8), layout="constrained")
        grid = figure.subplots(2, wide, squeeze=False)
        for row, metric in enumerate(("centre_error", "success_rate")):
            for axes, sequence in zip(grid[row], summary.sequences, strict=True):
                _draw_seeds(axes, summary, sequence, metric)
                axes.set_xticks([])
                if row == 0:
                    axes.set_title(sequence, fontsize=11)
                if sequence != summary.sequences[0]:
                    axes.set_ylabel("")
        handles = [
            Line2D([], [], color=colour, marker="o", linestyle="", label=setting)
            for setting, colour in colours(summary.settings).items()
        ]
        if any(repeated(summary, *names) for names in summary.by_sequence):
            label = "published runs, mean ± deviation"
            handles.append(Line2D([], [], color=INK, marker="D", linestyle="", label=label))
        figure.legend(
            handles=handles, loc="outside lower center", ncols=int(inches / 3), frameon=False
        )
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=110)
    return buffer.getvalue()


def repeated(summary: Summary, sequence: str, setting: str) -> list[Published]:
    """The published runs on a sequence that a setting repeats, if their deviation is known."""
    tracker = REPEATS.get(setting)
    return [
        row
        for row in summary.published
        if (row.sequence, row.tracker) == (sequence, tracker) and not np.isnan(row.sd)
    ]


def _first_starts(summary: Summary, sequence: str) -> list[tuple[str, str]]:
    """(setting, start) of the first start that each setting has on a sequence."""
    found: dict[str, str] = {}
    for name, setting, start in sorted(summary.records):
        if name == sequence:
            found.setdefault(setting, start)
    return [(setting, found[setting]) for setting in summary.settings if setting in found]


def _band(
    axes: Axes,
    summary: Summary,
    setting: str,
    frames: NDArray[np.int_],
    values: NDArray[np.float64] | NDArray[np.float32],
) -> None:
    """Draw the median over seeds of the values [S, T], and a band if there are several seeds."""
    _line(axes, summary, setting, frames, np.asarray(np.median(values, axis=0)))
    if len(values) > 1:
        low, high = np.percentile(values, (10, 90), axis=0)
        colour = colours(summary.settings)[setting]
        axes.fill_between(frames, low, high, color=colour, alpha=0.16, linewidth=0)


def _line(
    axes: Axes,
    summary: Summary,
    setting: str,
    x: NDArray[np.float64] | NDArray[np.int_],
    y: NDArray[np.float64] | NDArray[np.float32],
) -> None:
    index = summary.settings.index(setting)
    dash = DASHES[index // len(COLOURS) % len(DASHES)]
    axes.plot(x, y, color=colours(summary.settings)[setting], linestyle=dash)


def _wrapped(name: str) -> str:
    """A setting's name on several short lines."""
    return name.replace(" ", "\n").replace("=", "\n=")


def _figure() -> tuple[Figure, Axes]:
    with mpl.rc_context(_STYLE):
        inches = (WIDTH / POINTS_PER_INCH, HEIGHT / POINTS_PER_INCH)
        figure = Figure(figsize=inches, layout="constrained")
        return figure, figure.add_subplot()


def _svg(figure: Figure, name: str) -> str:
    """The figure as an SVG element, whose ids begin with `name` and so are unique on the page."""
    buffer = io.StringIO()
    with mpl.rc_context({**_STYLE, "svg.hashsalt": name}):
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    svg = buffer.getvalue()
    svg = svg[svg.index("<svg") :].replace(INK, "currentColor")
    svg = re.sub(r'\bid="', f'id="{name}-', svg)
    svg = re.sub(r'(url\(#|href="#)', rf"\g<1>{name}-", svg)
    return re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
