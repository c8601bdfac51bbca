"""The aspect ratio of an object that gets narrower or flatter."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from hypothesis import assume, given
from hypothesis import strategies as st
from textures import integral, texture

from dcs_jax import AspectRatio, Config
from dcs_jax.extensions import aspect, verification
from dcs_jax.extensions.descriptors import describe

GRID = Config(canvas=(24, 20)).grid
HERE = jnp.zeros(2)
SETTINGS = AspectRatio()
INITIAL_SIZE = jnp.array([30.0, 50.0])
STEP = 1.06


def box_of(steps: float) -> jax.Array:
    """A box so many steps taller than the first one, of twice its sides."""
    w, h = 2 * INITIAL_SIZE * jnp.array([STEP ** (-steps / 2), STEP ** (steps / 2)])
    return jnp.array([200 - w / 2, 300 - h / 2, w, h])


def seen(seed: int, taller: float = 1.0) -> np.ndarray:
    """The window of an object that is so many times as high for its width as in its template."""
    return texture(GRID, seed, (taller**0.5, taller**-0.5))


@jax.jit
def description_of(window: jax.Array) -> jax.Array:
    return describe(window, HERE, np.ones((1, 2)), GRID)[0]


@jax.jit
def follow(
    box: jax.Array,
    initial: jax.Array,
    window: jax.Array,
    settings: AspectRatio,
    rested: int = 0,
    resized: bool = True,
) -> jax.Array:
    known = verification.init(initial, box)._replace(num_rested=jnp.asarray(rested))
    similarity = initial @ description_of(window)
    may = jnp.asarray(resized)
    return aspect.follow(box, INITIAL_SIZE, known, similarity, may, window, HERE, settings, GRID)


def followed(
    taken: float,
    window: np.ndarray,
    settings: AspectRatio = SETTINGS,
    rested: int = 0,
    resized: bool = True,
) -> float:
    """By how many steps the box changes whose object is seen so in it."""
    initial = description_of(integral(seen(1)))
    box = box_of(taken)
    found = np.asarray(follow(box, initial, integral(window), settings, rested, resized))
    np.testing.assert_allclose(found[:2] + found[2:] / 2, (200, 300), atol=1e-3)
    np.testing.assert_allclose(found[2:].prod(), box[2:].prod(), rtol=1e-5)
    return float(np.log(found[3] / found[2] * box[2] / box[3]) / np.log(STEP))


@given(
    seed=st.integers(0, 2**31),
    taken=st.one_of(st.just(0), st.integers(-74, 74).map(lambda quarters: quarters / 4)),
    taller=st.floats(0.6, 1.7),
    similar_above=st.sampled_from([0.3, 0.8]),
    gain_above=st.sampled_from([0.02, 0.1]),
    cost=st.sampled_from([0.0, 0.1, 1.0]),
    rested=st.integers(0, 1),
)
def test_the_box_is_that_of_the_reference(
    seed, taken, taller, similar_above, gain_above, cost, rested
):
    settings = AspectRatio(similar_above=similar_above, gain_above=gain_above, cost=cost)
    window, box = seen(seed, taller), box_of(taken)
    template = reference.descriptors.describe(seen(seed), np.zeros(2), 1.0, GRID)
    known = reference.AspectRatio(**dataclasses.asdict(settings))
    compared: dict[float, float] = {}

    def similarity(steps: float) -> float:
        patch = reference.descriptors.describe(window, np.zeros(2), 1.0, GRID, STEP**steps)
        compared[steps] = float(template @ patch)
        return compared[steps]

    similarity(0)
    wanted = reference.aspect.follow(
        np.asarray(box), np.asarray(INITIAL_SIZE), similarity, known, rested=rested > 0
    )
    # But for what float32 may round to the other side.
    values = np.array(list(compared.values()))
    score = values - cost * np.log(STEP) * np.abs(taken + np.array(list(compared)))
    apart = np.concatenate(
        [
            np.diff(np.sort(score)),
            np.diff(np.sort(values)),
            np.abs(values - similar_above),
            np.abs(values - compared[0] - gain_above),
        ]
    )
    assume(apart.min() > 1e-4)
    initial = jnp.asarray(template, jnp.float32)
    found = follow(box, initial, integral(window), settings, rested)
    np.testing.assert_allclose(found, wanted, rtol=1e-4)


def test_an_object_that_looks_the_same_keeps_its_ratio():
    assert followed(0, seen(1)) == 0
    # By a parabola, between two steps.
    settings = AspectRatio(cost=0.0)
    assert followed(5, seen(1), settings) == pytest.approx(0, abs=0.1)
    assert followed(5, seen(1, STEP**0.4), settings) == pytest.approx(0.4, abs=0.1)


@pytest.mark.parametrize("steps", [-4, 4])
def test_one_that_is_surely_narrower_or_flatter_is_followed(steps):
    window = seen(1, STEP**steps)
    assert followed(0, window) == pytest.approx(steps, abs=1e-3)
    # Where it is not more alike than that, or gains no more, it is not.
    assert followed(0, window, AspectRatio(similar_above=0.999)) == 0
    assert followed(0, window, AspectRatio(gain_above=0.9)) == 0
    # Another object is no narrower one.
    assert followed(0, seen(2, STEP**steps)) == 0


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_ratio_that_was_taken_is_followed_step_by_step(sign):
    assert followed(4 * sign, seen(1, STEP ** (2 * sign))) == pytest.approx(sign, abs=1e-3)
    assert followed(4 * sign, seen(1, STEP**-sign)) == pytest.approx(-sign, abs=1e-3)
    # Not as far as the ratio is three times the first one.
    assert followed(18 * sign, seen(1, STEP ** (2 * sign))) == pytest.approx(0, abs=1e-3)


@pytest.mark.parametrize("taken", [-6, 3, 18])
def test_the_first_ratio_is_taken_again_where_it_is_more_alike(taken):
    assert followed(taken, seen(1, STEP**-taken)) == pytest.approx(-taken, abs=1e-3)


@pytest.mark.parametrize("taken", [-1.2, 1.2])
def test_one_that_is_all_but_the_first_is_the_first(taken):
    assert followed(taken, seen(1, STEP ** (-taken * 0.8))) == pytest.approx(-taken, abs=1e-3)


@pytest.mark.parametrize("steps", [-4, 4])
def test_the_first_ratio_is_left_in_a_frame_that_is_learned_from(steps):
    window = seen(1, STEP**steps)
    assert followed(0, window, rested=1) == 0
    # One that was left is followed in all of them.
    assert followed(steps, seen(1, STEP ** (steps / 2)), rested=1) == pytest.approx(
        np.sign(steps), abs=1e-3
    )


@pytest.mark.parametrize("taken", [0, 4])
def test_an_object_that_keeps_its_size_keeps_its_ratio(taken):
    assert followed(taken, seen(1, STEP**4), resized=False) == pytest.approx(0, abs=1e-3)


def test_a_cost_keeps_the_first_ratio():
    window = seen(1, STEP**2)
    assert followed(4, window) == pytest.approx(1, abs=1e-3)
    assert followed(4, window, AspectRatio(cost=1e3)) < 0


def test_many_boxes_at_once_are_those_of_each():
    windows = jnp.stack([integral(seen(1, STEP**steps)) for steps in (-4, 0, 4)])
    boxes = jnp.stack([box_of(0), box_of(3), box_of(-3)])
    initial = description_of(integral(seen(1)))
    together = jax.vmap(lambda box, window: follow(box, initial, window, SETTINGS))(boxes, windows)
    for box, window, found in zip(boxes, windows, together, strict=True):
        np.testing.assert_allclose(found, follow(box, initial, window, SETTINGS), rtol=1e-5)
