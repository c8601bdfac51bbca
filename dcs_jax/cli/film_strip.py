"""One image of a whole track: a strip of frames above its curves over time."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dcs_jax.evaluation.metrics import overlap
from dcs_jax.io.drawing import BOLD, SAMPLES, Colour, Drawing
from dcs_jax.io.overlay import TRACKED, TRUTH, draw_box

PANEL: Colour = (24, 33, 48)
RULE: Colour = (56, 69, 90)
FAINT: Colour = (150, 163, 184)
BRIGHT: Colour = (238, 242, 248)
PART: Colour = (58, 122, 158)
OVERLAP: Colour = (178, 226, 120)
SPANS: tuple[Colour, ...] = ((255, 132, 104), (206, 150, 255), (255, 206, 92))

BOX = 3  # thickness of a box before averaging

# Layout in pixels of the final image.
MARGIN = 36
GAP = 12
HEADER = 84
AXIS_WIDTH = 56  # left of a plot, for its tick labels
PLOT = 112
HEADROOM = 12  # of a plot, above its 1
PLOT_GAP = 50
CAPTION = 32  # below a frame


class Span(NamedTuple):
    """Frames `start` (inclusive) to `end` (exclusive) in which something happens."""

    label: str
    start: int
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
    """Draw evenly spaced frames with their boxes, and below them the confidence over time.

    Args:
        frames: [T, H, W, 3] uint8 RGB.
        boxes: [T, 4] the track, x, y, w, h in pixels.
        confidence: [T] in [0, 1], NaN left out; a curve of NaN alone is not drawn.
        part_scores: [T, K] in [0, 1], drawn as thin curves behind the confidence.
        truth: [T, 4] the annotation, drawn with the boxes and as a curve of the overlap.
        spans: intervals to shade and label in the curves.
        title: line at the top.
        subtitle: smaller line below the title.
        count: number of frames shown, four in a row.
        width: width of the image, pixels.

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
    values = np.asarray(confidence, np.float64)
    names = ["confidence"] * bool(np.isfinite(values).any())
    names += ["scores of the parts"] * (part_scores is not None)
    curves = [_Curve(" and ".join(names).capitalize(), values, TRACKED, scores)] if names else []
    if truth is not None:
        truth = np.asarray(truth, np.float64)
        values = overlap(boxes, truth)
        curves.append(_Curve("Overlap with the ground truth", values, OVERLAP, scores[:, :0]))

    drawing = Drawing(round(plots_top + len(curves) * (PLOT + PLOT_GAP) + MARGIN / 2), width)
    _draw_header(drawing, title, subtitle, truth is not None)
    tinted = [(span, SPANS[i % len(SPANS)]) for i, span in enumerate(spans)]
    shown = np.unique(np.linspace(0, length - 1, count).round().astype(int))
    for cell, t in enumerate(shown):
        left = MARGIN + (cell % across) * (cell_width + GAP)
        top = HEADER + (cell // across) * (cell_height + CAPTION)
        box_truth = None if truth is None else truth[t]
        cell_image = _draw_frame(frames[t], boxes[t], box_truth, cell_height, cell_width)
        drawing.paste(cell_image, left, top)
        _draw_caption(drawing, int(t), left, left + cell_width, top + cell_height + 18, tinted)
    for row, curve in enumerate(curves):
        _draw_plot(drawing, plots_top + row * (PLOT + PLOT_GAP), curve, tinted, shown)
    if curves:
        _draw_frame_axis(drawing, plots_top + len(curves) * (PLOT + PLOT_GAP) - PLOT_GAP, length)
    return drawing.finish()


def write_image(path: str | Path, image: NDArray[np.uint8]) -> None:
    """Write an RGB image; ValueError where that fails."""
    if not cv2.imwrite(str(path), cv2.cvtColor(image, cv2.COLOR_RGB2BGR)):
        raise ValueError(f"{path} cannot be written as an image")


Tinted = tuple[Span, Colour]


class _Curve(NamedTuple):
    """One plot: values [T] in [0, 1], NaN left out, over thin curves [T, K] of the parts."""

    name: str
    values: NDArray[np.float64]
    colour: Colour
    parts: NDArray[np.float64]


def _draw_header(drawing: Drawing, title: str, subtitle: str, with_truth: bool) -> None:
    drawing.text(title, MARGIN, 42, BRIGHT, 24, BOLD)
    drawing.text(subtitle, MARGIN, 66, FAINT, 15)
    entries = [("tracked", TRACKED)]
    if with_truth:
        entries.append(("ground truth", TRUTH))
    right: float = drawing.width - MARGIN
    for name, colour in reversed(entries):
        left = right - drawing.text_width(name, 15)
        drawing.text(name, left, 66, BRIGHT, 15)
        drawing.fill(left - 30, 59, left - 8, 62, colour)
        right = left - 48


def _draw_frame(
    frame: NDArray[np.uint8],
    box: NDArray[np.float64],
    truth: NDArray[np.float64] | None,
    height: float,
    width: float,
) -> NDArray[np.uint8]:
    """The frame in the size of its cell, with its boxes."""
    size = (round(width * SAMPLES), round(height * SAMPLES))
    scale = np.tile([size[0] / frame.shape[1], size[1] / frame.shape[0]], 2)
    shrinks = scale[0] < 1
    method = cv2.INTER_AREA if shrinks else cv2.INTER_CUBIC
    image = cv2.resize(frame, size, interpolation=method).astype(np.uint8)
    if truth is not None:
        draw_box(image, truth * scale, TRUTH, thickness=BOX)
    draw_box(image, box * scale, TRACKED, thickness=BOX)
    return image


def _draw_caption(
    drawing: Drawing, t: int, left: float, right: float, baseline: float, tinted: Sequence[Tinted]
) -> None:
    drawing.text(f"frame {t}", left, baseline, FAINT, 14)
    for span, tint in tinted:
        if span.start <= t < span.end:
            right -= drawing.text_width(span.label, 14)
            drawing.text(span.label, right, baseline, tint, 14)
            right -= GAP


def _draw_plot(
    drawing: Drawing,
    top: float,
    curve: _Curve,
    tinted: Sequence[Tinted],
    shown: NDArray[np.int_],
) -> None:
    """A curve over the frames, with the shown frames as dots."""
    values = curve.values
    x = _frame_axis(drawing, len(values))
    left, right, bottom = x[0], x[-1], top + PLOT
    unit = PLOT - HEADROOM  # pixels from 0 to 1
    drawing.fill(left, top, right, bottom, PANEL)
    drawing.text(curve.name, left, top - 10, BRIGHT, 15, BOLD)
    for span, tint in tinted:
        first, last = x[span.start], x[span.end - 1]
        drawing.fill(first, top, last, bottom, tint, opacity=0.22)
        drawing.fill(first, top, last, top + 3, tint)
        middle = (first + last) / 2 - drawing.text_width(span.label, 14) / 2
        drawing.text(span.label, middle, top - 10, tint, 14)
    for level in (0, 0.5, 1):
        y = bottom - level * unit
        drawing.fill(left, y - 0.5, right, y + 0.5, RULE)
        text = f"{level:.1f}"
        drawing.text(text, left - 10 - drawing.text_width(text, 13), y + 5, FAINT, 13)
    for part in curve.parts.T:
        drawing.curve(np.column_stack([x, bottom - part * unit]), PART, 1)
    points = np.column_stack([x, bottom - values * unit])
    drawing.curve(points[np.isfinite(values)], curve.colour, 2)
    for t in shown[np.isfinite(values[shown])]:
        drawing.dot(points[t], 5, PANEL)
        drawing.dot(points[t], 3.5, curve.colour)


def _draw_frame_axis(drawing: Drawing, bottom: float, length: int) -> None:
    x = _frame_axis(drawing, length)
    drawing.text("frame", MARGIN, bottom + 19, FAINT, 13)
    for t in range(0, length, _tick_step(length)):
        left = x[t] - drawing.text_width(str(t), 13) / 2
        drawing.text(str(t), left, bottom + 19, FAINT, 13)


def _frame_axis(drawing: Drawing, length: int) -> NDArray[np.float64]:
    """Horizontal position of each frame, pixels: [T]."""
    return np.linspace(MARGIN + AXIS_WIDTH, drawing.width - MARGIN, length)


def _tick_step(length: int) -> int:
    """Smallest of 1, 2, 5, 10, 20, ... that gives at most 16 ticks."""
    step: int = 10 ** int(np.floor(np.log10(max(length / 16, 1))))
    return next(step * factor for factor in (1, 2, 5, 10) if step * factor * 16 >= length)
