"""Correlation filters for place and size (Danelljan et al., BMVC 2014)."""

import numpy as np
from numpy.typing import NDArray

from .gradients import gradient_cells
from .records import Floats, Grid

Filter = tuple[NDArray[np.complex128], Floats]  # numerator [D, ...] and denominator [...]

RIDGE = 0.01
LEAST_SQUARE = 1e-6


def hann(places: int) -> Floats:
    """A Hann window of so many places, all above 0."""
    return np.array([np.sin(np.pi * (i + 1) / (places + 1)) ** 2 for i in range(places)])


def place_cell(grid: Grid) -> int:
    """Canvas cells per cell of the filter: 10 cells along the object's shorter side."""
    return max(1, min(grid.rows, grid.columns) // 10)


def window_features(cells: Floats, grid: Grid) -> Floats:
    """Gradient cells [8, Y, X] without their mean, faded to the edges, of unit mean square."""
    features = gradient_cells(cells, place_cell(grid), soft=True)
    _, rows, columns = features.shape
    features = features - features.mean(axis=(1, 2), keepdims=True)
    features = features * hann(rows)[:, None] * hann(columns)
    return features / np.sqrt((features**2).mean() + LEAST_SQUARE)


def train(features: Floats, wanted: Floats) -> Filter:
    """The filter of one example. features: [D, ...]. wanted: [...], its peak at index 0."""
    axes = tuple(range(1, features.ndim))
    spectrum = np.fft.fftn(features, axes=axes)
    return np.fft.fftn(wanted) * spectrum.conj(), (np.abs(spectrum) ** 2).sum(axis=0)


def learn_place(cells: Floats, grid: Grid) -> Filter:
    """The filter that answers with a Gaussian, 1/16 of the object wide, at no displacement."""
    features = window_features(cells, grid)
    _, rows, columns = features.shape
    cell = place_cell(grid)
    wanted = np.zeros((rows, columns))
    for i in range(rows):
        for j in range(columns):
            down = (i if i < (rows + 1) // 2 else i - rows) * cell / (grid.rows / 16)
            across = (j if j < (columns + 1) // 2 else j - columns) * cell / (grid.columns / 16)
            wanted[i, j] = np.exp(-(down**2 + across**2) / 2)
    return train(features, wanted)


def place_answer(place: Filter, cells: Floats, grid: Grid) -> Floats:
    """Answer [Cy, Cx] at all candidate places: the Fourier series of the filter's answer there."""
    numerator, denominator = place
    spectrum = np.fft.fft2(window_features(cells, grid))
    ratio = (numerator * spectrum).sum(axis=0) / (denominator + RIDGE * denominator.mean())
    waves = []
    for margin, count in zip((grid.margin_rows, grid.margin_columns), ratio.shape, strict=True):
        axis = np.zeros((2 * margin + 1, count), complex)
        for number in range(2 * margin + 1):
            at = (number - margin) / place_cell(grid)
            at = min(max(at, -(count // 2)), (count - 1) // 2)
            for k in range(count):
                frequency = k if k < (count + 1) // 2 else k - count
                wave = np.exp(2j * np.pi * frequency * at / count) / count
                axis[number, k] = wave.real if 2 * abs(frequency) == count else wave
        waves.append(axis)
    return (waves[0] @ ratio @ waves[1].T).real


def learn_size(descriptions: Floats) -> Filter:
    """The filter [D, S] that answers with a Gaussian over the sizes at the middle one."""
    count = len(descriptions)
    steps = np.arange(count) - count // 2
    wanted = np.exp(-(steps**2) / (2 * (count / 16)))
    return train((descriptions * hann(count)[:, None]).T, wanted)


def size_steps(size: Filter, descriptions: Floats) -> float:
    """By how many steps the object has grown."""
    numerator, denominator = size
    count = len(descriptions)
    spectrum = np.fft.fft((descriptions * hann(count)[:, None]).T)
    answer = np.fft.ifft((numerator * spectrum).sum(axis=0) / (denominator + RIDGE)).real
    best = 1 + int(np.argmax(answer[1:-1]))
    return best - count // 2 + parabola_peak(*answer[best - 1 : best + 2])


def parabola_peak(before: float, here: float, after: float) -> float:
    """Where the parabola through the values at -1, 0, 1 has its peak, at most 1/2 away."""
    if not np.isfinite([before, here, after]).all() or before + after >= 2 * here:
        return 0.0
    square, linear = (before + after) / 2 - here, (after - before) / 2
    return float(min(max(-linear / (2 * square), -0.5), 0.5))


def blend(old: Filter, new: Filter, rate: float) -> Filter:
    """The running mean of two filters."""
    return (1 - rate) * old[0] + rate * new[0], (1 - rate) * old[1] + rate * new[1]
