"""Haar-like features: random pools, and responses."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int32, Shaped

from dcs_jax.config import Config
from dcs_jax.core.samples import part_rectangles
from dcs_jax.types import Pool, Scalar

CORNERS = 9
# Features cover at least this many cells (the authors' generator).
_LEAST_AREA = 9


def _type_table() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The five types as merged corners: rows, columns and weights [5, 9], box counts [5].

    In units of the base block. A box's mean is the sum of its four corners over its area, so boxes
    that touch share corners: 6 for two boxes, 8 for 1:2:1 (whose middle box is of double size), 9
    for the checker. All weights are whole numbers over the area of the base block.
    """
    two = [(0, 1, 1.0), (1, 1, -1.0)]  # (start, length, weight) along the split axis
    three = [(0, 1, 1.0), (1, 2, -2.0), (3, 1, 1.0)]
    one = [(0, 1, 1.0)]
    types = [(two, one), (one, two), (three, one), (one, three), (two, two)]
    rows, columns, weights = (np.zeros((len(types), CORNERS)) for _ in range(3))
    for number, (vertical, horizontal) in enumerate(types):
        corners: dict[tuple[int, int], float] = {}
        for top, height, vertical_weight in vertical:
            for left, width, horizontal_weight in horizontal:
                weight = vertical_weight * horizontal_weight / (height * width)
                for row, row_sign in ((top, -1), (top + height, 1)):
                    for column, sign in ((left, -row_sign), (left + width, row_sign)):
                        corners[row, column] = corners.get((row, column), 0.0) + sign * weight
        for slot, ((row, column), weight) in enumerate(corners.items()):
            rows[number, slot], columns[number, slot], weights[number, slot] = row, column, weight
    boxes = np.array([len(vertical) * len(horizontal) for vertical, horizontal in types])
    return rows.astype(np.int32), columns.astype(np.int32), weights.astype(np.int8), boxes


_ROWS, _COLUMNS, _WEIGHTS, _BOXES = _type_table()
# Number of corners of a feature by the number of its boxes: the rest have the coefficient 0.
CORNERS_OF_BOXES = {
    int(boxes): int((weights != 0).sum())
    for boxes, weights in sorted(zip(_BOXES, _WEIGHTS, strict=True), key=lambda pair: pair[0])
}


def draw_pool(key: Shaped[Array, ""], config: Config) -> Pool:
    """Draw the features of all parts: F = M * K * N.

    The five types are equally likely: two boxes in a column or a row, three boxes 1:2:1 likewise,
    and the 2x2 checker, with weights {1,-1}, {1,-2,1} and {1,-1,-1,1} on the boxes' means. Base
    block floor(U * block * side) per axis, top-left uniform in the part; features that leave the
    part or cover less than 9 cells are rejected. They are drawn from the distribution that remains,
    without a rejection loop: type and block height, then block width, then the position.
    """
    grid = config.grid
    rectangles = np.array(part_rectangles(grid, config.parts))  # [K, 4]
    fitting = _fitting(rectangles, config.block)  # [K, 5, heights, widths]
    types_and_heights = jnp.cumsum(fitting.sum(-1).reshape(config.parts, -1), axis=-1)
    widths = jnp.cumsum(fitting, axis=-1)
    shape = (config.pool_size, config.parts, config.selectors)
    # Vmapped, so that the generator is compiled once.
    uniforms = jax.vmap(lambda key: jax.random.uniform(key, shape, jnp.float32))(
        jax.random.split(key, 4)
    )
    for_height, for_width, for_row, for_column = uniforms
    drawn = jax.vmap(_draw, (0, 1), 1)(types_and_heights, for_height)
    kind, block_height = jnp.divmod(drawn.reshape(-1), fitting.shape[2])  # [F]
    part = np.broadcast_to(np.arange(config.parts)[:, None], shape).reshape(-1)
    block_width = jax.vmap(_draw)(widths[part, kind, block_height], for_width.reshape(-1))
    block_height, block_width = block_height + 1, block_width + 1

    top, left, height, width = rectangles[part].astype(np.int32).T

    def position(
        uniform: Float[Array, "M K N"], positions: Int32[Array, " F"]
    ) -> Int32[Array, " F"]:
        drawn = uniform.reshape(-1) * positions.astype(jnp.float32)
        return jnp.minimum(drawn.astype(jnp.int32), positions - 1)  # the product may round up

    rows = height - jnp.asarray(_ROWS.max(1))[kind] * block_height + 1
    columns = width - jnp.asarray(_COLUMNS.max(1))[kind] * block_width + 1
    row, column = top + position(for_row, rows), left + position(for_column, columns)
    corner_rows = row[None] + jnp.asarray(_ROWS.T)[:, kind] * block_height[None]
    corner_columns = column[None] + jnp.asarray(_COLUMNS.T)[:, kind] * block_width[None]
    cells = (grid.rows + 1) * (grid.columns + 1)
    return Pool(
        corners=(corner_rows * (grid.columns + 1) + corner_columns).astype(
            jnp.uint16 if cells <= 2**16 else jnp.int32
        ),
        coefficients=jnp.asarray(_WEIGHTS.T)[:, kind],
        scale=1 / (block_height * block_width).astype(jnp.float32),
        boxes=jnp.asarray(_BOXES, jnp.int32)[kind],
    )


def _fitting(rectangles: np.ndarray, block: Scalar) -> Float[Array, "K 5 heights widths"]:
    """Probability of each type with each base block in each part, up to a factor for each part.

    The probability of the block times the number of positions where the feature fits; blocks of 1,
    2, ... cells up to the largest part. On a part too small for any feature of the least area,
    blocks of one cell that fit are drawn.
    """
    heights, widths = (np.arange(1, side + 1) for side in rectangles[:, 2:].max(0))
    height, width = (rectangles[:, side, None, None, None] for side in (2, 3))  # [K, 1, 1, 1]
    rows = _ROWS.max(1)[:, None, None] * heights[:, None]  # [5, heights, 1]
    columns = _COLUMNS.max(1)[:, None, None] * widths
    positions = np.maximum(height - rows + 1, 0) * np.maximum(width - columns + 1, 0)

    def drawn(side: np.ndarray, block_side: np.ndarray) -> Float[Array, "K 1 ..."]:
        # floor(U * s) = b for a share of clip(s - b, 0, 1) out of s.
        return jnp.clip(block * side.astype(np.float32) - block_side.astype(np.float32), 0, 1)

    fitting = (
        drawn(height, heights[None, None, :, None])
        * drawn(width, widths[None, None, None])
        * (positions * (rows * columns >= _LEAST_AREA)).astype(np.float32)
    )
    single = (positions * (heights[:, None] * widths == 1)).astype(np.float32)
    return jnp.where(fitting.sum((1, 2, 3), keepdims=True) > 0, fitting, single)


def _draw(
    cumulative: Float[Array, " choices"], uniform: Float[Array, "*draws"]
) -> Int32[Array, "*draws"]:
    """Indices [...] drawn in proportion to weights, given their cumulative sums, from U(0, 1)."""
    # A uniform number is below 1, but its product may round up to the total.
    last = (cumulative < cumulative[-1]).sum(dtype=jnp.int32)
    found = jnp.searchsorted(cumulative, uniform * cumulative[-1], side="right")
    return jnp.minimum(found.astype(jnp.int32), last)


@jax.named_scope("Haar responses")
def responses(patches: Float[Array, "cells R"], pool: Pool) -> Float[Array, "R F"]:
    """Responses of all features on all patches, in grey values: [R, F] float32.

    patches: [cells, R], see `training_patches`. One row gather per corner, unrolled: a sum over a
    gathered [F, 9, R] is 20 to 300 times slower on the CPU.
    """
    total = jnp.zeros((pool.scale.size, patches.shape[1]), patches.dtype)
    for corners, coefficients in zip(pool.corners, pool.coefficients, strict=True):
        rows = patches.at[corners].get(mode="promise_in_bounds")
        total += coefficients.astype(patches.dtype)[:, None] * rows

    def of_patch(patch: Int32[Array, ""]) -> Float[Array, " F"]:
        return jax.lax.dynamic_index_in_dim(total, patch, axis=1, keepdims=False) * pool.scale

    # As a loop, the transposition keeps XLA from doing the gathers again wherever a row is used.
    return jax.lax.map(of_patch, jnp.arange(patches.shape[1], dtype=jnp.int32))
