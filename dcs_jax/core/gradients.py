"""Gradients of a patch, gathered in cells: what the correlation filters and the appearance look at.

In the manner of histograms of oriented gradients (Dalal and Triggs, CVPR 2005).
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

DIRECTIONS = 8
# Added to the square of a cell's gradient, so that noise on a plain surface counts for little.
_PLAIN = 1.0


def gradient_cells(
    grey: Float[Array, "lines_y lines_x"], cell: int
) -> Float[Array, "8 cells_y cells_x"]:
    """Gradient in each of 8 directions, summed over cells of cell x cell places: [8, Y, X].

    Each direction takes the part of the gradient that points its way, so nothing jumps as a
    gradient turns. Cells are divided by the root of their strength: an edge twice as strong counts
    1.4 times. What does not fill a cell is cut off on both sides alike.

    grey: [y, x], grey values.
    """
    rows, columns = (side // cell for side in grey.shape)
    top, left = ((side - side // cell * cell) // 2 for side in grey.shape)
    padded = jnp.pad(grey, 1, mode="edge")
    area = slice(top, top + rows * cell), slice(left, left + columns * cell)
    down = ((padded[2:, 1:-1] - padded[:-2, 1:-1]) / 2)[area]
    right = ((padded[1:-1, 2:] - padded[1:-1, :-2]) / 2)[area]
    angles = np.arange(DIRECTIONS) * 2 * np.pi / DIRECTIONS
    cells = jnp.stack(
        [
            jnp.maximum(float(np.cos(angle)) * right + float(np.sin(angle)) * down, 0)
            .reshape(rows, cell, columns, cell)
            .sum((1, 3))
            for angle in angles
        ]
    )
    return cells / jnp.sqrt(jnp.sqrt(jnp.square(cells).sum(0) + _PLAIN))
