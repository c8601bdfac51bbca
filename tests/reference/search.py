"""From the score map to the new box (Algorithm 1, lines 1-3)."""

import numpy as np
from scipy import ndimage

from .records import Floats, Grid, Integers, Settings
from .window import cell_aspect, shown_box, turned

PLATEAU = 1e-3  # scores this close to the highest belong to the peak


HERE = np.zeros(2, np.int64)  # the search window is around the last box


def squared_distances(box: Floats, settings: Settings, middle: Integers = HERE) -> Floats:
    """Squared distance d^2 of every position from the last one, [Cy, Cx], pixels squared.

    middle: [2], displacement of the search window from the last box (down, across), cells.
    """
    grid = settings.search_grid
    _, _, width, height = shown_box(box, settings)
    distances = np.zeros(grid.positions)
    for i in range(grid.positions[0]):
        for j in range(grid.positions[1]):
            down = (middle[0] + i - grid.margin_rows) * height / grid.rows
            across = (middle[1] + j - grid.margin_columns) * width / grid.columns
            distances[i, j] = down**2 + across**2
    return distances


def with_motion_prior(
    score_map: Floats,
    box: Floats,
    reach: tuple[tuple[int, int], tuple[int, int]],
    settings: Settings,
    middle: Integers = HERE,
    angle: float = 0.0,
) -> Floats:
    """The score map less prior * d^2 / (w h), minus infinity where the object cannot be.

    score_map: [Cy, Cx]. box: [4], the last one. reach: from `reachable`. middle: [2], see
    `squared_distances`. angle: by which the canvas is turned. Returns [Cy, Cx].
    """
    _, _, width, height = box
    grid, distances = settings.search_grid, squared_distances(box, settings, middle)
    scores = score_map - settings.prior * distances / (width * height)
    (low_y, high_y), (low_x, high_x) = reach
    for i in range(grid.positions[0]):
        for j in range(grid.positions[1]):
            on_canvas = middle + np.array([i - grid.margin_rows, j - grid.margin_columns])
            y, x = turned(on_canvas, angle, cell_aspect(box, settings))
            if not (low_y <= y <= high_y and low_x <= x <= high_x):
                scores[i, j] = -np.inf
    return scores


def peak(scores: Floats, distances: Floats, subcell: bool = False) -> Floats:
    """Displacement [2] (down, across) of the peak from the middle of the map, cells.

    Of the positions within 1e-3 of the highest score take the one nearest to the last, and with
    it all those connected to it, also diagonally: the centroid of this plateau.

    scores: [Cy, Cx], from `with_motion_prior`. distances: [Cy, Cx], from `squared_distances`.
    subcell: move a plateau of one position, along each axis, to the peak of a parabola.
    """
    high = scores >= scores.max() - PLATEAU
    nearest = np.unravel_index(np.argmin(np.where(high, distances, np.inf)), high.shape)
    plateaus, _ = ndimage.label(high, structure=np.ones((3, 3)))
    members = np.argwhere(plateaus == plateaus[nearest])
    middle = (np.array(scores.shape) - 1) / 2
    found = members.mean(axis=0) - middle
    if subcell and len(members) == 1:
        i, j = (int(index) + 1 for index in members[0])
        around = np.pad(scores, 1, constant_values=-np.inf)
        found[0] += parabola_peak(around[i - 1, j], around[i, j], around[i + 1, j])
        found[1] += parabola_peak(around[i, j - 1], around[i, j], around[i, j + 1])
    return found


def parabola_peak(before: float, here: float, after: float) -> float:
    """Where the parabola through the values at -1, 0, 1 has its peak, at most 1/2 away."""
    if not np.isfinite([before, here, after]).all() or before + after >= 2 * here:
        return 0.0
    square, linear = (before + after) / 2 - here, (after - before) / 2
    return float(min(max(-linear / (2 * square), -0.5), 0.5))


def move(
    box: Floats,
    displacement: Floats,
    frame_shape: tuple[int, ...],
    settings: Settings,
    angle: float = 0.0,
) -> Floats:
    """The box [4] moved by so many cells (down, across) of a canvas that is turned by an angle.

    Its centre is clipped into the frame.
    """
    displacement = turned(displacement, angle, cell_aspect(box, settings))
    x, y, width, height = box
    _, _, shown_width, shown_height = shown_box(box, settings)
    centre_x = x + displacement[1] * shown_width / settings.grid.columns + width / 2
    centre_y = y + displacement[0] * shown_height / settings.grid.rows + height / 2
    centre_x = min(max(centre_x, 0), frame_shape[1])
    centre_y = min(max(centre_y, 0), frame_shape[0])
    return np.array([centre_x - width / 2, centre_y - height / 2, width, height])


def nearest_position(displacement: Floats, grid: Grid) -> Integers:
    """Row and column [2] in the map of the position nearest to a displacement, halves to even.

    Rounded is the displacement from the middle, not the row and column.
    """
    middle = np.array([grid.margin_rows, grid.margin_columns])
    return np.rint(displacement).astype(np.int64) + middle
