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
from dcs_jax.core.gradients import gradient_cells
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
    """The filter that answers at the middle of this window: [8, Y, X] and [Y, X].

    integral: [G_y + 1, G_x + 1], of the window around the object.
    """
    spectrum = _window_spectrum(integral, grid)
    sides = (grid.rows, grid.columns)
    squares = [
        np.square(np.fft.fftfreq(cells) * cells * _place_cell(grid) / (side * _PLACE_SIGMA))
        for cells, side in zip(spectrum.shape[1:], sides, strict=True)
    ]
    return _learn(spectrum, np.exp(-0.5 * np.add.outer(*squares)))


def place_answer(
    place: Filter, integral: Float[Array, "lines_y lines_x"], grid: Grid
) -> Float[Array, "C_y C_x"]:
    """The filter's answer at every candidate place, about 1 where it is sure: [C_y, C_x].

    integral: [G_y + 1, G_x + 1], of a window. The answer has one value a cell of the filter; those
    of the places between are interpolated by cubic convolution (Keys, 1981).
    """
    spectrum = _window_spectrum(integral, grid)
    ridge = _PLACE_RIDGE * place.denominator.mean()
    answer = (place.numerator * spectrum).sum(0) / (place.denominator + ridge).astype(
        spectrum.dtype
    )
    answer = jnp.fft.ifft2(answer).real
    cell = _place_cell(grid)
    rows, columns = (
        jnp.asarray(_cubic((positions - 1) // 2, cell, cells), jnp.float32)
        for positions, cells in zip(grid.positions, answer.shape, strict=True)
    )
    return rows @ jnp.fft.fftshift(answer) @ columns.T


def learn_size(descriptions: Float[Array, "S D"]) -> Filter:
    """The filter that answers at the middle of these sizes: [D, S] and [S].

    descriptions: [S, D], of the object's patch in S sizes, the middle one its own.
    """
    sizes = len(descriptions)
    steps = np.arange(sizes) - sizes // 2
    wanted = np.exp(-0.5 * np.square(steps / (_SIZE_SIGMA * np.sqrt(sizes))))
    return _learn(_size_spectrum(descriptions), wanted)


def size_steps(size: Filter, descriptions: Float[Array, "S D"]) -> Float[Array, ""]:
    """By how many steps the object has grown: [], between -S/2 and S/2, by a parabola's peak."""
    spectrum = _size_spectrum(descriptions)
    power = (size.denominator + _SIZE_RIDGE).astype(spectrum.dtype)
    ratio = (size.numerator * spectrum).sum(0) / power
    answer = jnp.fft.ifft(ratio).real
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


def _learn(spectrum: Complex[Array, "D *frequencies"], wanted: np.ndarray) -> Filter:
    answer = jnp.asarray(np.fft.fftn(wanted), jnp.complex64)
    power = jnp.square(spectrum.real) + jnp.square(spectrum.imag)
    return Filter(answer * spectrum.conj(), power.sum(0))


def _place_cell(grid: Grid) -> int:
    """Canvas cells per cell of the place filter."""
    return max(1, min(grid.rows, grid.columns) // _CELLS)


def _window_spectrum(
    integral: Float[Array, "lines_y lines_x"], grid: Grid
) -> Complex[Array, "8 Y X"]:
    """Spectrum of a window's gradient cells, faded out towards its edges: [8, Y, X]."""
    cells = gradient_cells(jnp.diff(jnp.diff(integral, axis=0), axis=1), _place_cell(grid))
    cells -= cells.mean((1, 2), keepdims=True)
    cells *= jnp.asarray(np.multiply.outer(*map(_fade, cells.shape[1:])), jnp.float32)
    return jnp.fft.fft2(cells / jnp.sqrt(jnp.square(cells).mean() + 1e-6))


def _size_spectrum(descriptions: Float[Array, "S D"]) -> Complex[Array, "D S"]:
    """Spectrum of the descriptions over the sizes, faded out towards both ends: [D, S]."""
    fade = jnp.asarray(_fade(len(descriptions)), jnp.float32)
    return jnp.fft.fft((descriptions * fade[:, None]).T)


def _fade(places: int) -> np.ndarray:
    """Hann window without its zeros: [places]."""
    return np.hanning(places + 2)[1:-1]


def _cubic(margin: int, cell: int, cells: int) -> np.ndarray:
    """Weights [2 margin + 1, cells] of a row of cells at displacements from its middle cell."""
    line = np.clip(np.arange(-margin, margin + 1) / cell + cells // 2, 0, cells - 1)
    away = np.abs(line[:, None] - np.arange(cells))
    near = 1.5 * away**3 - 2.5 * away**2 + 1
    far = -0.5 * away**3 + 2.5 * away**2 - 4 * away + 2
    return np.where(away <= 1, near, np.where(away < 2, far, 0))
