"""The window around a box, on the canvas: cell by cell and pixel by pixel."""

import math

import numpy as np

from .records import Floats, Grid, Settings


def grey(frame: np.ndarray) -> Floats:
    """Grey values [H, W], whole numbers 0..255, of a frame uint8 [H, W] or [H, W, 3] (RGB)."""
    if frame.ndim == 2:
        return frame.astype(np.float64)
    red, green, blue = np.moveaxis(frame.astype(np.int64), -1, 0)
    return ((4899 * red + 9617 * green + 1868 * blue + 8192) >> 14).astype(np.float64)


def cell_means(frame: np.ndarray, box: Floats, grid: Grid) -> Floats:
    """Mean grey value [Gy, Gx] of each cell of the window around the box.

    Pixel (r, c) covers [r, r + 1) x [c, c + 1) and counts with the area it shares with the cell;
    beyond the frame the nearest pixel is repeated.

    frame: uint8 [H, W] or [H, W, 3]. box: [4], x, y, w, h, pixels.
    """
    values = grey(frame)
    x, y, width, height = (float(number) for number in box)
    row_overlaps = _axis_overlaps(y, height, grid.rows, grid.margin_rows, values.shape[0])
    column_overlaps = _axis_overlaps(x, width, grid.columns, grid.margin_columns, values.shape[1])

    pixels = values.tolist()  # reading single numbers from a list is faster than from an array
    means = np.zeros(grid.window)
    for i, rows in enumerate(row_overlaps):
        for j, columns in enumerate(column_overlaps):
            total = area = 0.0
            for r, shared_height in rows:
                for c, shared_width in columns:
                    total += shared_height * shared_width * pixels[r][c]
                    area += shared_height * shared_width
            means[i, j] = total / area
    return means


def window_cells(frame: np.ndarray, box: Floats, grid: Grid) -> Floats:
    """`cell_means` less the grey value of the pixel at the box's centre, [Gy, Gx].

    What is 0, as all beyond the window is in a description, is as grey as that pixel.
    """
    values = grey(frame)
    x, y, width, height = box
    row = int(min(max(y + height / 2, 0), values.shape[0] - 1))
    column = int(min(max(x + width / 2, 0), values.shape[1] - 1))
    return cell_means(frame, box, grid) - values[row, column]


def shown_box(box: Floats, settings: Settings) -> Floats:
    """What the canvas shows of a box [4]: the same area around the same centre.

    The sides of the first box of the track, to the power of 1 - squareness, times those of the
    square of its area to the power of squareness, are so much wider and less high than that box.
    By as much what is shown is wider and less high than this one.
    """
    x, y, width, height = (float(number) for number in box)
    first_width, first_height = settings.initial_size or (width, height)
    square = math.sqrt(first_width * first_height)
    squareness = settings.squareness
    shown_width = width / first_width * first_width ** (1 - squareness) * square**squareness
    shown_height = height / first_height * first_height ** (1 - squareness) * square**squareness
    left, top = x + width / 2 - shown_width / 2, y + height / 2 - shown_height / 2
    return np.array([left, top, shown_width, shown_height])


def cell_aspect(box: Floats, settings: Settings) -> float:
    """Height of a cell over its width, of the canvas of a box [4]."""
    _, _, width, height = shown_box(box, settings)
    return (height / settings.grid.rows) / (width / settings.grid.columns)


def turned(displacement: Floats, angle: float, aspect: float) -> Floats:
    """The displacement [2] (down, across) in the frame of one on a canvas that is turned, cells.

    angle: clockwise for who looks at the frame. aspect: height of a cell over its width.
    """
    if angle == 0:
        return displacement  # whole numbers stay whole
    down, across = displacement[0] * aspect, displacement[1]
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([(cosine * down + sine * across) / aspect, cosine * across - sine * down])


def integral(cells: Floats) -> Floats:
    """Integral image: entry (i, j) is the sum of the cells above row i and left of column j.

    cells: [Gy, Gx]. Returns [Gy + 1, Gx + 1].
    """
    rows, columns = cells.shape
    sums = np.zeros((rows + 1, columns + 1))
    for i in range(rows):
        sums[i + 1, 1:] = sums[i, 1:] + np.cumsum(cells[i])
    return sums


def _axis_overlaps(
    start: float, side: float, cells: int, margin: int, frame_side: int
) -> list[list[tuple[int, float]]]:
    """For each cell of the window along one axis, the pixels it covers and the length shared.

    start, side: the box along this axis, pixels. cells, margin: of the object and beside it.
    """
    cell = side / cells
    overlaps = []
    for i in range(-margin, cells + margin):
        low, high = start + i * cell, start + (i + 1) * cell
        covered = []
        for pixel in range(math.floor(low), math.ceil(high)):
            nearest = min(max(pixel, 0), frame_side - 1)
            covered.append((nearest, min(high, pixel + 1) - max(low, pixel)))
        overlaps.append(covered)
    return overlaps
