"""The parts of the object and the Haar-like features on them."""

from typing import NamedTuple

import numpy as np

from .records import Floats, Grid, Integers


class Box(NamedTuple):
    """One box of a feature or one part of the object, in cells of the patch.

    weight: what the mean of its cells counts in the feature's value (1, -1 or -2; 1 for a part).
    """

    weight: int
    top: int
    left: int
    height: int
    width: int


def parts_of(rows: int, columns: int, parts: int) -> list[Box]:
    """The first `parts` (1, 5 or 9) parts l_k of an object of rows x columns cells.

    Whole, top, left, bottom, right, then the quadrants row by row. A half is floor(side / 2);
    bottom and right take the rest.
    """
    upper, left = rows // 2, columns // 2
    lower, right = rows - upper, columns - left
    return [
        Box(1, 0, 0, rows, columns),
        Box(1, 0, 0, upper, columns),
        Box(1, 0, 0, rows, left),
        Box(1, upper, 0, lower, columns),
        Box(1, 0, left, rows, right),
        Box(1, 0, 0, upper, left),
        Box(1, 0, left, upper, right),
        Box(1, upper, 0, lower, left),
        Box(1, upper, left, lower, right),
    ][:parts]


def haar_response(patch_integral: Floats, corners: Integers, weights: Floats) -> Floats:
    """Values of features on one patch, grey values.

    patch_integral: [Sy + 1, Sx + 1]. corners, weights: [9] or [F, 9]. Returns [] or [F].
    """
    return (weights * patch_integral.ravel()[corners]).sum(axis=-1)


def haar_map(window_integral: Floats, corners: Integers, weights: Floats, grid: Grid) -> Floats:
    """Value of one feature at every candidate position, [Cy, Cx].

    window_integral: [Gy + 1, Gx + 1]. corners, weights: [9], on a patch of the canvas.
    """
    rows, columns = grid.positions
    values = np.zeros(grid.positions)
    for corner, weight in zip(corners, weights, strict=True):
        i, j = divmod(int(corner), grid.columns + 1)
        values += weight * window_integral[i : i + rows, j : j + columns]
    return values


def cell_weights(corners: Integers, weights: Floats, canvas: tuple[int, int]) -> Floats:
    """What each cell of a patch counts in a feature: the value is (cell_weights * cells).sum().

    A corner (i, j) of the integral image is the sum of all cells above and left of it, so a cell
    counts with the weights of all corners below and right of it.

    corners, weights: [9]. canvas: Sy, Sx. Returns [Sy, Sx].
    """
    rows, columns = canvas
    corner_weights = np.zeros((rows + 1, columns + 1))
    for corner, weight in zip(corners, weights, strict=True):
        corner_weights[divmod(int(corner), columns + 1)] += weight
    from_the_end = corner_weights[::-1, ::-1].cumsum(axis=0).cumsum(axis=1)[::-1, ::-1]
    return from_the_end[1:, 1:]


def boxes_of(mask: Floats) -> list[Box]:
    """The boxes a feature with these cell weights compares, top-left first.

    mask: [Sy, Sx], from `cell_weights`. Raises ValueError where it is none of the five types with
    weight / area on every cell of a box.
    """
    rows, columns = np.nonzero(np.abs(mask) > 1e-3 * np.abs(mask).max())
    if rows.size == 0:
        raise ValueError("the feature has no boxes: all its cell weights are 0")
    top, left = int(rows.min()), int(columns.min())
    height, width = int(rows.max()) - top + 1, int(columns.max()) - left + 1
    for blocks_down, blocks_across, unit_boxes in _TYPES:
        if height % blocks_down or width % blocks_across:
            continue
        block_height, block_width = height // blocks_down, width // blocks_across
        boxes = [
            Box(
                unit.weight,
                top + unit.top * block_height,
                left + unit.left * block_width,
                unit.height * block_height,
                unit.width * block_width,
            )
            for unit in unit_boxes
        ]
        expected = np.zeros(mask.shape)
        for weight, y, x, h, w in boxes:
            expected[y : y + h, x : x + w] = weight / (h * w)
        if np.allclose(mask, expected, rtol=0, atol=1e-3 / (block_height * block_width)):
            return boxes
    raise ValueError("the cell weights are none of the five feature types")


# The five types: base blocks down and across, and the boxes in units of the base block.
_TYPES = (
    (2, 1, (Box(1, 0, 0, 1, 1), Box(-1, 1, 0, 1, 1))),
    (1, 2, (Box(1, 0, 0, 1, 1), Box(-1, 0, 1, 1, 1))),
    (4, 1, (Box(1, 0, 0, 1, 1), Box(-2, 1, 0, 2, 1), Box(1, 3, 0, 1, 1))),
    (1, 4, (Box(1, 0, 0, 1, 1), Box(-2, 0, 1, 1, 2), Box(1, 0, 3, 1, 1))),
    (2, 2, (Box(1, 0, 0, 1, 1), Box(-1, 0, 1, 1, 1), Box(-1, 1, 0, 1, 1), Box(1, 1, 1, 1, 1))),
)
