"""Descriptions of patches."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import reference
from hypothesis import given
from hypothesis import strategies as st
from reference import descriptors as expected
from scipy import ndimage

from dcs_jax.config import Config, ScaleFilter
from dcs_jax.extensions import scale
from dcs_jax.extensions.descriptors import describe

GRID = Config(canvas=(24, 20)).grid
SCALES = ScaleFilter(num_scales=5)


def described(cells: np.ndarray, displacement=(0.0, 0.0)) -> np.ndarray:
    integral = jnp.asarray(reference.integral(cells), jnp.float32)
    return np.asarray(
        describe(integral, jnp.asarray(displacement, jnp.float32), scale.factors(SCALES), GRID)
    )


def window(seed: int) -> np.ndarray:
    generator = np.random.default_rng(seed)
    return ndimage.gaussian_filter(generator.normal(size=GRID.window), 1.5) * 200


# As far as the window goes, beyond which larger scales reach.
@given(seed=st.integers(0, 2**31), down=st.floats(-18, 18), across=st.floats(-15, 15))
def test_descriptions_are_those_of_the_reference(seed, down, across):
    cells = window(seed)
    down, across = float(np.float32(down)), float(np.float32(across))
    factors = reference.scale.factors(reference.ScaleFilter(**dataclasses.asdict(SCALES)))
    wanted = expected.describe_scales(cells, np.array([down, across]), factors, GRID)
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


@given(seed=st.integers(0, 2**31), down=st.floats(-12, 12), across=st.floats(-12, 12))
def test_without_a_scale_filter_there_is_the_description_at_the_own_scale(seed, down, across):
    integral = jnp.asarray(reference.integral(window(seed)), jnp.float32)
    displacement = jnp.array([down, across], jnp.float32)
    alone = describe(integral, displacement, scale.factors(None), GRID)
    assert alone.shape[0] == 1
    every = describe(integral, displacement, scale.factors(SCALES), GRID)
    np.testing.assert_allclose(alone[0], every[2], atol=1e-5)


@given(seed=st.integers(0, 2**31), stripes=st.floats(0, 50))
def test_no_orientation_prevails(seed, stripes):
    cells = window(seed) + stripes * np.arange(GRID.window[1]) % 7
    by_orientation = described(cells).reshape(len(scale.factors(SCALES)), 8, -1)
    np.testing.assert_allclose(by_orientation.mean(2), 0, atol=1e-6)
    np.testing.assert_allclose(np.square(by_orientation).sum((1, 2)), 1, atol=1e-4)
