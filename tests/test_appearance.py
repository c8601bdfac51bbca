"""The description of the object, and recognition by it."""

import jax.numpy as jnp
import numpy as np
import pytest
import reference
from hypothesis import given
from hypothesis import strategies as st
from reference import gradients as expected
from scipy import ndimage

from dcs_jax.config import Config
from dcs_jax.extensions import appearance
from dcs_jax.types import Appearance

CONFIG = Config(canvas=(24, 20), sizes=5)


def described(cells: np.ndarray, displacement=(0.0, 0.0)) -> np.ndarray:
    integral = jnp.asarray(reference.integral(cells), jnp.float32)
    return np.asarray(appearance.describe(integral, jnp.asarray(displacement, jnp.float32), CONFIG))


def window(seed: int) -> np.ndarray:
    generator = np.random.default_rng(seed)
    return ndimage.gaussian_filter(generator.normal(size=CONFIG.grid.window), 1.5) * 200


@given(seed=st.integers(0, 2**31), down=st.floats(-12, 12), across=st.floats(-12, 12))
def test_descriptions_are_those_of_the_reference(seed, down, across):
    cells = window(seed)
    down, across = float(np.float32(down)), float(np.float32(across))
    wanted = expected.describe_sizes(
        cells, np.array([down, across]), CONFIG.sizes, float(CONFIG.size_step), CONFIG.grid
    )
    np.testing.assert_allclose(described(cells, (down, across)), wanted, atol=1e-3)


@given(seed=st.integers(0, 2**31), constant=st.integers(-100, 100))
def test_a_constant_added_to_grey_changes_nothing(seed, constant):
    cells = window(seed)
    # Up to the rounding of larger sums.
    np.testing.assert_allclose(described(cells), described(cells + constant), atol=2e-3)


@given(seed=st.integers(0, 2**31), contrast=st.floats(0.5, 2))
def test_contrast_keeps_the_description_nearly_the_same(seed, contrast):
    cells = window(seed)
    alike = (described(cells) * described(cells * contrast)).sum(1)
    assert alike.min() > 0.99


@given(seed=st.integers(0, 2**31))
def test_similarity_and_confidence_are_those_of_the_reference(seed):
    generator = np.random.default_rng(seed)
    first, recent, now = generator.normal(size=(3, 20)).astype(np.float32)
    first, now = (vector / np.linalg.norm(vector) for vector in (first, now))
    seen = Appearance(jnp.asarray(first), jnp.asarray(recent))
    alike = appearance.similarity(seen, jnp.asarray(now), CONFIG)
    wanted = expected.similarity(first, recent, now, float(CONFIG.recent_penalty))
    assert alike == pytest.approx(wanted, abs=1e-5)
    middle, slope = float(CONFIG.confidence_middle), float(CONFIG.confidence_slope)
    assert appearance.confidence(alike, CONFIG) == pytest.approx(
        expected.confidence(wanted, middle, slope), abs=1e-4
    )


def test_what_was_learned_is_recognised_and_remembered():
    one, other = described(window(1))[2], described(window(2))[2]
    seen = Appearance(jnp.asarray(one), jnp.asarray(one))
    assert appearance.similarity(seen, jnp.asarray(one), CONFIG) == pytest.approx(1, abs=1e-4)
    later = appearance.remember(seen, jnp.asarray(other), CONFIG)
    np.testing.assert_array_equal(later.first, one)
    wanted = one + np.float32(CONFIG.recent_rate) * (other - one)
    np.testing.assert_allclose(later.recent, wanted, atol=1e-6)
