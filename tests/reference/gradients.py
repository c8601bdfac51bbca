"""Histograms of oriented gradients (Dalal and Triggs, CVPR 2005), by projection."""

import numpy as np

from .records import Floats

ORIENTATIONS = 8
EPSILON = 1.0


def gradient_cells(grey: Floats, cell: int, bilinear: bool = False) -> Floats:
    """Projections of the gradient on 8 orientations, summed in cells: [8, Y, X].

    Negative projections are 0. A cell is divided by the fourth root of its squared norm plus 1.
    Pixels that do not fill a cell are cut off, on both sides alike.

    grey: [y, x], edges repeated. bilinear: every pixel counts for two cells on each axis.
    """
    height, width = grey.shape
    rows, columns = height // cell, width // cell
    top, left = (height - rows * cell) // 2, (width - columns * cell) // 2
    padded = np.pad(grey, 1, mode="edge")
    down = (padded[2:, 1:-1] - padded[:-2, 1:-1]) / 2
    right = (padded[1:-1, 2:] - padded[1:-1, :-2]) / 2
    of_rows = bin_weights(rows, cell, bilinear)
    of_columns = bin_weights(columns, cell, bilinear)
    sums = np.zeros((ORIENTATIONS, rows, columns))
    for o in range(ORIENTATIONS):
        angle = 2 * np.pi * o / ORIENTATIONS
        projection = np.maximum(right * np.cos(angle) + down * np.sin(angle), 0)
        inside = projection[top : top + rows * cell, left : left + columns * cell]
        sums[o] = of_rows @ inside @ of_columns.T
    return sums / ((sums**2).sum(axis=0) + EPSILON) ** (1 / 4)


def bin_weights(cells: int, cell: int, bilinear: bool) -> Floats:
    """How much each pixel on an axis counts for each cell: [cells, pixels].

    bilinear: linear in the distance between the centre of a cell and the centre of the half cell
    that the pixel is in (with an odd number of pixels a cell, of the pixel itself); all for the
    first or last cell beyond its centre.
    """
    weights = np.zeros((cells, cells * cell))
    half = cell // 2 if cell % 2 == 0 else 1
    for pixel in range(cells * cell):
        if bilinear:
            centre = (pixel // half + 0.5) * half / cell - 0.5
            centre = min(max(centre, 0.0), cells - 1.0)
            before = int(centre)
            weights[before, pixel] += 1 - (centre - before)
            weights[min(before + 1, cells - 1), pixel] += centre - before
        else:
            weights[pixel // cell, pixel] = 1
    return weights
