"""The feature pool and its responses."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from hypothesis import given
from hypothesis import strategies as st

from dcs_jax.config import Config, Grid
from dcs_jax.core.haar import draw_pool, responses
from dcs_jax.core.samples import part_rectangles

CONFIG = Config(canvas=(48, 56), selectors=8, pool_size=5)
GRID = CONFIG.grid
PARTS, SELECTORS, FEATURES = 9, 8, 360
draw = jax.jit(draw_pool)


def boxes_of(pool, grid, feature):
    mask = reference.cell_weights(
        np.asarray(pool.corners[:, feature]),
        np.asarray(pool.coefficients[:, feature]) * float(pool.scale[feature]),
        (grid.rows, grid.columns),
    )
    return mask, reference.boxes_of(mask)


@pytest.fixture(scope="module")
def pool():
    return draw_pool(jax.random.key(3), CONFIG)


@pytest.mark.parametrize("parts", [1, 5, 9])
@pytest.mark.parametrize("side", [(20, 24), (7, 9)])
def test_parts_are_those_of_the_reference(parts, side):
    rows, columns = side
    grid = Grid(rows, columns, margin_rows=0, margin_columns=0)
    expected = [part[1:] for part in reference.parts_of(rows, columns, parts)]
    assert list(part_rectangles(grid, parts)) == expected


def test_every_feature_lies_in_its_part_and_is_large_enough(pool):
    for feature in range(FEATURES):
        _, boxes = boxes_of(pool, GRID, feature)
        top, left, height, width = part_rectangles(GRID, PARTS)[feature // SELECTORS % PARTS]
        for box in boxes:
            assert top <= box.top
            assert box.top + box.height <= top + height
            assert left <= box.left
            assert box.left + box.width <= left + width
        assert sum(box.height * box.width for box in boxes) >= 9
        # No base block is larger than this share of the part.
        assert min(box.height for box in boxes) <= height * CONFIG.block
        assert min(box.width for box in boxes) <= width * CONFIG.block
        assert len(boxes) == pool.boxes[feature]


def test_responses_are_differences_of_box_means(pool):
    cells = np.random.default_rng(0).integers(-255, 256, (GRID.rows, GRID.columns)).astype(float)
    table = jnp.asarray(reference.integral(cells), jnp.float32).reshape(-1, 1)
    values = np.asarray(responses(table, pool))[0]
    for feature in range(FEATURES):
        _, boxes = boxes_of(pool, GRID, feature)
        expected = sum(
            box.weight
            * cells[box.top : box.top + box.height, box.left : box.left + box.width].mean()
            for box in boxes
        )
        assert values[feature] == pytest.approx(expected, abs=0.02)


def test_all_types_are_drawn_about_equally_often():
    config = Config(canvas=60, parts=1, selectors=10, pool_size=50)
    pool = draw_pool(jax.random.key(0), config)
    kinds = [
        (len(boxes), boxes[0].top == boxes[1].top)
        for boxes in (boxes_of(pool, config.grid, feature)[1] for feature in range(500))
    ]
    shares = {kind: kinds.count(kind) / len(kinds) for kind in set(kinds)}
    assert len(shares) == 5
    # 1:2:1 features are long: more leave the part and are rejected.
    assert all(0.1 < share < 0.35 for share in shares.values())


@given(seed=st.integers(0, 2**31), side=st.sampled_from([(4, 4), (5, 8), (9, 30)]))
def test_parts_too_small_for_the_rules_still_get_features(seed, side):
    config = Config(canvas=side, selectors=1, pool_size=5)
    grid = config.grid
    pool = draw(jax.random.key(seed), config)
    for feature in range(45):
        mask, boxes = boxes_of(pool, grid, feature)
        assert abs(mask.sum()) < 1e-6
        top, left, height, width = part_rectangles(grid, 9)[feature % 9]
        outside = mask.copy()
        outside[top : top + height, left : left + width] = 0
        assert not outside.any()
        assert len(boxes) >= 2


def test_the_key_decides_the_pool():
    pools = [draw(jax.random.key(seed), CONFIG) for seed in (1, 1, 2)]
    assert jax.tree.all(jax.tree.map(lambda a, b: (a == b).all(), pools[0], pools[1]))
    assert (pools[0].corners != pools[2].corners).any()


def test_pools_of_many_keys_are_drawn_at_once():
    keys = jax.random.split(jax.random.key(0), 3)
    many = jax.vmap(lambda key: draw_pool(key, CONFIG))(keys)
    one = draw(keys[1], CONFIG)
    np.testing.assert_array_equal(many.corners[1], one.corners)
