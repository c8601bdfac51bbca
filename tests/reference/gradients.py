"""Gradients in cells, and the description of a patch by them."""

import numpy as np

from .records import Floats, Grid

DIRECTIONS = 8
PLACES, CELL = 32, 4  # of a described patch
LEAST_SQUARE = 1e-6


def gradient_cells(grey: Floats, cell: int, soft: bool = False) -> Floats:
    """Parts of the gradient in 8 directions, summed in cells and divided by the root of strength.

    grey: [y, x], edges repeated. soft: every place counts for two cells on each axis. Returns
    [8, Y, X].
    """
    height, width = grey.shape
    rows, columns = height // cell, width // cell
    top, left = (height - rows * cell) // 2, (width - columns * cell) // 2
    sums = np.zeros((DIRECTIONS, rows, columns))
    angles = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    for y in range(rows * cell):
        for x in range(columns * cell):
            r, c = top + y, left + x
            down = (grey[min(r + 1, height - 1), c] - grey[max(r - 1, 0), c]) / 2
            right = (grey[r, min(c + 1, width - 1)] - grey[r, max(c - 1, 0)]) / 2
            along = np.maximum(right * np.cos(angles) + down * np.sin(angles), 0)
            for row, row_share in owners(y, cell, rows, soft):
                for column, column_share in owners(x, cell, columns, soft):
                    sums[:, row, column] += row_share * column_share * along
    strength = np.sqrt((sums**2).sum(axis=0) + 1)
    return sums / np.sqrt(strength)


def owners(place: int, cell: int, cells: int, soft: bool) -> list[tuple[int, float]]:
    """The cells a place on an axis counts for, and how much for each.

    soft: linear in the distance between the middle of a cell and the middle of the half cell that
    the place is in (with an odd number of places a cell, the place itself).
    """
    if not soft:
        return [(place // cell, 1.0)]
    half = cell // 2 if cell % 2 == 0 else 1
    middle = (place // half + 0.5) * half / cell - 0.5
    middle = min(max(middle, 0.0), cells - 1.0)
    before = int(middle)
    return [
        (before, 1 - (middle - before)),
        (min(before + 1, cells - 1), middle - before),
    ]


def describe(cells: Floats, displacement: Floats, factor: float, grid: Grid) -> Floats:
    """Unit vector [D] of the patch at a place, so many times as large as the object.

    cells: [Gy, Gx], of the window. displacement: [2] down and across from its middle, cells.
    Every one of 32 x 32 places is the mean of what it covers, 0 beyond the window.
    """
    shares = []
    for axis, side in enumerate((grid.rows, grid.columns)):
        length = cells.shape[axis]
        place = factor * side / PLACES
        start = length / 2 + displacement[axis] - factor * side / 2
        share = np.zeros((PLACES, length))
        for p in range(PLACES):
            low, high = start + p * place, start + (p + 1) * place
            for i in range(length):
                share[p, i] = max(0.0, min(high, i + 1) - max(low, i)) / place
        shares.append(share)
    vector = gradient_cells(shares[0] @ cells @ shares[1].T, CELL).ravel()
    vector = vector - vector.mean()
    return vector / np.sqrt((vector**2).sum() + LEAST_SQUARE)


def describe_sizes(
    cells: Floats, displacement: Floats, sizes: int, size_step: float, grid: Grid
) -> Floats:
    """`describe` in S sizes, [S, D]: powers of size_step, the middle one the object's own."""
    powers = range(-(sizes // 2), sizes // 2 + 1)
    return np.stack([describe(cells, displacement, size_step**p, grid) for p in powers])


def similarity(first: Floats, recent: Floats, description: Floats, penalty: float) -> float:
    """Cosine to the first description, or that to the recent one less a penalty if larger."""
    to_recent = recent @ description / np.sqrt(recent @ recent + LEAST_SQUARE)
    return max(float(first @ description), float(to_recent - penalty))


def confidence(alike: float, middle: float, slope: float) -> float:
    """Logistic function of the similarity."""
    return float(1 / (1 + np.exp(-slope * (alike - middle))))
