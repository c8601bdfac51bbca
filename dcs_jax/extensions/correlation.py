"""Correlation filters: where in the window is the object, and how large is it?

Ridge regression over all shifts at once, in the Fourier domain: of the window's gradient cells over
two axes for the place, of the object's descriptions over the axis of sizes for its size (Danelljan
et al., "Accurate scale estimation for robust visual tracking", BMVC 2014).
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from dcs_jax.config import Grid
from dcs_jax.extensions.gradients import gradient_cells
from dcs_jax.types import Filter

# Cells of the place filter along the shorter side of the object.
_CELLS = 10
# Standard deviation of the wanted answer: of the place in sides of the object, of the size as a
# share of the root of the number of sizes (Danelljan et al.).
_PLACE_SIGMA, _SIZE_SIGMA = 1 / 16, 0.25
# Ridge, so that noise in the weak frequencies does not answer: of the place as a share of the mean
# power; of the size as it is, since descriptions are unit vectors.
_PLACE_RIDGE, _SIZE_RIDGE = 0.01, 0.01


def blend(old: Filter, new: Filter, rate: float | Float[Array, ""]) -> Filter:
    """The running mean of a filter after one more frame."""
    return jax.tree.map(
        lambda last, now: last + jnp.asarray(rate, last.dtype) * (now - last), old, new
    )


def learn_place(integral: Float[Array, "lines_y lines_x"], grid: Grid) -> Filter:
    """The filter that answers at the middle of this window: [8, Y, X/2 + 1] and [Y, X/2 + 1].

    integral: [G_y + 1, G_x + 1], of the window around the object.
    """
    cells = _window_cells(integral, grid)
    sides = (grid.rows, grid.columns)
    squares = [
        np.square(np.fft.fftfreq(count) * count * _place_cell(grid) / (side * _PLACE_SIGMA))
        for count, side in zip(cells.shape[1:], sides, strict=True)
    ]
    wanted = np.fft.rfft2(np.exp(-0.5 * np.add.outer(*squares)))
    return _learn(jnp.fft.rfft2(cells), jnp.asarray(wanted, jnp.complex64))


def place_answer(
    place: Filter, integral: Float[Array, "lines_y lines_x"], grid: Grid
) -> Float[Array, "C_y C_x"]:
    """The filter's answer at every candidate place, about 1 where it is sure: [C_y, C_x].

    integral: [G_y + 1, G_x + 1], of a window. The answer has one value a cell of the filter; the
    places between are values of the same Fourier series.
    """
    cells = _window_cells(integral, grid)
    ridge = _PLACE_RIDGE * place.denominator.mean()
    spectrum = (place.numerator * jnp.fft.rfft2(cells)).sum(0) / (place.denominator + ridge).astype(
        jnp.complex64
    )
    lines = [
        _line((positions - 1) // 2, _place_cell(grid), count)
        for positions, count in zip(grid.positions, cells.shape[1:], strict=True)
    ]
    rows, columns = cells.shape[1:]
    down = _waves(lines[0], np.fft.fftfreq(rows))
    # The half of the frequencies that a real answer does not need counts in the other.
    frequencies = np.fft.rfftfreq(columns)
    twice = np.where((frequencies == 0) | (frequencies == 0.5), 1, 2)
    right = _waves(lines[1], frequencies) * twice
    half = jnp.asarray(down, jnp.complex64) @ spectrum
    real = half.real @ jnp.asarray(right.real.T, jnp.float32)
    return (real - half.imag @ jnp.asarray(right.imag.T, jnp.float32)) / (rows * columns)


def learn_size(descriptions: Float[Array, "S D"]) -> Filter:
    """The filter that answers at the middle of these sizes: [D, S/2 + 1] and [S/2 + 1].

    descriptions: [S, D], of the object's patch in S sizes, the middle one its own.
    """
    sizes = len(descriptions)
    steps = np.arange(sizes) - sizes // 2
    wanted = np.fft.rfft(np.exp(-0.5 * np.square(steps / (_SIZE_SIGMA * np.sqrt(sizes)))))
    return _learn(_size_spectrum(descriptions), jnp.asarray(wanted, jnp.complex64))


def size_steps(size: Filter, descriptions: Float[Array, "S D"]) -> Float[Array, ""]:
    """By how many steps the object has grown: [], between -S/2 and S/2, by a parabola's peak."""
    power = (size.denominator + _SIZE_RIDGE).astype(size.numerator.dtype)
    ratio = (size.numerator * _size_spectrum(descriptions)).sum(0) / power
    answer = jnp.fft.irfft(ratio, len(descriptions))
    best = jnp.argmax(answer[1:-1]) + 1
    offset = parabola_peak(answer[best - 1], answer[best], answer[best + 1])
    return best.astype(jnp.float32) - len(descriptions) // 2 + offset


def parabola_peak(
    before: Float[Array, ""], here: Float[Array, ""], after: Float[Array, ""]
) -> Float[Array, ""]:
    """Where a parabola through three neighbouring values has its peak: [] in [-0.5, 0.5]."""
    curvature = before - 2 * here + after
    # At the edge of what is allowed there is a neighbour less: -inf.
    peaked = (curvature < 0) & jnp.isfinite(curvature)
    return jnp.where(
        peaked, jnp.clip((before - after) / (2 * jnp.where(peaked, curvature, 1)), -0.5, 0.5), 0
    )


def _learn(
    spectrum: Complex[Array, "D *frequencies"], wanted: Complex[Array, "*frequencies"]
) -> Filter:
    power = jnp.square(spectrum.real) + jnp.square(spectrum.imag)
    return Filter(wanted * spectrum.conj(), power.sum(0))


def _place_cell(grid: Grid) -> int:
    """Canvas cells per cell of the place filter."""
    return max(1, min(grid.rows, grid.columns) // _CELLS)


def _window_cells(integral: Float[Array, "lines_y lines_x"], grid: Grid) -> Float[Array, "8 Y X"]:
    """A window's gradient cells, faded out towards its edges: [8, Y, X]."""
    grey = jnp.diff(jnp.diff(integral, axis=0), axis=1)
    cells = gradient_cells(grey, _place_cell(grid), bilinear=True)
    cells -= cells.mean((1, 2), keepdims=True)
    cells *= jnp.asarray(np.multiply.outer(*map(_fade, cells.shape[1:])), jnp.float32)
    return cells / jnp.sqrt(jnp.square(cells).mean() + 1e-6)


def _size_spectrum(descriptions: Float[Array, "S D"]) -> Complex[Array, "D half"]:
    """Spectrum of the descriptions over the sizes, faded out towards both ends: [D, S/2 + 1]."""
    fade = jnp.asarray(_fade(len(descriptions)), jnp.float32)
    return jnp.fft.rfft((descriptions * fade[:, None]).T)


def _fade(places: int) -> np.ndarray:
    """Hann window without its zeros: [places]."""
    return np.hanning(places + 2)[1:-1]


def _line(margin: int, cell: int, cells: int) -> np.ndarray:
    """Candidate displacements in cells of the filter, none beyond the last: [2 margin + 1]."""
    return np.clip(np.arange(-margin, margin + 1) / cell, -(cells // 2), (cells - 1) // 2)


def _waves(line: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    """The waves of a Fourier series at places on a line: [places, frequencies]."""
    waves = np.exp(2j * np.pi * np.outer(line, frequencies))
    # The highest of an even number of frequencies is its own negative.
    return np.where(np.abs(frequencies) == 0.5, waves.real, waves)
