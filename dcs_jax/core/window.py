"""The search window as an integral image on a canvas.

The object always covers the same number of cells, whatever its size in pixels, so one compiled
program serves targets of every size.
"""

import functools
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int32, Shaped, UInt8

from dcs_jax.config import Config, Grid
from dcs_jax.types import Frame

# ITU-R BT.601 luma in units of 1/16384. In integers a constant added to every channel adds exactly
# that constant to the grey value.
_LUMA = (4899, 9617, 1868)
# Sides of the blocks that are read from a frame, pixels; of larger windows fewer pixels are read.
_BLOCKS = (128, 256, 512)
# Side of the block of a target of some 100 pixels, for a choice made before its size is known.
# Measured: column sums of a frame of 1920x1080 take 1.9 ms and save each box of 80 pixels 0.11 ms;
# in frames of 320x240 they take 0.13 ms.
_TYPICAL_BLOCK = 256
# A box that touches the edge of the frame up to rounding counts as touching, cells.
_ROUNDING = 1e-3


def to_grey(frame: Frame | Int32[Array, "H W"]) -> Int32[Array, "H W"]:
    """Grey values in 0..255 of a uint8 frame [H, W] or [H, W, 3] (RGB), or themselves: [H, W]."""
    frame = frame.astype(jnp.int32)
    if frame.ndim == 2:
        return frame
    red, green, blue = _LUMA
    return (red * frame[..., 0] + green * frame[..., 1] + blue * frame[..., 2] + 8192) >> 14


class ColumnSums(NamedTuple):
    """A frame and its sums down the columns, from which the windows around any box are cut.

    grey: [H, W] int32 in 0..255. above: [H, W] int32, the sum of the pixels above each pixel.
    pixels: the frame itself, of which only colours are read; or None where nothing reads them.
    """

    grey: Int32[Array, "H W"]
    above: Int32[Array, "H W"]
    pixels: "VideoFrame | None" = None

    @property
    def shape(self) -> tuple[int, ...]:
        """(H, W)."""
        return self.grey.shape


@jax.named_scope("column sums")
def column_sums(frame: Frame) -> ColumnSums:
    """Grey values and their sums down the columns, of a uint8 frame [H, W] or [H, W, 3] (RGB)."""
    return _with_sums(to_grey(frame))._replace(pixels=one_frame(frame))


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


def one_frame(frame: Frame) -> VideoFrame:
    """A frame as a video of its own."""
    return VideoFrame(frame[None], jnp.zeros((), jnp.int32))


@jax.named_scope("window")
def window_integral(
    frame: VideoFrame | ColumnSums, box: Float[Array, "4"], grid: Grid
) -> Float[Array, "lines_y lines_x"]:
    """Integral image of the window around a box, in cells, by exact area resampling.

    The integral up to a grid line is that of the rows of pixels above it and a fraction of the row
    that it cuts, and the same along the columns; outside the frame the nearest pixel is repeated.
    Grey values are relative to the pixel at the box's centre, and sums start at the window's first
    pixels: the features do not depend on either, and float32 is exact for larger windows. Of a
    window of more than 512 pixels every second pixel is read, or every third and so on: of the
    longer side at least 256.

    frame: of which a block around the window is read; or its `column_sums`, which many boxes can
        share. box: [4] x, y, w, h in pixels.
    Returns [G_y + 1, G_x + 1] float32 in grey values times cells, its first row and column zero.
    """
    shapes = _block_shapes(frame.shape[0], frame.shape[1])
    rows, columns = _extent(box, grid)
    fits = [(rows <= shape[0]) & (columns <= shape[1]) for shape in shapes[:-1]]
    number = len(shapes) - 1 - sum((fit.astype(jnp.int32) for fit in fits), jnp.int32(0))

    # Under vmap the tracks take turns: all branches would be run.
    @jax.custom_batching.sequential_vmap
    def of_block(
        number: Int32[Array, ""], frame: VideoFrame | ColumnSums, box: Float[Array, "4"]
    ) -> Float[Array, "lines_y lines_x"]:
        branches = [functools.partial(_of_block, shape, grid) for shape in shapes]
        return jax.lax.switch(number, branches, frame, box)

    return of_block(number, frame, box)


@jax.named_scope("colours")
def window_colours(
    frame: VideoFrame | ColumnSums,
    box: Float[Array, "4"],
    grid: Grid,
    side: int,
    turn: Float[Array, "2 2"] | None = None,
) -> UInt8[Array, "Y X 3"] | None:
    """The colours in the window around a box: of one pixel in every side x side of its cells.

    The one in their middle; outside the frame the nearest one. None where the video has none.

    box: [4] x, y, w, h in pixels. turn: [2, 2], how the canvas is turned (`extensions.rotation`).
    """
    pixels = frame.pixels if isinstance(frame, ColumnSums) else frame
    if pixels is None or len(pixels.shape) == 2:
        return None
    x, y, w, h = box
    rows, columns = (
        side * (np.arange(count // side) - (count // side - 1) / 2) for count in grid.window
    )
    height, width, _ = pixels.shape
    down, right = jnp.asarray(rows, jnp.float32)[:, None], jnp.asarray(columns, jnp.float32)[None]
    if turn is not None:
        down, right = turned(turn, down, right)
    row = _pixel(y + h / 2 + h / grid.rows * down, height)
    column = _pixel(x + w / 2 + w / grid.columns * right, width)
    return pixels.frames[pixels.number, row, column]


def _block_shapes(height: int, width: int) -> list[tuple[int, int]]:
    """Rows and columns of the blocks that are read from a frame, the last one for all windows."""
    *smaller, largest = _BLOCKS
    shapes = [(min(side, height), min(side, width)) for side in smaller]
    # A block of nearly the whole frame saves less than its branch costs to compile.
    shapes = [shape for shape in shapes if math.prod(shape) <= 0.6 * height * width]
    return [*shapes, (min(largest, height), min(largest, width))]


def _extent(box: Float[Array, "4"], grid: Grid) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Rows and columns of pixels that a window may touch: it begins and ends within one."""
    _, _, w, h = box
    rows = h * (1 + 2 * grid.margin_rows / grid.rows)
    columns = w * (1 + 2 * grid.margin_columns / grid.columns)
    return rows + 2, columns + 2


def _of_block(
    shape: tuple[int, int], grid: Grid, frame: VideoFrame | ColumnSums, box: Float[Array, "4"]
) -> Float[Array, "lines_y lines_x"]:
    """The integral image of a window, from a block of so many rows and columns of pixels."""
    x, y, w, h = box
    height, width = frame.shape[:2]
    row, column = (jnp.arange(side + 1, dtype=jnp.float32) for side in grid.window)
    line_y = y + h / grid.rows * (row - grid.margin_rows)
    line_x = x + w / grid.columns * (column - grid.margin_columns)
    stride = _stride(shape, frame.shape, box, grid)
    top = _first_pixel(line_y[0], shape[0] * stride, height)
    left = _first_pixel(line_x[0], shape[1] * stride, width)
    middle_row = jnp.clip(y + h / 2, 0, height - 1).astype(jnp.int32) - top
    middle_column = jnp.clip(x + w / 2, 0, width - 1).astype(jnp.int32) - left
    step = jnp.float32(stride)
    integral = _resample(
        _block(frame, shape, top, left, stride),
        # A whole number is taken off, which is exact: every block has the same fractions.
        (line_y - top.astype(jnp.float32)) / step,
        (line_x - left.astype(jnp.float32)) / step,
        (middle_row // stride, middle_column // stride),
    )
    return integral * (grid.rows * grid.columns * step**2 / (h * w))


def _stride(
    shape: tuple[int, int], frame_shape: tuple[int, ...], box: Float[Array, "4"], grid: Grid
) -> int | Int32[Array, ""]:
    """Distance of the pixels that a block has of a window; 1 unless it is one for all windows."""
    sides = [min(_BLOCKS[-1], side) for side in frame_shape[:2]]
    if shape != tuple(sides) or shape == frame_shape[:2]:
        return 1
    rows, columns = _extent(box, grid)
    needed = jnp.minimum(rows, frame_shape[0]) / shape[0]
    needed = jnp.maximum(needed, jnp.minimum(columns, frame_shape[1]) / shape[1])
    return jnp.maximum(jnp.ceil(needed), 1).astype(jnp.int32)


def _first_pixel(
    line: Float[Array, ""], size: int | Int32[Array, ""], pixels: int
) -> Int32[Array, ""]:
    """First pixel of a block of this size that begins at a line, or ends at the frame's end."""
    return jnp.clip(_pixel(line, pixels), 0, jnp.maximum(pixels - size, 0))


def _block(
    frame: VideoFrame | ColumnSums,
    shape: tuple[int, int],
    top: Int32[Array, ""],
    left: Int32[Array, ""],
    stride: int | Int32[Array, ""],
) -> ColumnSums:
    """The sums of a block of this shape of the frame's pixels, or of every n-th of them."""
    if isinstance(frame, ColumnSums):
        frames, number = frame.grey[None], jnp.zeros((), jnp.int32)
    else:
        frames, number = frame
    rows, columns = (jnp.arange(side, dtype=jnp.int32) for side in shape)
    dense = _places(number, top + rows, left)
    if isinstance(stride, int):
        pixels = _read_rows(frames, dense, shape[1])
        if isinstance(frame, ColumnSums):
            return ColumnSums(pixels, _read_rows(frame.above[None], dense, shape[1]))
        return _with_sums(to_grey(pixels))
    height, width = frame.shape[:2]
    row = jnp.minimum(top + stride * rows + stride // 2, height - 1)
    column = jnp.minimum(left + stride * columns + stride // 2, width - 1)
    sparse = _places(number, row, jnp.zeros_like(left))

    def every_pixel(frames: Shaped[Array, "T H W *channels"]) -> Int32[Array, "n m"]:
        return to_grey(_read_rows(frames, dense, shape[1]))

    def every_nth(frames: Shaped[Array, "T H W *channels"]) -> Int32[Array, "n m"]:
        whole = _read_rows(frames, sparse, width)
        return to_grey(whole.at[:, column].get(mode="promise_in_bounds"))

    # Grey values, not pixels: XLA would give these the order of the second branch's in memory.
    grey = jax.lax.cond(stride == 1, every_pixel, every_nth, frames)
    return _with_sums(grey)


def _with_sums(grey: Int32[Array, "rows columns"]) -> ColumnSums:
    return ColumnSums(grey, sums_before(grey))


def _places(
    number: Int32[Array, ""], rows: Int32[Array, " n"], left: Int32[Array, ""]
) -> Int32[Array, "n 3"]:
    """Where some rows of a frame are read: frame, row and first column."""
    return jnp.stack([jnp.full_like(rows, number), rows, jnp.full_like(rows, left)], axis=1)


def _read_rows(
    frames: Shaped[Array, "T H W *channels"], places: Int32[Array, "n 3"], columns: int
) -> Shaped[Array, "n columns *channels"]:
    """So many columns of some rows of one of the frames.

    A gather of rows from all frames: no frame is copied whole. A slice would be fused with the grey
    values, which XLA then does not vectorise: they took four times as long.
    """
    channels = frames.shape[3:]
    return jax.lax.gather(
        frames,
        places,
        jax.lax.GatherDimensionNumbers(
            offset_dims=tuple(range(1, 2 + len(channels))),
            collapsed_slice_dims=(0, 1),
            start_index_map=(0, 1, 2),
        ),
        (1, 1, columns, *channels),
        mode=jax.lax.GatherScatterMode.PROMISE_IN_BOUNDS,
    )


def _resample(
    sums: ColumnSums,
    line_y: Float[Array, " lines_y"],
    line_x: Float[Array, " lines_x"],
    middle: tuple[Int32[Array, ""], Int32[Array, ""]],
) -> Float[Array, "lines_y lines_x"]:
    """The integral image up to lines, from the sums of a block that covers them.

    Lines and the pixel whose value is taken off all are in pixels of the block.
    """
    grey = sums.grey[middle]
    rows, columns = sums.shape
    top, left = _pixel(line_y[0], rows), _pixel(line_x[0], columns)
    in_window = jnp.arange(columns, dtype=jnp.int32) >= left

    # Line by line: in one gather, XLA would compute the position of the line for every element.
    def down_to(line: Float[Array, ""]) -> Float[Array, " W"]:
        row = _pixel(line, rows)
        above = sums.above[row] - sums.above[top] - grey * (row - top)
        fraction = line - row.astype(jnp.float32)
        cut = fraction * (sums.grey[row] - grey).astype(jnp.float32)
        return jnp.where(in_window, above.astype(jnp.float32) + cut, 0)

    down = jax.lax.map(down_to, line_y)  # [G_y + 1, W]
    lines = (down - down[:1]).T
    before = sums_before(lines)

    def right_to(line: Float[Array, ""]) -> Float[Array, " lines_y"]:
        column = _pixel(line, columns)
        return before[column] + (line - column.astype(jnp.float32)) * lines[column]

    integral = jax.lax.map(right_to, line_x)  # [G_x + 1, G_y + 1]
    return (integral - integral[:1]).T


def sums_before(values: Shaped[Array, "lines *line"]) -> Shaped[Array, "lines *line"]:
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
    of a box is not known when this is decided, and is taken for one of some 100 pixels. A single
    box never shares: in frames of 320x240 it took 1.15 times as long.
    """
    return boxes > 1 and 2 * boxes * _TYPICAL_BLOCK**2 > frame_shape[0] * frame_shape[1]


class Placed(NamedTuple):
    """A box of a track, and what the canvas shows there: each [4] x, y, w, h in pixels."""

    box: Float[Array, "4"]
    shown: Float[Array, "4"]


def place(
    box: Float[Array, "4"], config: Config, initial_size: Float[Array, "2"] | None = None
) -> Placed:
    """A box with what the canvas shows there: the same area, more of a square by `squareness`.

    In proportion to the box that is the same in the whole track, by its first one: where the box
    gets narrower with its object (`extensions.aspect`), so does the canvas, and shows it as before.

    box: [4] x, y, w, h in pixels. initial_size: [2], w and h of the first one; None: that is this.
    """
    x, y, w, h = box
    first_w, first_h = box[2:] if initial_size is None else initial_size
    wider = (first_h / first_w) ** (config.squareness / 2)
    shown = [x + w * (1 - wider) / 2, y + h * (1 - 1 / wider) / 2, w * wider, h / wider]
    return Placed(box, jnp.stack(shown))


def cell_aspect(shown: Float[Array, "4"], grid: Grid) -> Float[Array, ""]:
    """Height of a canvas cell over its width: []; shown: [4], what the canvas shows."""
    _, _, w, h = shown
    return h * grid.columns / (w * grid.rows)


def turned(
    turn: Float[Array, "2 2"], down: Float[Array, "*downs"], right: Float[Array, "*rights"]
) -> tuple[Float[Array, "*both"], Float[Array, "*both"]]:
    """Displacements on a canvas that is turned as those in the frame: down and right, cells."""
    of_row, of_column = turn
    return (of_row[0] * down + of_row[1] * right, of_column[0] * down + of_column[1] * right)


def _pixel(line: Float[Array, "*lines"], pixels: int) -> Int32[Array, "*lines"]:
    """The pixel that a grid line cuts, or the one next to it outside the frame."""
    return jnp.clip(jnp.floor(line), 0, pixels - 1).astype(jnp.int32)


def reach(
    placed: Placed, frame_shape: tuple[int, ...], config: Config
) -> tuple[Int32[Array, "2"], Int32[Array, "2"]]:
    """Least and greatest displacement of the box, [2] down and right, int32 cells.

    The box stays within the window, and leaves the frame by the overhang at most: what lies outside
    is not part of the picture, neither to search nor to learn from. No motion is always possible.

    frame_shape: (H, W) or (H, W, 3).
    """
    grid = config.grid
    x, y, w, h = placed.box
    corner, size = jnp.stack([y, x]), jnp.stack([h, w])
    _, _, shown_w, shown_h = placed.shown
    # Cells per pixel.
    cells = jnp.array([grid.rows, grid.columns], jnp.float32) / jnp.stack([shown_h, shown_w])
    margin = jnp.array([grid.margin_rows, grid.margin_columns], jnp.float32)
    frame = jnp.array(frame_shape[:2], jnp.float32)
    low = jnp.ceil((-corner - config.overhang * size) * cells - _ROUNDING)
    high = jnp.floor((frame - size - corner + config.overhang * size) * cells + _ROUNDING)
    low, high = jnp.clip(low, -margin, 0), jnp.clip(high, 0, margin)
    return low.astype(jnp.int32), high.astype(jnp.int32)
