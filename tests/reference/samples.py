"""The training samples of a frame, and the positions the object can reach."""

import math

import numpy as np

from .haar import haar_response
from .records import Floats, Grid, Pool, Settings
from .window import integral, shown_box

LABELS = np.array([1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, -1.0])


def reachable(
    box: Floats, frame_shape: tuple[int, ...], settings: Settings
) -> tuple[tuple[int, int], tuple[int, int]]:
    """Lowest and highest reachable position per axis, ((low_y, high_y), (low_x, high_x)).

    Positions are in cells from the middle of the map, so low <= 0 <= high.

    box: [4], x, y, w, h, pixels. frame_shape: H, W.
    """
    grid, overhang = settings.grid, settings.overhang
    x, y, width, height = (float(number) for number in box)
    _, _, shown_width, shown_height = shown_box(box, settings)
    cell_height, cell_width = shown_height / grid.rows, shown_width / grid.columns
    return (
        _reachable_axis(y, height, frame_shape[0], cell_height, grid.margin_rows, overhang),
        _reachable_axis(x, width, frame_shape[1], cell_width, grid.margin_columns, overhang),
    )


def training_positions(
    box: Floats, frame_shape: tuple[int, ...], settings: Settings
) -> list[tuple[int, int]]:
    """The positions (y, x) of the L training samples, cells from the middle; labels are `LABELS`.

    The tracked box four times, then the corners of the reachable window row by row.
    """
    (low_y, high_y), (low_x, high_x) = reachable(box, frame_shape, settings)
    corners = [(low_y, low_x), (low_y, high_x), (high_y, low_x), (high_y, high_x)]
    return [(0, 0)] * 4 + corners


def training_responses(
    cells: Floats, positions: list[tuple[int, int]], pool: Pool, grid: Grid
) -> Floats:
    """Values [F, L] of all features on the training samples.

    cells: [Gy, Gx], of the window. positions: L of them, from `training_positions`.
    """
    columns = []
    for y, x in positions:
        top, left = grid.margin_rows + y, grid.margin_columns + x
        patch = cells[top : top + grid.rows, left : left + grid.columns]
        columns.append(haar_response(integral(patch), pool.corners, pool.weights))
    return np.stack(columns, axis=1)


def _reachable_axis(
    start: float, side: float, frame_side: int, cell: float, margin: int, overhang: float
) -> tuple[int, int]:
    """Lowest and highest position along one axis at which the object stays in the frame, cells."""
    beyond = overhang * side
    low = math.ceil((-start - beyond) / cell - 1e-3)
    high = math.floor((frame_side - side - start + beyond) / cell + 1e-3)
    return min(max(low, -margin), 0), min(max(high, 0), margin)
