"""The search window as an integral image on a canvas.

The object always covers the same number of cells, whatever its size in pixels, so one compiled
program serves targets of every size.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int32, Shaped, UInt8

from dcs_jax.config import Config, Grid
from dcs_jax.types import Frame

# ITU-R BT.601 luma in units of 1/16384. In integers a constant added to every channel adds exactly
# that constant to the grey value.
_LUMA = (4899, 9617, 1868)
# Side of the smallest block that is cut from a frame, pixels; each next one is twice as large.
_LEAST_BLOCK = 128
# Side of the block of a target of some 100 pixels, for a choice made before its size is known. An
# estimate: where shared column sums begin to pay has not been measured.
_TYPICAL_BLOCK = 256
# A box that touches the edge of the frame up to rounding counts as touching, cells.
_ROUNDING = 1e-3


def to_grey(frame: Frame) -> Int32[Array, "H W"]:
    """Grey values in 0..255 of a uint8 frame [H, W] or [H, W, 3] (RGB): [H, W] int32."""
    frame = frame.astype(jnp.int32)
    if frame.ndim == 2:
        return frame
    red, green, blue = _LUMA
    return (red * frame[..., 0] + green * frame[..., 1] + blue * frame[..., 2] + 8192) >> 14


class ColumnSums(NamedTuple):
    """A frame and its sums down the columns, from which the windows around any box are cut.

    grey: [H, W] int32 in 0..255. above: [H, W] int32, the sum of the pixels above each pixel.
    """

    grey: Int32[Array, "H W"]
    above: Int32[Array, "H W"]

    @property
    def shape(self) -> tuple[int, ...]:
        """(H, W)."""
        return self.grey.shape


@jax.named_scope("column sums")
def column_sums(frame: Frame) -> ColumnSums:
    """Grey values and their sums down the columns, of a uint8 frame [H, W] or [H, W, 3] (RGB)."""
    grey = to_grey(frame)
    return ColumnSums(grey, _sums_before(grey))


class VideoFrame(NamedTuple):
    """A frame of a video in memory, of which only what is looked at is read.

    frames: [T, H, W] or [T, H, W, 3] uint8. number: [] int32, which of them.
    """

    frames: UInt8[Array, "T H W *channels"]
    number: Int32[Array, ""]

    @property
    def shape(self) -> tuple[int, ...]:
        """(H, W) or (H, W, 3)."""
        return self.frames.shape[1:]


@jax.named_scope("window")
def window_integral(
    frame: VideoFrame | ColumnSums, box: Float[Array, "4"], grid: Grid
) -> Float[Array, "lines_y lines_x"]:
    """Integral image of the window around a box, in cells, by exact area resampling.

    The integral up to a grid line is that of the rows of pixels above it and a fraction of the row
    that it cuts, and the same along the columns; outside the frame the nearest pixel is repeated.
    Grey values are relative to the pixel at the box's centre, and sums start at the window's first
    pixels: the features do not depend on either, and float32 is exact for larger windows.

    frame: of which a block around the window is read; or its `column_sums`, which many boxes can
        share. box: [4] x, y, w, h in pixels.
    Returns [G_y + 1, G_x + 1] float32 in grey values times cells, its first row and column zero.
    """
    if isinstance(frame, ColumnSums):
        return _resample(frame, (0, 0), frame.shape, box, grid)
    shapes = _block_shapes(frame.shape[0], frame.shape[1])
    _, _, w, h = box
    rows = h * (1 + 2 * grid.margin_rows / grid.rows)
    columns = w * (1 + 2 * grid.margin_columns / grid.columns)
    # A window covers a pixel more than it has on both sides, where it begins within one.
    fits = [(rows + 2 <= shape[0]) & (columns + 2 <= shape[1]) for shape in shapes[:-1]]
    number = len(shapes) - 1 - sum((fit.astype(jnp.int32) for fit in fits), jnp.int32(0))

    # Under vmap the tracks take turns: all branches would be run.
    @jax.custom_batching.sequential_vmap
    def of_block(
        number: Int32[Array, ""], frame: VideoFrame, box: Float[Array, "4"]
    ) -> Float[Array, "lines_y lines_x"]:
        branches = [functools.partial(_of_block, shape, grid) for shape in shapes]
        return jax.lax.switch(number, branches, frame, box)

    return of_block(number, frame, box)


def _block_shapes(height: int, width: int) -> list[tuple[int, int]]:
    """Rows and columns of the blocks that are cut from a frame, the last one all of it."""
    shapes = []
    side = _LEAST_BLOCK
    # A block of nearly the whole frame saves less than its branch costs to compile.
    while min(side, height) * min(side, width) <= 0.6 * height * width:
        shapes.append((min(side, height), min(side, width)))
        side *= 2
    return [*shapes, (height, width)]


def _of_block(
    shape: tuple[int, int], grid: Grid, frame: VideoFrame, box: Float[Array, "4"]
) -> Float[Array, "lines_y lines_x"]:
    """The integral image of a window that fits into a block of this shape."""
    x, y, w, h = box
    top = _first_pixel(y - h * grid.margin_rows / grid.rows, shape[0], frame.shape[0])
    left = _first_pixel(x - w * grid.margin_columns / grid.columns, shape[1], frame.shape[1])
    # Of the frames, not of the frame: it is not copied.
    channels = frame.shape[2:]
    start = (frame.number, top, left, *(jnp.int32(0) for _ in channels))
    block = jax.lax.dynamic_slice(frame.frames, start, (1, *shape, *channels))[0]
    return _resample(column_sums(block), (top, left), frame.shape, box, grid)


def _first_pixel(line: Float[Array, ""], size: int, pixels: int) -> Int32[Array, ""]:
    """First pixel of a block of this size that begins at a line, or ends at the frame's end."""
    return jnp.clip(_pixel(line, pixels), 0, pixels - size)


def _resample(
    sums: ColumnSums,
    corner: tuple[int | Int32[Array, ""], int | Int32[Array, ""]],
    frame_shape: tuple[int, ...],
    box: Float[Array, "4"],
    grid: Grid,
) -> Float[Array, "lines_y lines_x"]:
    """`window_integral` from the column sums of a block of the frame that covers the window.

    corner: first row and column of the block. Lines are rounded in the frame, not in the block, so
    that every block gives the same integral bit for bit.
    """
    height, width = frame_shape[:2]
    first_row, first_column = corner
    x, y, w, h = box
    middle = sums.grey[
        jnp.clip(y + h / 2, 0, height - 1).astype(jnp.int32) - first_row,
        jnp.clip(x + w / 2, 0, width - 1).astype(jnp.int32) - first_column,
    ]
    line_y = y + h / grid.rows * (jnp.arange(grid.window[0] + 1.0) - grid.margin_rows)
    line_x = x + w / grid.columns * (jnp.arange(grid.window[1] + 1.0) - grid.margin_columns)
    top, left = (_pixel(line[0], size) for line, size in ((line_y, height), (line_x, width)))
    in_window = jnp.arange(sums.shape[1]) >= left - first_column

    # Line by line: in one gather, XLA would compute the position of the line for every element.
    def down_to(line: Float[Array, ""]) -> Float[Array, " W"]:
        row = _pixel(line, height)
        above = sums.above[row - first_row] - sums.above[top - first_row] - middle * (row - top)
        fraction = line - row.astype(jnp.float32)
        cut = fraction * (sums.grey[row - first_row] - middle).astype(jnp.float32)
        return jnp.where(in_window, above.astype(jnp.float32) + cut, 0)

    rows = jax.lax.map(down_to, line_y)  # [G_y + 1, W]
    columns = (rows - rows[0]).T
    before = _sums_before(columns)

    def right_to(line: Float[Array, ""]) -> Float[Array, " lines_y"]:
        column = _pixel(line, width)
        fraction = line - column.astype(jnp.float32)
        at = column - first_column
        return before[at] + fraction * columns[at]

    integral = jax.lax.map(right_to, line_x)  # [G_x + 1, G_y + 1]
    return (integral - integral[0]).T * (grid.rows * grid.columns / (h * w))


def _sums_before(values: Shaped[Array, "lines *line"]) -> Shaped[Array, "lines *line"]:
    """Sum of all lines before each one along the first axis: [lines, ...].

    On the CPU a loop over contiguous lines takes a ninth of the time of `jnp.cumsum`.
    """

    def add(
        total: Shaped[Array, "*line"], line: Shaped[Array, "*line"]
    ) -> tuple[Shaped[Array, "*line"], Shaped[Array, "*line"]]:
        return total + line, total

    return jax.lax.scan(add, jnp.zeros_like(values[0]), values)[1]


def share_column_sums(boxes: int, frame_shape: tuple[int, ...]) -> bool:
    """Whether so many boxes in a frame take less time from its `column_sums` than from blocks.

    A step cuts two windows. Sums of all pixels pay where these have fewer than the blocks: the size
    of a box is not known when this is decided, and is taken for one of some 100 pixels.
    """
    return 2 * boxes * _TYPICAL_BLOCK**2 > frame_shape[0] * frame_shape[1]


def _pixel(line: Float[Array, ""], pixels: int) -> Int32[Array, ""]:
    """The pixel that a grid line cuts, or the one next to it outside the frame."""
    return jnp.clip(jnp.floor(line), 0, pixels - 1).astype(jnp.int32)


def reach(
    box: Float[Array, "4"], frame_shape: tuple[int, ...], config: Config
) -> tuple[Int32[Array, "2"], Int32[Array, "2"]]:
    """Least and greatest displacement of the box, [2] down and right, int32 cells.

    The box stays within the window, and leaves the frame by the overhang at most: what lies outside
    is not part of the picture, neither to search nor to learn from. No motion is always possible.

    box: [4] x, y, w, h in pixels. frame_shape: (H, W) or (H, W, 3).
    """
    grid = config.grid
    x, y, w, h = box
    corner, size = jnp.stack([y, x]), jnp.stack([h, w])
    cells = jnp.array([grid.rows, grid.columns], jnp.float32)
    margin = jnp.array([grid.margin_rows, grid.margin_columns], jnp.float32)
    frame = jnp.array(frame_shape[:2], jnp.float32)
    overhang = config.overhang * cells
    low = jnp.ceil(-corner / size * cells - overhang - _ROUNDING)
    high = jnp.floor((frame - size - corner) / size * cells + overhang + _ROUNDING)
    low, high = jnp.clip(low, -margin, 0), jnp.clip(high, 0, margin)
    return low.astype(jnp.int32), high.astype(jnp.int32)
