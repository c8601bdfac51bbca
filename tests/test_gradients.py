"""Histograms of oriented gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference.gradients import gradient_cells as expected_cells

from dcs_jax.extensions.gradients import gradient_cells

cells_of = jax.jit(gradient_cells, static_argnums=(1, 2))


def random_grey(seed: int, shape: tuple[int, int]) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, shape).astype(np.float32)


@given(
    seed=st.integers(0, 2**31),
    shape=st.sampled_from([(12, 12), (13, 17), (9, 20)]),
    cell=st.sampled_from([1, 3, 4]),
    bilinear=st.booleans(),
)
def test_cells_are_those_of_the_reference(seed, shape, cell, bilinear):
    grey = random_grey(seed, shape)
    expected = expected_cells(grey, cell, bilinear)
    np.testing.assert_allclose(cells_of(grey, cell, bilinear), expected, atol=1e-3)


@given(seed=st.integers(0, 2**31), constant=st.integers(-255, 255))
def test_a_constant_added_to_grey_changes_nothing(seed, constant):
    grey = random_grey(seed, (13, 17))
    np.testing.assert_array_equal(cells_of(grey, 4), cells_of(grey + np.float32(constant), 4))


@pytest.mark.parametrize("orientation", range(0, 8, 2))
def test_a_slope_counts_most_in_its_own_orientation(orientation):
    rows, columns = np.mgrid[:12, :12] * 10.0
    angle = orientation * np.pi / 4
    slope = jnp.asarray(np.cos(angle) * columns + np.sin(angle) * rows, jnp.float32)
    assert (cells_of(slope, 4).argmax(0) == orientation).all()


def test_a_plain_surface_has_no_gradient():
    assert not cells_of(jnp.full((12, 12), 77.0), 4).any()
