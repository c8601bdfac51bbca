"""The search window as an integral image on a canvas.

The object always covers the same number of cells, whatever its size in pixels, so one compiled
program serves targets of every size.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int32

from dcs_jax.config import Config, Grid
from dcs_jax.types import Frame

# ITU-R BT.601 luma in units of 1/16384. In integers a constant added to every channel adds exactly
# that constant to the grey value.
_LUMA = (4899, 9617, 1868)
# A box that touches the edge of the frame up to rounding counts as touching, cells.
_ROUNDING = 1e-3


def to_grey(frame: Frame) -> Int32[Array, "H W"]:
    """Grey values in 0..255 of a uint8 frame [H, W] or [H, W, 3] (RGB): [H, W] int32."""
    frame = frame.astype(jnp.int32)
    if frame.ndim == 2:
        return frame
    red, green, blue = _LUMA
    return (red * frame[..., 0] + green * frame[..., 1] + blue * frame[..., 2] + 8192) >> 14


def window_integral(
    frame: Frame, box: Float[Array, "4"], grid: Grid
) -> Float[Array, "lines_y lines_x"]:
    """Integral image of the window around a box, in cells, by exact area resampling.

    The integral at fractional grid lines is two matrix products, `A_y @ frame @ A_x^T`; outside the
    frame the nearest pixel is repeated. Grey values are taken relative to the pixel at the box's
    centre: the features do not see the difference, and the sums stay within float32's exact range.

    frame: [H, W] or [H, W, 3] uint8. box: [4] x, y, w, h in pixels.
    Returns [G_y + 1, G_x + 1] float32 in grey values times cells, its first row and column zero.
    """
    grey = to_grey(frame)
    height, width = grey.shape
    x, y, w, h = box
    middle = grey[
        jnp.clip(y + h / 2, 0, height - 1).astype(jnp.int32),
        jnp.clip(x + w / 2, 0, width - 1).astype(jnp.int32),
    ]
    relative = (grey - middle).astype(jnp.float32)
    rows = _line_weights(y, h / grid.rows, grid.margin_rows, grid.window[0], height)
    columns = _line_weights(x, w / grid.columns, grid.margin_columns, grid.window[1], width)
    highest = jax.lax.Precision.HIGHEST
    return jnp.matmul(jnp.matmul(rows, relative, precision=highest), columns.T, precision=highest)


def reach(
    box: Float[Array, "4"], frame_shape: tuple[int, ...], config: Config
) -> tuple[Int32[Array, "2"], Int32[Array, "2"]]:
    """How far the box may move: least and greatest displacement, [2] down and right, int32 cells.

    To the ends of the window, but no further out of the frame than the overhang: what lies there
    is no picture, neither to search nor to learn from. Staying is always possible.

    box: [4]. frame_shape: (H, W) or (H, W, 3).
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


def _line_weights(
    start: Float[Array, ""], cell: Float[Array, ""], margin: int, cells: int, pixels: int
) -> Float[Array, "lines pixels"]:
    """What each pixel of an axis adds to the integral up to each grid line: [cells + 1, pixels].

    start: where the box begins, pixels; cell: size of a cell, pixels. The first and the last pixel
    reach out to infinity, which repeats them outside the frame.
    """
    lines = start + (jnp.arange(cells + 1, dtype=jnp.float32) - margin) * cell
    index = jnp.arange(pixels, dtype=jnp.float32)
    low = jnp.where(index == 0, -jnp.inf, 0.0)
    high = jnp.where(index == pixels - 1, jnp.inf, 1.0)
    covered = jnp.clip(lines[:, None] - index, low, high)
    # Differences of the two ends of one pixel, not of sums, keep this exact far from the origin.
    return (covered - covered[0]) / cell
