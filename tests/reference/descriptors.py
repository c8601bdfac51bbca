"""A patch of the window as a unit vector of its gradients."""

import numpy as np

from .gradients import gradient_cells
from .records import Floats, Grid

SIDE, CELL = 32, 4  # of a patch and of its cells, pixels
LEAST_SQUARE = 1e-6


def describe(
    cells: Floats, displacement: Floats, factor: float, grid: Grid, taller: float = 1.0
) -> Floats:
    """Unit vector [D] of the patch at a position, so many times as large as the object.

    Each of 32 x 32 pixels is the mean of the cells it covers; beyond the window they are 0.

    cells: [Gy, Gx], of the window. displacement: [2], down and across from its middle, cells.
    taller: aspect ratio of the patch, height over width, relative to the object's; the area is the
    same.
    """
    root = np.sqrt(taller)
    down = overlaps(grid.rows * factor * root, displacement[0], cells.shape[0])
    across = overlaps(grid.columns * factor / root, displacement[1], cells.shape[1])
    return describe_patch(down @ cells @ across.T)


def describe_patch(patch: Floats) -> Floats:
    """Unit vector [D] of a patch of 32 x 32 pixels."""
    gradients = gradient_cells(patch, CELL)
    vector = np.concatenate([cells.ravel() - cells.mean() for cells in gradients])
    return vector / np.sqrt((vector**2).sum() + LEAST_SQUARE)


def describe_scales(
    cells: Floats, displacement: Floats, factors: list[float], grid: Grid
) -> Floats:
    """`describe` at S scales, [S, D]."""
    return np.stack([describe(cells, displacement, factor, grid) for factor in factors])


def overlaps(side: float, displacement: float, length: int) -> Floats:
    """Share of each of 32 pixels on an axis that each cell covers, [32, length].

    side: of the patch, cells. displacement: of its middle from that of the window. length: cells.
    """
    pixel = side / SIDE
    low = length / 2 + displacement - side / 2 + np.arange(SIDE)[:, None] * pixel
    cell = np.arange(length)
    shared = np.minimum(low + pixel, cell + 1) - np.maximum(low, cell)
    return np.maximum(shared, 0) / pixel
