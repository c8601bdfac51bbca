"""The object's parts, and the training samples of a frame (Algorithm 1, line 4)."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from dcs_jax.config import Config, Grid
from dcs_jax.core.window import Placed, reach

# The tracked box counts as four samples of label +1, so that both classes weigh the same; the four
# corner candidates of the window are -1. Equal samples are stored once, with their multiplicity.
LABELS = (1.0, -1.0, -1.0, -1.0, -1.0)  # [R]
WEIGHTS = (4.0, 1.0, 1.0, 1.0, 1.0)  # [R]


def part_rectangles(grid: Grid, parts: int) -> tuple[tuple[int, int, int, int], ...]:
    """Top, left, height and width of each of the K parts within the object, cells.

    In the paper's order: whole, top, left, bottom, right; then, of nine, the quadrants. Where a
    side is odd, bottom and right are the larger halves.
    """
    h, w = grid.rows, grid.columns
    top, left = h // 2, w // 2
    whole = ((0, 0, h, w),)
    halves = ((0, 0, top, w), (0, 0, h, left), (top, 0, h - top, w), (0, left, h, w - left))
    quadrants = (
        (0, 0, top, left),
        (0, left, top, w - left),
        (top, 0, h - top, left),
        (top, left, h - top, w - left),
    )
    return (whole + halves + quadrants)[:parts]


@jax.named_scope("Haar responses")
def training_patches(
    integral: Float[Array, "lines_y lines_x"],
    placed: Placed,
    frame_shape: tuple[int, ...],
    config: Config,
) -> Float[Array, "cells R"]:
    """Integral images of the R training patches: [cells, R].

    The first patch is the tracked box, the others are the corners of the window, as far as they
    are within reach. The patch axis is the minor one: a feature's corner is then one contiguous
    row (with the patch axis first, the responses take 20 times as long on the CPU).

    integral: [G_y + 1, G_x + 1], of the window around the tracked box.
    placed: that box. frame_shape: (H, W) or (H, W, 3).
    """
    grid = config.grid
    middle = jnp.array([grid.margin_rows, grid.margin_columns], jnp.int32)
    (top, left), (bottom, right) = (middle + limit for limit in reach(placed, frame_shape, config))
    positions = (tuple(middle), (top, left), (top, right), (bottom, left), (bottom, right))
    size = (grid.rows + 1, grid.columns + 1)
    patches = [jax.lax.dynamic_slice(integral, position, size) for position in positions]
    return jnp.stack(patches, axis=-1).reshape(-1, len(positions))
