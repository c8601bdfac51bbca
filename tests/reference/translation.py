"""The translation filter: a correlation filter on the window's gradients, one more cue."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from . import filters
from .filters import Filter, Spectrum
from .gradients import gradient_cells
from .records import Floats, Grid, Integers, Settings, TranslationFilter
from .samples import reachable
from .search import PLATEAU
from .window import cell_aspect, shown_box, turned

CELLS = 10  # of the filter along the object's shorter side
SIGMA = 1 / 16  # of the desired output, in sides of the object
RIDGE = 0.01  # in means of the denominator
LEAST_SQUARE = 1e-6


class TranslationState(NamedTuple):
    """The filter's running mean, and the filter of the first frame."""

    running: Filter
    first_frame: Filter


def init(cells: Floats, settings: TranslationFilter, grid: Grid) -> TranslationState:
    """The filter after the first frame; cells: [Gy, Gx], of the window around the initial box."""
    trained = train(cells, settings, grid)
    return TranslationState(trained, trained)


def respond(
    state: TranslationState, cells: Floats, settings: TranslationFilter, grid: Grid
) -> Spectrum:
    """Spectrum [Y, X] of what the filter adds to the score: its weighted response."""
    mixed = filters.interpolate(state.running, state.first_frame, settings.first_frame)
    return settings.weight * response(mixed, cells, grid)


def search_middle(
    spectrum: Spectrum,
    more: Callable[[Integers], float],
    box: Floats,
    frame_shape: tuple[int, ...],
    settings: Settings,
    angle: float = 0.0,
) -> Integers:
    """Displacement [2] (down, across), canvas cells, of the search window from the last box.

    The cell of the best response and `more`, of a displacement [2], less the motion prior, the
    nearest one of equals, among those around which the search window does not leave the filter's.

    angle: by which the canvas is turned.
    """
    grid, searched, cell = settings.grid, settings.search_grid, cell_side(settings.grid)
    values = np.fft.ifft2(spectrum).real
    (low_y, high_y), (low_x, high_x) = reachable(box, frame_shape, settings)
    most_down = (grid.margin_rows - searched.margin_rows) // cell
    most_across = (grid.margin_columns - searched.margin_columns) // cell
    _, _, width, height = shown_box(box, settings)
    found = []
    for i in range(-most_down, most_down + 1):
        for j in range(-most_across, most_across + 1):
            on_canvas = cell * np.array([i, j])
            y, x = turned(on_canvas, angle, cell_aspect(box, settings))
            if low_y <= y <= high_y and low_x <= x <= high_x:
                down = i * cell * height / grid.rows
                across = j * cell * width / grid.columns
                distance = (down**2 + across**2) / (width * height)
                value = values[i, j] + more(on_canvas)
                found.append((value - settings.prior * distance, distance, i, j))
    best = max(found)[0]
    _, _, i, j = min((one for one in found if one[0] >= best - PLATEAU), key=lambda one: one[1])
    return cell * np.array([i, j])


def score(spectrum: Spectrum, middle: Integers, settings: Settings) -> Floats:
    """What the filter adds to the score map of the search window, [Cy, Cx]: its Fourier series.

    spectrum: from `respond`. middle: [2], canvas cells, of that window.
    """
    cell, searched = cell_side(settings.grid), settings.search_grid
    down = fourier_series(spectrum, middle[0], searched.margin_rows, cell)
    return fourier_series(down.T, middle[1], searched.margin_columns, cell).T.real


def responses(state: TranslationState, cells: Floats, displacement: Floats, grid: Grid) -> float:
    """Sum of the responses of both filters at a displacement [2] (down, across), canvas cells.

    cells: [Gy, Gx], of the window around the last box.
    """
    total = 0.0
    for trained in state:
        values = response(trained, cells, grid)
        for place in displacement:
            values = fourier_series(values, place, 0, cell_side(grid))[0]
        total += float(values.real)
    return total


def update(
    state: TranslationState, cells: Floats, settings: TranslationFilter, grid: Grid
) -> TranslationState:
    """The filter after one more frame; cells: [Gy, Gx], of the window around the new box."""
    trained = train(cells, settings, grid)
    running = filters.interpolate(state.running, trained, settings.learning_rate)
    return TranslationState(running, state.first_frame)


def train(cells: Floats, settings: TranslationFilter, grid: Grid) -> Filter:
    """The filter [8, Y, X] that responds with a Gaussian around no displacement.

    It learns what is under a Hann window of a few sides of the object.
    """
    features = window_features(cells, grid)
    _, rows, columns = features.shape
    faded, desired = fade(rows, columns), np.zeros((rows, columns))
    for i in range(rows):
        for j in range(columns):
            learned = 1.0
            for index, count, side in ((i, rows, grid.rows), (j, columns, grid.columns)):
                away = abs(index + 0.5 - count / 2) * cell_side(grid) / side
                away = min(away / settings.learned_factor, 0.5)
                learned *= np.cos(np.pi * away) ** 2
            features[:, i, j] *= min(learned, faded[i, j])
            down = wrapped(i, rows) * cell_side(grid) / (SIGMA * grid.rows)
            across = wrapped(j, columns) * cell_side(grid) / (SIGMA * grid.columns)
            desired[i, j] = np.exp(-(down**2 + across**2) / 2)
    return filters.train(features, desired)


def response(trained: Filter, cells: Floats, grid: Grid) -> Spectrum:
    """The spectrum [Y, X] of the filter's response in a window."""
    ridge = RIDGE * trained.denominator.mean()
    features = window_features(cells, grid)
    return filters.response(trained, features * fade(*features.shape[1:]), ridge)


def cell_side(grid: Grid) -> int:
    """Canvas cells per cell of the filter."""
    return max(1, min(grid.rows, grid.columns) // CELLS)


def window_features(cells: Floats, grid: Grid) -> Floats:
    """Gradients [8, Y, X] of a window: without their mean, scaled to 1 where faded to the edges.

    Of the means of two by two canvas cells where those fill the filter's.
    """
    side = cell_side(grid)
    if side % 2 == 0 and cells.shape[0] % 2 == 0 and cells.shape[1] % 2 == 0:
        cells = (cells[::2, ::2] + cells[1::2, ::2] + cells[::2, 1::2] + cells[1::2, 1::2]) / 4
        side //= 2
    features = gradient_cells(cells, side, bilinear=True)
    _, rows, columns = features.shape
    features = features - features.mean(axis=(1, 2), keepdims=True)
    square = ((features * fade(rows, columns)) ** 2).mean()
    return features / np.sqrt(square + LEAST_SQUARE)


def fade(rows: int, columns: int) -> Floats:
    """A Hann window over two axes, [rows, columns]."""
    return filters.hann(rows)[:, None] * filters.hann(columns)


def fourier_series(spectrum: Spectrum, middle: float, margin: int, cell: int) -> Spectrum:
    """A signal along the first axis, [2 margin + 1, ...], up to a margin from middle, canvas cells.

    The highest of an even number of frequencies is its
    own negative: half of it turns one way, half the other.

    spectrum: [n, ...]. cell: canvas cells per cell of the signal.
    """
    count = len(spectrum)
    values = np.zeros((2 * margin + 1, *spectrum.shape[1:]), complex)
    frequencies = np.array([wrapped(k, count) for k in range(count)])
    for number in range(2 * margin + 1):
        at = (middle + number - margin) / cell
        waves = np.exp(2j * np.pi * frequencies * at / count) / count
        if count % 2 == 0:
            waves[count // 2] = waves[count // 2].real
        values[number] = waves @ spectrum
    return values


def wrapped(index: int, count: int) -> int:
    """The shift, or frequency, at an index of a discrete Fourier transform of this length."""
    return index if 2 * index < count else index - count
