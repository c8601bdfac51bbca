"""Histograms of the object's colours and of those around it, one more cue of the position."""

import math
from typing import NamedTuple

import numpy as np

from .records import Floats, Grid, Integers, Settings
from .window import cell_aspect, shown_box, turned

BINS = 16  # a brightness and two differences of channels have
LARGEST = 64  # difference that has a bin of its own
UNSEEN = 1e-4  # added to frequencies
OBJECT, NEAR, AROUND = 0.8, 1.1, 2.5  # sides
COLOURFUL = 8.0  # mean difference of channels from which colour counts in full


class ColourState(NamedTuple):
    """Frequencies of the colours in the object and around it, and how much they count."""

    inside: Floats
    outside: Floats
    colourful: float


def init(colours: np.ndarray | None, box: Floats, settings: Settings) -> ColourState:
    """The histograms of the first frame; colours: of `window_colours` around the box."""
    if colours is None:
        return ColourState(np.zeros(BINS**3), np.zeros(BINS**3), 0.0)
    values = colours.astype(np.float64)
    difference = (values.max(axis=2) - values.min(axis=2)).mean()
    return ColourState(*histograms(colours, box, settings), min(difference / COLOURFUL, 1.0))


def update(state: ColourState, colours: np.ndarray, box: Floats, settings: Settings) -> ColourState:
    """The running means of the histograms after one more frame."""
    assert settings.colour
    rate = settings.colour.learning_rate
    inside, outside = histograms(colours, box, settings)
    return ColourState(
        (1 - rate) * state.inside + rate * inside,
        (1 - rate) * state.outside + rate * outside,
        state.colourful,
    )


def score(
    state: ColourState,
    probabilities: Floats,
    displacement: Floats,
    box: Floats,
    settings: Settings,
) -> float:
    """What colour adds to the score of the box where it is displaced by [2] canvas cells.

    probabilities: [Y, X], of the window around the box.
    """
    assert settings.colour
    down, across = np.asarray(displacement) / spacing(settings.grid)
    half_height, half_width = half_sides(box, settings)
    rows, columns = probabilities.shape
    over_rows = np.array(
        [covered(place(i, rows) - down, OBJECT * half_height) for i in range(rows)]
    )
    over_columns = np.array(
        [covered(place(j, columns) - across, OBJECT * half_width) for j in range(columns)]
    )
    mean = over_rows @ probabilities @ over_columns / (over_rows.sum() * over_columns.sum())
    return settings.colour.weight * state.colourful * float(mean)


def pixel_probabilities(state: ColourState, colours: np.ndarray) -> Floats:
    """How likely each pixel [Y, X, 3] is one of the object, by its colour alone: [Y, X]."""
    probabilities = np.zeros(colours.shape[:2])
    for i in range(colours.shape[0]):
        for j in range(colours.shape[1]):
            number = bin_of(colours[i, j])
            of_object = state.inside[number] + UNSEEN
            probabilities[i, j] = of_object / (of_object + state.outside[number] + UNSEEN)
    return probabilities


def histograms(colours: np.ndarray, box: Floats, settings: Settings) -> tuple[Floats, Floats]:
    """Frequencies of the colours in the box's inner part and around it, each with the sum 1."""
    half_height, half_width = half_sides(box, settings)
    step, inside, outside = spacing(settings.grid), np.zeros(BINS**3), np.zeros(BINS**3)
    far_down = AROUND * settings.grid.rows / step / 2
    far_across = AROUND * settings.grid.columns / step / 2
    for i in range(colours.shape[0]):
        for j in range(colours.shape[1]):
            down, across = place(i, colours.shape[0]), place(j, colours.shape[1])
            number = bin_of(colours[i, j])
            inside[number] += covered(down, OBJECT * half_height) * covered(
                across, OBJECT * half_width
            )
            near = covered(down, min(NEAR * half_height, far_down)) * covered(
                across, min(NEAR * half_width, far_across)
            )
            outside[number] += covered(down, far_down) * covered(across, far_across) - near
    return inside / max(inside.sum(), 1), outside / max(outside.sum(), 1)


def window_colours(
    frame: np.ndarray, box: Floats, settings: Settings, angle: float = 0.0
) -> np.ndarray | None:
    """The pixels in the middle of blocks of the window's cells, [Y, X, 3]; None of a grey frame.

    angle: by which the canvas is turned.
    """
    if frame.ndim == 2:
        return None
    grid, step = settings.grid, spacing(settings.grid)
    x, y, width, height = shown_box(box, settings)
    rows, columns = (count // step for count in grid.window)
    colours = np.zeros((rows, columns, 3), np.uint8)
    for i in range(rows):
        for j in range(columns):
            on_canvas = step * np.array([place(i, rows), place(j, columns)])
            down, across = turned(on_canvas, angle, cell_aspect(box, settings))
            row = math.floor(y + height / 2 + down * height / grid.rows)
            column = math.floor(x + width / 2 + across * width / grid.columns)
            row = min(max(row, 0), frame.shape[0] - 1)
            column = min(max(column, 0), frame.shape[1] - 1)
            colours[i, j] = frame[row, column]
    return colours


def bin_of(pixel: Integers) -> int:
    """The number of a colour's bin: brightness, red less green, their mean less blue."""
    red, green, blue = (int(channel) for channel in pixel)
    brightness = (red + green + blue) / 3
    number = math.floor(brightness * BINS / 256)
    for difference in (red - green, math.floor((red + green) / 2 - blue)):
        of_difference = math.floor((difference + LARGEST) * BINS / (2 * LARGEST))
        number = number * BINS + min(max(of_difference, 0), BINS - 1)
    return number


def half_sides(box: Floats, settings: Settings) -> Floats:
    """Half the height and width [2] of the box, in blocks."""
    grid = settings.grid
    _, _, width, height = shown_box(box, settings)
    cells = np.array([box[3] / height * grid.rows, box[2] / width * grid.columns])
    return cells / spacing(grid) / 2


def spacing(grid: Grid) -> int:
    """Cells on a side of a block, of which one pixel is read."""
    return 1 if grid.rows % 2 or grid.columns % 2 else 2


def place(index: int, count: int) -> float:
    """How far one of so many blocks in a line is from their middle, blocks."""
    return index - (count - 1) / 2


def covered(away: float, half: float) -> float:
    """How much a side of twice `half`, at least one block, covers of a block away from its middle.

    Nothing or all of a block, but for those at its ends.
    """
    return min(max(max(half, 0.5) + 0.5 - abs(away), 0.0), 1.0)
