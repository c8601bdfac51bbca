"""One picture of a whole track: a strip of frames above its curves over time."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dcs_jax.evaluation.metrics import overlap
from dcs_jax.io.drawing import BOLD, SAMPLES, Canvas, Colour
from dcs_jax.io.overlay import TRACKED, TRUTH, draw_box

PANEL: Colour = (24, 33, 48)
RULE: Colour = (56, 69, 90)
FAINT: Colour = (150, 163, 184)
BRIGHT: Colour = (238, 242, 248)
PART: Colour = (58, 122, 158)
OVERLAP: Colour = (178, 226, 120)
SPANS: tuple[Colour, ...] = ((255, 132, 104), (206, 150, 255), (255, 206, 92))

BOX = 3  # thickness of a box before averaging

# Layout in pixels of the finished picture.
MARGIN = 36
GAP = 12
HEADER = 84
AXIS = 56  # left of a plot, for its scale
PLOT = 112
HEADROOM = 12  # of a plot, above its 1
PLOT_GAP = 50
CAPTION = 32  # below a frame


class Span(NamedTuple):
    """Frames `begin` (inclusive) to `end` (exclusive) in which something happens."""

    label: str
    begin: int
    end: int


def film_strip(
    frames: NDArray[np.uint8],
    boxes: ArrayLike,
    confidence: ArrayLike,
    *,
    part_scores: ArrayLike | None = None,
    truth: ArrayLike | None = None,
    spans: Sequence[Span] = (),
    title: str = "",
    subtitle: str = "",
    count: int = 8,
    width: int = 1200,
) -> NDArray[np.uint8]:
    """Draw evenly chosen frames with their boxes, and below them the confidence over time.

    Args:
        frames: [T, H, W, 3] uint8 RGB.
        boxes: [T, 4], the track, x, y, w, h in pixels.
        confidence: [T] in [0, 1].
        part_scores: [T, K] in [0, 1], drawn as thin curves below the confidence.
        truth: [T, 4], the annotation, drawn with the boxes and as a curve of the overlap.
        spans: intervals to shade and label in the curves.
        title: the line at the top.
        subtitle: the smaller line below it.
        count: number of frames shown, four to a row.
        width: of the picture, pixels.

    Returns:
        [rows, width, 3] uint8 RGB.
    """
    boxes = np.asarray(boxes, np.float64)
    length, rows, columns = frames.shape[:3]
    across = min(4, count)
    cell_width = (width - 2 * MARGIN - (across - 1) * GAP) / across
    cell_height = cell_width * rows / columns
    plots_top = HEADER + -(-count // across) * (cell_height + CAPTION) + PLOT_GAP
    scores = np.empty((length, 0)) if part_scores is None else np.asarray(part_scores, np.float64)
    name = "Confidence" if part_scores is None else "Confidence and scores of the parts"
    curves = [_Curve(name, np.asarray(confidence, np.float64), TRACKED, scores)]
    if truth is not None:
        truth = np.asarray(truth, np.float64)
        values = overlap(boxes, truth)
        curves.append(_Curve("Overlap with the ground truth", values, OVERLAP, scores[:, :0]))

    canvas = Canvas(round(plots_top + len(curves) * (PLOT + PLOT_GAP) + MARGIN / 2), width)
    _draw_header(canvas, title, subtitle, truth is not None)
    tinted = [(span, SPANS[i % len(SPANS)]) for i, span in enumerate(spans)]
    shown = np.unique(np.linspace(0, length - 1, count).round().astype(int))
    for cell, t in enumerate(shown):
        left = MARGIN + (cell % across) * (cell_width + GAP)
        top = HEADER + (cell // across) * (cell_height + CAPTION)
        box_truth = None if truth is None else truth[t]
        picture = _picture(frames[t], boxes[t], box_truth, cell_height, cell_width)
        canvas.place(picture, left, top)
        _draw_caption(canvas, int(t), left, left + cell_width, top + cell_height + 18, tinted)
    for row, curve in enumerate(curves):
        _draw_plot(canvas, plots_top + row * (PLOT + PLOT_GAP), curve, tinted, shown)
    _draw_frame_axis(canvas, plots_top + len(curves) * (PLOT + PLOT_GAP) - PLOT_GAP, length)
    return canvas.finish()


def write_image(path: str | Path, image: NDArray[np.uint8]) -> None:
    """Write an RGB image; ValueError where that fails."""
    if not cv2.imwrite(str(path), cv2.cvtColor(image, cv2.COLOR_RGB2BGR)):
        raise ValueError(f"{path} cannot be written as an image")


Tinted = tuple[Span, Colour]


class _Curve(NamedTuple):
    """One plot: the values [T] in [0, 1], NaN left out, above thin curves [T, K] of its parts."""

    name: str
    values: NDArray[np.float64]
    colour: Colour
    parts: NDArray[np.float64]


def _draw_header(canvas: Canvas, title: str, subtitle: str, with_truth: bool) -> None:
    canvas.text(title, MARGIN, 42, BRIGHT, 24, BOLD)
    canvas.text(subtitle, MARGIN, 66, FAINT, 15)
    entries = [("tracked", TRACKED)]
    if with_truth:
        entries.append(("ground truth", TRUTH))
    right: float = canvas.width - MARGIN
    for name, colour in reversed(entries):
        left = right - canvas.text_width(name, 15)
        canvas.text(name, left, 66, BRIGHT, 15)
        canvas.fill(left - 30, 59, left - 8, 62, colour)
        right = left - 48


def _picture(
    frame: NDArray[np.uint8],
    box: NDArray[np.float64],
    truth: NDArray[np.float64] | None,
    height: float,
    width: float,
) -> NDArray[np.uint8]:
    """The frame at the size of its cell, with its boxes."""
    size = (round(width * SAMPLES), round(height * SAMPLES))
    scale = np.tile([size[0] / frame.shape[1], size[1] / frame.shape[0]], 2)
    shrinks = scale[0] < 1
    method = cv2.INTER_AREA if shrinks else cv2.INTER_CUBIC
    picture = cv2.resize(frame, size, interpolation=method).astype(np.uint8)
    if truth is not None:
        draw_box(picture, truth * scale, TRUTH, thickness=BOX)
    draw_box(picture, box * scale, TRACKED, thickness=BOX)
    return picture


def _draw_caption(
    canvas: Canvas, t: int, left: float, right: float, baseline: float, tinted: Sequence[Tinted]
) -> None:
    canvas.text(f"frame {t}", left, baseline, FAINT, 14)
    for span, tint in tinted:
        if span.begin <= t < span.end:
            right -= canvas.text_width(span.label, 14)
            canvas.text(span.label, right, baseline, tint, 14)
            right -= GAP


def _draw_plot(
    canvas: Canvas,
    top: float,
    curve: _Curve,
    tinted: Sequence[Tinted],
    shown: NDArray[np.int_],
) -> None:
    """A curve over the frames, with the shown frames as dots."""
    values = curve.values
    x = _frame_axis(canvas, len(values))
    left, right, bottom = x[0], x[-1], top + PLOT
    unit = PLOT - HEADROOM  # pixels from 0 to 1
    canvas.fill(left, top, right, bottom, PANEL)
    canvas.text(curve.name, left, top - 10, BRIGHT, 15, BOLD)
    for span, tint in tinted:
        begin, end = x[span.begin], x[span.end - 1]
        canvas.fill(begin, top, end, bottom, tint, opacity=0.22)
        canvas.fill(begin, top, end, top + 3, tint)
        middle = (begin + end) / 2 - canvas.text_width(span.label, 14) / 2
        canvas.text(span.label, middle, top - 10, tint, 14)
    for level in (0, 0.5, 1):
        y = bottom - level * unit
        canvas.fill(left, y - 0.5, right, y + 0.5, RULE)
        text = f"{level:.1f}"
        canvas.text(text, left - 10 - canvas.text_width(text, 13), y + 5, FAINT, 13)
    for part in curve.parts.T:
        canvas.curve(np.column_stack([x, bottom - part * unit]), PART, 1)
    points = np.column_stack([x, bottom - values * unit])
    canvas.curve(points[np.isfinite(values)], curve.colour, 2)
    for t in shown[np.isfinite(values[shown])]:
        canvas.dot(points[t], 5, PANEL)
        canvas.dot(points[t], 3.5, curve.colour)


def _draw_frame_axis(canvas: Canvas, bottom: float, length: int) -> None:
    x = _frame_axis(canvas, length)
    canvas.text("frame", MARGIN, bottom + 19, FAINT, 13)
    for t in range(0, length, _tick_step(length)):
        left = x[t] - canvas.text_width(str(t), 13) / 2
        canvas.text(str(t), left, bottom + 19, FAINT, 13)


def _frame_axis(canvas: Canvas, length: int) -> NDArray[np.float64]:
    """Where each frame lies from left to right, pixels: [T]."""
    return np.linspace(MARGIN + AXIS, canvas.width - MARGIN, length)


def _tick_step(length: int) -> int:
    """The least of 1, 2, 5, 10, 20, ... that gives at most 16 ticks."""
    step: int = 10 ** int(np.floor(np.log10(max(length / 16, 1))))
    return next(step * factor for factor in (1, 2, 5, 10) if step * factor * 16 >= length)
