"""The translation filter: a correlation filter on the window's gradients, one more cue."""

from typing import NamedTuple

import numpy as np

from . import filters
from .filters import Filter, Spectrum
from .gradients import gradient_cells
from .records import Floats, Grid, TranslationFilter

CELLS = 10  # of the filter along the object's shorter side
SIGMA = 1 / 16  # of the desired output, in sides of the object
RIDGE = 0.01  # in means of the denominator
LEAST_SQUARE = 1e-6


class TranslationState(NamedTuple):
    """The filter's running mean, and the filter of the first frame."""

    running: Filter
    first_frame: Filter


def init(cells: Floats, grid: Grid) -> TranslationState:
    """The filter after the first frame; cells: [Gy, Gx], of the window around the initial box."""
    trained = train(cells, grid)
    return TranslationState(trained, trained)


def score(
    state: TranslationState, cells: Floats, settings: TranslationFilter, grid: Grid
) -> Floats:
    """What the filter adds to the score map, [Cy, Cx]: its weighted response."""
    mixed = filters.interpolate(state.running, state.first_frame, settings.first_frame)
    return settings.weight * response(mixed, cells, grid)


def update(
    state: TranslationState, cells: Floats, settings: TranslationFilter, grid: Grid
) -> TranslationState:
    """The filter after one more frame; cells: [Gy, Gx], of the window around the new box."""
    running = filters.interpolate(state.running, train(cells, grid), settings.learning_rate)
    return TranslationState(running, state.first_frame)


def train(cells: Floats, grid: Grid) -> Filter:
    """The filter [8, Y, X] that responds with a Gaussian around no displacement."""
    features = window_features(cells, grid)
    _, rows, columns = features.shape
    desired = np.zeros((rows, columns))
    for i in range(rows):
        for j in range(columns):
            down = wrapped(i, rows) * cell_side(grid) / (SIGMA * grid.rows)
            across = wrapped(j, columns) * cell_side(grid) / (SIGMA * grid.columns)
            desired[i, j] = np.exp(-(down**2 + across**2) / 2)
    return filters.train(features, desired)


def response(trained: Filter, cells: Floats, grid: Grid) -> Floats:
    """The response [Cy, Cx] at every candidate position: its Fourier series there."""
    spectrum = filters.response(
        trained, window_features(cells, grid), RIDGE * trained.denominator.mean()
    )
    down = fourier_series(spectrum, grid.margin_rows, cell_side(grid))
    return fourier_series(down.T, grid.margin_columns, cell_side(grid)).T.real


def cell_side(grid: Grid) -> int:
    """Canvas cells per cell of the filter."""
    return max(1, min(grid.rows, grid.columns) // CELLS)


def window_features(cells: Floats, grid: Grid) -> Floats:
    """Gradients [8, Y, X] of a window: without their mean, faded to the edges, scaled to 1."""
    features = gradient_cells(cells, cell_side(grid), bilinear=True)
    _, rows, columns = features.shape
    features = features - features.mean(axis=(1, 2), keepdims=True)
    features = features * filters.hann(rows)[:, None] * filters.hann(columns)
    return features / np.sqrt((features**2).mean() + LEAST_SQUARE)


def fourier_series(spectrum: Spectrum, margin: int, cell: int) -> Spectrum:
    """A signal along the first axis, [2 margin + 1, ...], at -margin .. margin canvas cells.

    No further than the signal's own last cell. The highest of an even number of frequencies is its
    own negative: half of it turns one way, half the other.

    spectrum: [n, ...]. cell: canvas cells per cell of the signal.
    """
    count = len(spectrum)
    values = np.zeros((2 * margin + 1, *spectrum.shape[1:]), complex)
    frequencies = np.array([wrapped(k, count) for k in range(count)])
    for number in range(2 * margin + 1):
        at = min(max((number - margin) / cell, -(count // 2)), (count - 1) // 2)
        waves = np.exp(2j * np.pi * frequencies * at / count) / count
        if count % 2 == 0:
            waves[count // 2] = waves[count // 2].real
        values[number] = waves @ spectrum
    return values


def wrapped(index: int, count: int) -> int:
    """The shift, or frequency, at an index of a discrete Fourier transform of this length."""
    return index if 2 * index < count else index - count
