"""Histograms of oriented gradients (HOG): features of the correlation filters and the templates.

N. Dalal and B. Triggs, Histograms of oriented gradients for human detection (CVPR 2005), with 8
signed orientations, and two differences. A gradient is not binned by its angle: it is projected on
every orientation, and negative projections are 0, so that no feature jumps as a gradient turns. A
cell is not normalised with the blocks around it, but divided by the root of its own norm: an edge
twice as strong counts 1.4 times.
"""

import functools

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

ORIENTATIONS = 8
# Added to the squared norm of a cell, so that noise on a plain surface counts for little.
_EPSILON = 1.0


def gradient_cells(
    grey: Float[Array, "height width"], cell: int, bilinear: bool = False
) -> Float[Array, "8 cells_y cells_x"]:
    """Gradient in each of 8 orientations, summed over cells of cell x cell pixels: [8, Y, X].

    grey: [y, x], grey values. Pixels that do not fill a cell are cut off, on both sides alike.
    bilinear: spatial binning. True: a pixel counts for the two nearest cells on each axis, by the
        distance of its half of a cell from their centres, which resolves motion by part of a cell.
        False: it counts for its own cell only, which tells objects apart better.
    """
    rows, columns = (side // cell for side in grey.shape)
    top, left = ((side - side // cell * cell) // 2 for side in grey.shape)
    padded = jnp.pad(grey, 1, mode="edge")
    area = slice(top, top + rows * cell), slice(left, left + columns * cell)
    down = ((padded[2:, 1:-1] - padded[:-2, 1:-1]) / 2)[area]
    right = ((padded[1:-1, 2:] - padded[1:-1, :-2]) / 2)[area]
    angles = np.arange(ORIENTATIONS) * 2 * np.pi / ORIENTATIONS
    cosine, sine = (
        jnp.asarray(part(angles), jnp.float32)[:, None, None] for part in (np.cos, np.sin)
    )
    projections = jnp.maximum(cosine * right[None] + sine * down[None], 0)
    # Rows of equal weight are added one by one, the rest is products with constant matrices: a
    # third of the time of a sum over reshaped axes.
    group = _pixels_of_equal_weight(cell, bilinear)
    groups = projections.reshape(ORIENTATIONS, -1, group, columns * cell)
    cells = functools.reduce(jnp.add, (groups[:, :, row] for row in range(group)))
    to_columns = jnp.asarray(_bin_weights(columns, cell, bilinear).T, jnp.float32)
    cells = (cells.reshape(-1, columns * cell) @ to_columns).reshape(ORIENTATIONS, -1, columns)
    if bilinear:
        to_rows = jnp.asarray(_bin_weights(rows, cell, bilinear)[:, ::group], jnp.float32)
        # o: orientations, g: groups of pixel rows, r and c: rows and columns of cells
        cells = jnp.einsum("rg,ogc->orc", to_rows, cells)
    return cells / jnp.sqrt(jnp.sqrt(jnp.square(cells).sum(0, keepdims=True) + _EPSILON))


def _pixels_of_equal_weight(cell: int, bilinear: bool) -> int:
    """Number of neighbours on an axis with equal bin weights: a cell's, bilinear half a cell's."""
    if not bilinear:
        return cell
    return cell // 2 if cell % 2 == 0 else 1


def _bin_weights(cells: int, cell: int, bilinear: bool) -> np.ndarray:
    """Weight of each pixel on an axis in each cell: [cells, pixels]."""
    if not bilinear:
        return np.repeat(np.eye(cells), cell, axis=1)
    group = _pixels_of_equal_weight(cell, bilinear)
    centres = ((np.arange(cells * cell // group) + 0.5) * group / cell - 0.5).clip(0, cells - 1)
    distances = np.abs(np.repeat(centres, group) - np.arange(cells)[:, None])
    return np.maximum(1 - distances, 0)
