"""The translation filter: one more cue of where in the search window the object is.

A correlation filter on gradient cells. Its response is smooth where the votes of the classifiers
are not, so that the peak is found to a fraction of a cell.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from dcs_jax.config import Grid, TranslationFilter
from dcs_jax.extensions import filters
from dcs_jax.extensions.gradients import gradient_cells
from dcs_jax.types import Filter, TranslationState

# Cells of the filter along the shorter side of the object.
_CELLS = 10
# Standard deviation of the desired output, in sides of the object.
_SIGMA = 1 / 16
# Ridge, as a share of the mean power.
_RIDGE = 0.01
# Added to it: a window of one colour has no power. No other one has less than some hundreds.
_ROUNDING = 1e-6


def init(spectrum: Complex[Array, "8 Y half"], grid: Grid) -> TranslationState:
    """The filter after the first frame; spectrum: of the window around the initial box."""
    trained = train(spectrum, grid)
    return TranslationState(trained, trained)


@jax.named_scope("translation")
def score(
    state: TranslationState,
    spectrum: Complex[Array, "8 Y half"],
    settings: TranslationFilter,
    grid: Grid,
) -> Float[Array, "C_y C_x"]:
    """What the filter adds to the score map: [C_y, C_x].

    The filter of the first frame has a share in it, against slow drift.

    spectrum: of the window that is searched.
    """
    mixed = filters.interpolate(state.running, state.first_frame, settings.first_frame)
    return settings.weight * response(mixed, spectrum, grid)


@jax.named_scope("translation")
def update(
    state: TranslationState,
    spectrum: Complex[Array, "8 Y half"],
    settings: TranslationFilter,
    grid: Grid,
) -> TranslationState:
    """The filter after one more frame; spectrum: of the window around the new box."""
    trained = train(spectrum, grid)
    running = filters.interpolate(state.running, trained, settings.learning_rate)
    return state._replace(running=running)


@jax.named_scope("translation")
def spectrum(window: Float[Array, "lines_y lines_x"], grid: Grid) -> Complex[Array, "8 Y half"]:
    """What the filter sees of a window: the spectrum of its gradient cells, [8, Y, X/2 + 1].

    window: [G_y + 1, G_x + 1], integral image.
    """
    return jnp.fft.rfft2(_features(window, grid))


def train(spectrum: Complex[Array, "8 Y half"], grid: Grid) -> Filter:
    """The filter that responds in the middle of this window: [8, Y, X/2 + 1] and [Y, X/2 + 1]."""
    sides = (grid.rows, grid.columns)
    squares = [
        np.square(np.fft.fftfreq(count) * count * _cell(grid) / (side * _SIGMA))
        for count, side in zip(_shape(grid), sides, strict=True)
    ]
    desired = np.fft.rfft2(np.exp(-0.5 * np.add.outer(*squares)))
    return filters.train(spectrum, jnp.asarray(desired, jnp.complex64))


def response(
    trained: Filter, spectrum: Complex[Array, "8 Y half"], grid: Grid
) -> Float[Array, "C_y C_x"]:
    """The filter's response at every candidate position, about 1 where it is sure: [C_y, C_x].

    The filter has one value a cell; the positions between are values of the same Fourier series.
    """
    rows, columns = _shape(grid)
    ridge = _RIDGE * trained.denominator.mean() + _ROUNDING
    found = filters.response(trained, spectrum, ridge)
    lines = [
        _displacements((positions - 1) // 2, _cell(grid), count)
        for positions, count in zip(grid.positions, (rows, columns), strict=True)
    ]
    down = _waves(lines[0], np.fft.fftfreq(rows))
    # The half of the frequencies that a real response does not need counts in the other.
    frequencies = np.fft.rfftfreq(columns)
    twice = np.where((frequencies == 0) | (frequencies == 0.5), 1, 2)
    right = _waves(lines[1], frequencies) * twice
    half = jnp.asarray(down, jnp.complex64) @ found
    real = half.real @ jnp.asarray(right.real.T, jnp.float32)
    return (real - half.imag @ jnp.asarray(right.imag.T, jnp.float32)) / (rows * columns)


def _cell(grid: Grid) -> int:
    """Canvas cells per cell of the filter."""
    return max(1, min(grid.rows, grid.columns) // _CELLS)


def _shape(grid: Grid) -> tuple[int, int]:
    """Rows and columns of the filter: those of a window that do not fill a cell are cut off."""
    rows, columns = (side // _cell(grid) for side in grid.window)
    return rows, columns


def _features(window: Float[Array, "lines_y lines_x"], grid: Grid) -> Float[Array, "8 Y X"]:
    """A window's gradient cells, faded out towards its edges: [8, Y, X]."""
    grey = jnp.diff(jnp.diff(window, axis=0), axis=1)
    cells = gradient_cells(grey, _cell(grid), bilinear=True)
    cells -= cells.mean((1, 2), keepdims=True)
    faded = np.multiply.outer(*map(filters.hann, cells.shape[1:]))
    cells *= jnp.asarray(faded, jnp.float32)[None]
    return cells / jnp.sqrt(jnp.square(cells).mean() + 1e-6)


def _displacements(margin: int, cell: int, cells: int) -> np.ndarray:
    """Candidate displacements in cells of the filter, none beyond the last: [2 margin + 1]."""
    return np.clip(np.arange(-margin, margin + 1) / cell, -(cells // 2), (cells - 1) // 2)


def _waves(line: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    """The waves of a Fourier series at positions on a line: [positions, frequencies]."""
    waves = np.exp(2j * np.pi * np.outer(line, frequencies))
    # The highest of an even number of frequencies is its own negative.
    return np.where(np.abs(frequencies) == 0.5, waves.real, waves)
