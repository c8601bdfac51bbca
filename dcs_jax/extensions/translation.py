"""The translation filter: one more cue of where in the search window the object is.

A correlation filter on gradient cells. Its response is smooth where the votes of the classifiers
are not, so that the peak is found to a fraction of a cell. It sees several object sides around the
object, so that a fast one is found, but learns the object alone: it would stay with what it learned
of the surroundings while the object moves on.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Int32

from dcs_jax.config import Config, Grid, TranslationFilter
from dcs_jax.core.search import best_positions
from dcs_jax.core.window import Placed
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


def init(
    features: Float[Array, "8 Y X"], settings: TranslationFilter, grid: Grid
) -> TranslationState:
    """The filter after the first frame; features: of the window around the initial box."""
    trained = train(features, settings, grid)
    return TranslationState(trained, trained)


@jax.named_scope("translation")
def respond(
    state: TranslationState, features: Float[Array, "8 Y X"], settings: TranslationFilter
) -> Complex[Array, "Y half"]:
    """Spectrum of what the filter adds to the score: its response, weighted, [Y, X/2 + 1].

    The filter of the first frame has a share in it, against slow drift.

    features: of the window around the last box.
    """
    mixed = filters.interpolate(state.running, state.first_frame, settings.first_frame)
    weight = jnp.asarray(settings.weight, jnp.complex64)
    return weight * _response(mixed, features)


@jax.named_scope("translation")
def responses(
    state: TranslationState,
    features: Float[Array, "8 Y X"],
    displacement: Float[Array, "2"],
    grid: Grid,
) -> Float[Array, ""]:
    """Sum of the responses of the filter as it is and as of the first frame at a position: [].

    Each is near 1 where the window looks as it was learned, and near 0 elsewhere.

    features: of the window around the last box. displacement: [2] down and right from it, cells.
    """
    both = _response(state.running, features) + _response(state.first_frame, features)
    rows, columns = _shape(grid)
    down, right = displacement / _cell(grid)
    turn_down = _turns(down, np.fft.fftfreq(rows))
    turn_right = _turns(right, np.fft.rfftfreq(columns))
    turn_right *= jnp.asarray(_twice(np.fft.rfftfreq(columns)), jnp.complex64)
    return (both * turn_down[:, None] * turn_right[None]).real.sum() / (rows * columns)


@jax.named_scope("translation")
def search_middle(
    response: Complex[Array, "Y half"],
    placed: Placed,
    frame_shape: tuple[int, ...],
    config: Config,
    more: Callable[[Float[Array, " n"], Float[Array, " m"]], Float[Array, "n m"]] | None = None,
    turn: Float[Array, "2 2"] | None = None,
) -> Int32[Array, "2"]:
    """Where the filter says that the votes should be asked: [2] down and right, cells.

    The peak of its score and `more`, less the motion prior, from which the search window does not
    leave the one that the filter sees: a displacement of the search window from the last box.

    response: as of `respond`. placed: the last box. frame_shape: (H, W) or (H, W, 3).
    more: another cue's score at displacements down [n] and right [m], cells. turn: [2, 2], how the
    canvas is turned (`extensions.rotation`).
    """
    grid, searched, cell = config.grid, config.search_grid, _cell(config.grid)
    rows, columns = _shape(grid)
    limits = (
        (grid.margin_rows - searched.margin_rows) // cell,
        (grid.margin_columns - searched.margin_columns) // cell,
    )
    scores = jnp.fft.irfft2(response, s=(rows, columns))
    scores = jnp.roll(scores, limits, (0, 1))[: 2 * limits[0] + 1, : 2 * limits[1] + 1]
    down, right = (cell * jnp.arange(-limit, limit + 1, dtype=jnp.float32) for limit in limits)
    if more is not None:
        scores += more(down, right)
    down, right = down[:, None], right[None, :]
    _, _, nearest = best_positions(scores, down, right, placed, frame_shape, config, turn)
    row, column = jnp.divmod(nearest, scores.shape[1])
    return cell * jnp.stack([row - limits[0], column - limits[1]])


@jax.named_scope("translation")
def update(
    state: TranslationState,
    features: Float[Array, "8 Y X"],
    settings: TranslationFilter,
    grid: Grid,
) -> TranslationState:
    """The filter after one more frame; features: of the window around the new box."""
    trained = train(features, settings, grid)
    running = filters.interpolate(state.running, trained, settings.learning_rate)
    return state._replace(running=running)


@jax.named_scope("translation")
def features(window: Float[Array, "lines_y lines_x"], grid: Grid) -> Float[Array, "8 Y X"]:
    """What the filter sees of a window: its gradient cells less their mean, scaled, [8, Y, X].

    Of canvas cells two by two where that fills the filter's: it takes two thirds of the time.

    window: [G_y + 1, G_x + 1], integral image.
    """
    pixel = 1 if _cell(grid) % 2 or any(side % 2 for side in grid.window) else 2
    sums = jnp.diff(jnp.diff(window[::pixel, ::pixel], axis=0), axis=1)
    cells = gradient_cells(sums / pixel**2, _cell(grid) // pixel, bilinear=True)
    cells -= cells.mean((1, 2), keepdims=True)
    return cells / jnp.sqrt(jnp.square(cells * _fade(cells)).mean() + 1e-6)


def train(features: Float[Array, "8 Y X"], settings: TranslationFilter, grid: Grid) -> Filter:
    """The filter that responds in the middle of this window: [8, Y, X/2 + 1] and [Y, X/2 + 1]."""
    sides = (grid.rows, grid.columns)
    squares = [
        np.square(np.fft.fftfreq(count) * count * _cell(grid) / (side * _SIGMA))
        for count, side in zip(features.shape[1:], sides, strict=True)
    ]
    desired = np.fft.rfft2(np.exp(-0.5 * np.add.outer(*squares)))
    spectrum = jnp.fft.rfft2(features * _learned(features, settings, grid))
    return filters.train(spectrum, jnp.asarray(desired, jnp.complex64))


@jax.named_scope("translation")
def score(
    response: Complex[Array, "Y half"], middle: Int32[Array, "2"], config: Config
) -> Float[Array, "C_y C_x"]:
    """What the filter adds to the score map of the search window: [C_y, C_x].

    The filter has one value a cell; the positions between are values of the same Fourier series.

    response: as of `respond`. middle: [2], displacement of the search window from the last box, a
        whole number of the filter's cells.
    """
    rows, columns = _shape(config.grid)
    cell, (height, width) = _cell(config.grid), config.search_grid.positions
    frequencies = np.fft.fftfreq(rows), np.fft.rfftfreq(columns)
    down, right = (
        _waves(np.arange(-(count // 2), count // 2 + 1) / cell, waves)
        for count, waves in zip((height, width), frequencies, strict=True)
    )
    right *= _twice(frequencies[1])
    turn_down, turn_right = (
        _turns(cells, waves) for cells, waves in zip(middle // cell, frequencies, strict=True)
    )
    turned = response * turn_down[:, None] * turn_right[None]
    half = jnp.asarray(down, jnp.complex64) @ turned
    real = half.real @ jnp.asarray(right.real.T, jnp.float32)
    return (real - half.imag @ jnp.asarray(right.imag.T, jnp.float32)) / (rows * columns)


def _response(trained: Filter, features: Float[Array, "8 Y X"]) -> Complex[Array, "Y half"]:
    """Spectrum of a filter's response in a window."""
    ridge = _RIDGE * trained.denominator.mean() + _ROUNDING
    return filters.response(trained, jnp.fft.rfft2(features * _fade(features)), ridge)


def _cell(grid: Grid) -> int:
    """Canvas cells per cell of the filter."""
    return max(1, min(grid.rows, grid.columns) // _CELLS)


def spectrum_shape(grid: Grid) -> tuple[int, int]:
    """(Y, X/2 + 1) of the filter's spectra."""
    rows, columns = _shape(grid)
    return rows, columns // 2 + 1


def _shape(grid: Grid) -> tuple[int, int]:
    """Rows and columns of the filter: those of a window that do not fill a cell are cut off."""
    rows, columns = (side // _cell(grid) for side in grid.window)
    return rows, columns


def _fade(features: Float[Array, "8 Y X"]) -> Float[Array, "1 Y X"]:
    """What a window counts, less towards its edges, which are joined in the Fourier domain."""
    faded = np.multiply.outer(*map(filters.hann, features.shape[1:]))
    return jnp.asarray(faded, jnp.float32)[None]


def _learned(
    features: Float[Array, "8 Y X"], settings: TranslationFilter, grid: Grid
) -> Float[Array, "1 Y X"]:
    """What a window counts for the filter: a Hann window of `learned_factor` object sides."""

    def along(count: int, side: int) -> Float[Array, " count"]:
        away = (np.arange(count) - (count - 1) / 2) * _cell(grid) / side  # in object sides
        share = jnp.asarray(away, jnp.float32) / settings.learned_factor
        return jnp.square(jnp.cos(np.pi * jnp.clip(share, -0.5, 0.5)))

    _, rows, columns = features.shape
    learned = along(rows, grid.rows)[None, :, None] * along(columns, grid.columns)[None, None]
    return jnp.minimum(learned, _fade(features))


def _waves(line: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    """The waves of a Fourier series at positions on a line: [positions, frequencies]."""
    waves = np.exp(2j * np.pi * np.outer(line, frequencies))
    # The highest of an even number of frequencies is its own negative.
    return np.where(np.abs(frequencies) == 0.5, waves.real, waves)


def _twice(frequencies: np.ndarray) -> np.ndarray:
    """How often each counts: the half that a real signal does not need counts in the other."""
    return np.where((frequencies == 0) | (frequencies == 0.5), 1, 2)


def _turns(
    cells: Int32[Array, ""] | Float[Array, ""], frequencies: np.ndarray
) -> Complex[Array, " frequencies"]:
    """What moves a Fourier series back by so many cells: [frequencies]."""
    angles = cells.astype(jnp.float32) * jnp.asarray(2 * np.pi * frequencies, jnp.float32)
    # The highest of an even number of frequencies is its own negative.
    both_ways = jnp.asarray(np.abs(frequencies) == 0.5)
    return jax.lax.complex(jnp.cos(angles), jnp.where(both_ways, 0, jnp.sin(angles)))
