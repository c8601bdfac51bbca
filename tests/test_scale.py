"""The scale filter."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from hypothesis import given
from hypothesis import strategies as st
from reference import scale as expected
from textures import integral, texture

from dcs_jax.config import Config, ScaleFilter
from dcs_jax.extensions import scale
from dcs_jax.extensions.descriptors import describe

GRID = Config(canvas=(24, 20)).grid
SETTINGS = ScaleFilter()
HERE = jnp.zeros(2, jnp.float32)


def describe_all(seed: int, zoom: float) -> jax.Array:
    return describe(integral(texture(GRID, seed, zoom)), HERE, scale.factors(SETTINGS), GRID)


@given(seed=st.integers(0, 2**31), zoom=st.sampled_from([0.92, 1.0, 1.05]))
def test_the_filter_is_that_of_the_reference(seed, zoom):
    first, second = (np.asarray(describe_all(seed, factor)) for factor in (1.0, zoom))
    steps = scale.estimate(scale.init(jnp.asarray(first)), jnp.asarray(second))
    trained = expected.init(first.astype(float))
    assert steps == pytest.approx(expected.estimate(trained, second.astype(float)), abs=1e-3)


@given(
    box=st.tuples(*[st.floats(2, 300)] * 4),
    initial=st.tuples(*[st.floats(2, 300)] * 2),
    similarity=st.floats(-1, 1),
    steps=st.floats(-60, 60),
)
def test_pull_and_resized_box_are_those_of_the_reference(box, initial, similarity, steps):
    box, initial, steps = np.float32(box), np.float32(initial), np.float32(steps)
    settings, shape = reference.ScaleFilter(**dataclasses.asdict(SETTINGS)), (240, 320)
    pull = scale.pull(jnp.asarray(box), jnp.asarray(initial), jnp.float32(similarity), SETTINGS)
    assert pull == pytest.approx(expected.pull(box, initial, similarity, settings), abs=1e-3)
    resized = scale.resize(jnp.asarray(box), jnp.float32(steps), shape, SETTINGS)
    wanted = expected.resize(box.astype(float), float(steps), shape, settings)
    np.testing.assert_allclose(resized, wanted, rtol=1e-4, atol=1e-3)


@given(seed=st.integers(0, 2**31))
def test_the_steps_are_none_on_the_same_patch_and_have_the_sign_of_growth(seed):
    same, grown, shrunk = (describe_all(seed, SETTINGS.step**steps) for steps in (0, 2, -2))
    trained = scale.init(same)
    assert abs(scale.estimate(trained, same)) < 0.05
    # On a texture at random, fine and alike everywhere, it answers with less than the two steps.
    assert scale.estimate(trained, grown) > 0
    assert scale.estimate(trained, shrunk) < 0


def test_the_box_is_resized_around_its_centre_within_limits():
    box = jnp.array([10.0, 20.0, 40.0, 30.0])
    for steps in (-3.0, 0.0, 2.5):
        x, y, w, h = np.asarray(scale.resize(box, jnp.float32(steps), (240, 320), SETTINGS))
        np.testing.assert_allclose([x + w / 2, y + h / 2], [30, 35], atol=1e-3)
        np.testing.assert_allclose([w, h], np.array([40, 30]) * 1.04**steps, rtol=1e-4)
    least = scale.resize(box, jnp.float32(-200.0), (240, 320), SETTINGS)
    most = scale.resize(box, jnp.float32(200.0), (240, 320), SETTINGS)
    np.testing.assert_allclose(least[2:], [8 * 40 / 30, 8], rtol=1e-4)
    np.testing.assert_allclose(most[2:], [320, 240], rtol=1e-4)


@pytest.mark.parametrize("similarity", [0.0, 0.5, 1.0])
def test_the_pull_is_a_share_of_the_grown_steps(similarity):
    box, initial = jnp.array([0.0, 0, 40 * 1.04**6, 30 * 1.04**6]), jnp.array([40.0, 30.0])
    found = scale.pull(box, initial, jnp.float32(similarity), SETTINGS)
    assert found == pytest.approx(6 * SETTINGS.initial_pull * (1 - similarity), abs=1e-4)
