"""Gradients of a patch, gathered in cells: what the correlation filters and the appearance look at.

In the manner of histograms of oriented gradients (Dalal and Triggs, CVPR 2005).
"""

import functools

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

DIRECTIONS = 8
# Added to the square of a cell's gradient, so that noise on a plain surface counts for little.
_PLAIN = 1.0


def gradient_cells(
    grey: Float[Array, "lines_y lines_x"], cell: int, soft: bool = False
) -> Float[Array, "8 cells_y cells_x"]:
    """Gradient in each of 8 directions, summed over cells of cell x cell places: [8, Y, X].

    Each direction takes the part of the gradient that points its way, so nothing jumps as a
    gradient turns. Cells are divided by the root of their strength: an edge twice as strong counts
    1.4 times. What does not fill a cell is cut off on both sides alike.

    grey: [y, x], grey values. soft: whether a place counts for the two nearest cells, by how far
        its half of a cell is from their middles, which tells motion by part of a cell, or for its
        own cell only, which tells objects apart better.
    """
    rows, columns = (side // cell for side in grey.shape)
    top, left = ((side - side // cell * cell) // 2 for side in grey.shape)
    padded = jnp.pad(grey, 1, mode="edge")
    area = slice(top, top + rows * cell), slice(left, left + columns * cell)
    down = ((padded[2:, 1:-1] - padded[:-2, 1:-1]) / 2)[area]
    right = ((padded[1:-1, 2:] - padded[1:-1, :-2]) / 2)[area]
    angles = np.arange(DIRECTIONS) * 2 * np.pi / DIRECTIONS
    across, along = (
        jnp.asarray(part(angles), jnp.float32)[:, None, None] for part in (np.cos, np.sin)
    )
    strength = jnp.maximum(across * right + along * down, 0)
    # Rows that count alike are added one by one, the rest is products with constant matrices: a
    # third of the time of a sum over reshaped axes.
    alike = _alike(cell, soft)
    groups = strength.reshape(DIRECTIONS, -1, alike, columns * cell)
    cells = functools.reduce(jnp.add, (groups[:, :, row] for row in range(alike)))
    to_columns = jnp.asarray(_shares(columns, cell, soft).T, jnp.float32)
    cells = (cells.reshape(-1, columns * cell) @ to_columns).reshape(DIRECTIONS, -1, columns)
    if soft:
        to_rows = jnp.asarray(_shares(rows, cell, soft)[:, ::alike], jnp.float32)
        cells = jnp.einsum("rg,dgc->drc", to_rows, cells)
    return cells / jnp.sqrt(jnp.sqrt(jnp.square(cells).sum(0) + _PLAIN))


def _alike(cell: int, soft: bool) -> int:
    """How many places in a row count alike: a cell's, or with soft cells those of half of one."""
    if not soft:
        return cell
    return cell // 2 if cell % 2 == 0 else 1


def _shares(cells: int, cell: int, soft: bool) -> np.ndarray:
    """How much of each place counts for each cell: [cells, places]."""
    if not soft:
        return np.repeat(np.eye(cells), cell, axis=1)
    alike = _alike(cell, soft)
    middles = ((np.arange(cells * cell // alike) + 0.5) * alike / cell - 0.5).clip(0, cells - 1)
    away = np.abs(np.repeat(middles, alike) - np.arange(cells)[:, None])
    return np.maximum(1 - away, 0)
