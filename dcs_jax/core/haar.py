"""Haar-like features: random pools of them, and their responses."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Shaped

from dcs_jax.config import Config
from dcs_jax.core.samples import part_rectangles
from dcs_jax.types import Pool

CORNERS = 9
# Features cover at least this many cells (the authors' generator).
_LEAST_AREA = 9
# One proposal in four is valid on the smallest part of the default canvas; with 32 of them one
# feature in 10^4 has to fall back on one that is smaller than _LEAST_AREA.
_PROPOSALS = 32


def _type_table() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The five types as merged corners: rows, columns and weights [5, 9], box counts [5].

    In units of the base block. A box's mean is the sum of its four corners over its area, so boxes
    that touch share corners: 6 for two boxes, 8 for 1:2:1 (whose middle box is of double size), 9
    for the checker.
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
    return rows.astype(np.int32), columns.astype(np.int32), weights.astype(np.float32), boxes


_ROWS, _COLUMNS, _WEIGHTS, _BOXES = _type_table()


def draw_pool(key: Shaped[Array, ""], config: Config) -> Pool:
    """Draw the features of all parts: F = K * N * M, part by part, selector by selector.

    The five types are equally likely: two boxes one above or beside the other, three 1:2:1
    likewise, and the 2x2 checker, with weights {1,-1}, {1,-2,1} and {1,-1,-1,1} on the boxes'
    means. Base block floor(U * block * side) per axis, top-left uniform in the part; a proposal
    that leaves the part or covers less than 9 cells is rejected. All proposals are drawn at once
    and the first valid one wins. On a part too small for any valid feature the blocks are at least
    one cell and the least area is waived.
    """
    grid = config.grid
    features_per_part = config.selectors * config.pool_size
    rectangles = np.array(part_rectangles(grid, config.parts), np.float32)  # [K, 4]
    top, left, height, width = np.repeat(rectangles, features_per_part, axis=0).T[:, :, None]
    shape = (config.parts * features_per_part, _PROPOSALS)
    key_type, *keys = jax.random.split(key, 5)
    kind = jax.random.randint(key_type, shape, 0, len(_BOXES))
    uniform = [jax.random.uniform(key, shape) for key in keys]
    block_height = jnp.floor(uniform[0] * (config.block * height))
    block_width = jnp.floor(uniform[1] * (config.block * width))
    large_enough = block_height * block_width >= 1
    block_height, block_width = jnp.maximum(block_height, 1.0), jnp.maximum(block_width, 1.0)
    row, column = jnp.floor(uniform[2] * height), jnp.floor(uniform[3] * width)

    rows_spanned = jnp.asarray(_ROWS.max(1), jnp.float32)[kind] * block_height
    columns_spanned = jnp.asarray(_COLUMNS.max(1), jnp.float32)[kind] * block_width
    fits = (row + rows_spanned <= height) & (column + columns_spanned <= width)
    valid = fits & large_enough & (rows_spanned * columns_spanned >= _LEAST_AREA)
    chosen = jnp.argmax(fits.astype(jnp.int32) + valid.astype(jnp.int32), axis=1)[
        :, None
    ]  # the first of the best

    def choose(values: Shaped[Array, "F proposals"]) -> Shaped[Array, "F 1"]:
        return jnp.take_along_axis(values, chosen, axis=1).astype(jnp.int32)

    kind = choose(kind)[:, 0]
    # Where not one proposal fits, two single cells one above the other in the corner do.
    fitting = jnp.take_along_axis(fits, chosen, axis=1)
    kind = jnp.where(fitting[:, 0], kind, 0)
    block_height, block_width = (
        jnp.where(fitting, choose(block), 1) for block in (block_height, block_width)
    )
    row, column = (jnp.where(fitting, choose(place), 0) for place in (row, column))
    corner_rows = top.astype(np.int32) + row + jnp.asarray(_ROWS)[kind] * block_height
    corner_columns = left.astype(np.int32) + column + jnp.asarray(_COLUMNS)[kind] * block_width
    return Pool(
        corners=corner_rows * (grid.columns + 1) + corner_columns,
        weights=jnp.asarray(_WEIGHTS)[kind] / (block_height * block_width).astype(jnp.float32),
        boxes=jnp.asarray(_BOXES, jnp.int32)[kind],
    )


def responses(patches: Float[Array, "cells R"], pool: Pool) -> Float[Array, "F R"]:
    """Responses of all features on all patches, in grey values: [F, R] float32.

    patches: [cells, R], see `training_patches`. One row gather per corner, unrolled: a sum over a
    gathered [F, 9, R] is 20 to 300 times slower on the CPU.
    """
    total = jnp.zeros((pool.corners.shape[0], patches.shape[1]), patches.dtype)
    for corner in range(CORNERS):
        rows = jnp.take(patches, pool.corners[:, corner], axis=0, mode="clip")
        total += pool.weights[:, corner, None] * rows
    return total
