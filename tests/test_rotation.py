"""The rotation filter, and the canvas that turns with the object."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from hypothesis import given
from hypothesis import strategies as st
from reference import rotation as expected
from scipy import ndimage
from textures import integral, texture

from dcs_jax.config import Config, RotationFilter
from dcs_jax.core.window import turned
from dcs_jax.extensions import rotation
from dcs_jax.extensions.descriptors import describe

GRID = Config(canvas=(24, 20)).grid
SETTINGS = RotationFilter()
HERE = np.zeros(2)
seeds, aspects = st.integers(0, 2**31), st.floats(0.4, 2.5)
angles = st.floats(-np.pi, np.pi)
displacements = st.tuples(st.floats(-12, 12), st.floats(-12, 12))


def number(value: float) -> jax.Array:
    return jnp.asarray(value, jnp.float32)


def polar(cells: np.ndarray, displacement: np.ndarray, aspect: float) -> jax.Array:
    place = jnp.asarray(displacement, jnp.float32)
    return rotation.polar(integral(cells), place, number(aspect), GRID)


def turned_texture(seed: int, angle: float, aspect: float) -> np.ndarray:
    """Cells of the window around an object that has turned by an angle: [Gy, Gx]."""
    cells, middle = texture(GRID, seed), (np.array(GRID.window) - 1) / 2
    places = np.zeros((2, *GRID.window))
    for i, j in np.ndindex(*GRID.window):
        away = np.array([i, j]) - middle
        places[:, i, j] = middle + reference.turned(away, -angle, aspect)
    return ndimage.map_coordinates(cells, places, order=3, mode="nearest")


@given(seed=seeds, aspect=aspects, displacement=displacements)
def test_the_features_are_those_of_the_reference(seed, aspect, displacement):
    cells, displacement = texture(GRID, seed), np.array(displacement)
    found = polar(cells, displacement, aspect)
    wanted = expected.polar(cells, displacement, aspect, GRID)
    # Roots of differences near 0, of an integral image in float32.
    np.testing.assert_allclose(found, wanted, atol=0.01)
    assert np.sqrt(np.square(found).sum()) == pytest.approx(1, abs=1e-4)


@given(seed=seeds, angle=angles, most=st.sampled_from([rotation.MOST, rotation.ANGLES // 2]))
def test_the_filter_is_that_of_the_reference(seed, angle, most):
    first, second = (
        np.asarray(polar(turned_texture(seed, turn, 1.2), HERE, 1.2)) for turn in (0.0, angle)
    )
    trained = rotation.init(jnp.asarray(first)).first_frame
    found = rotation.estimate(trained, jnp.asarray(second), most)
    same = expected.init(first.astype(float)).first_frame
    assert found == pytest.approx(expected.estimate(same, second.astype(float), most), abs=1e-3)


@given(seed=seeds, angle=angles, aspect=aspects)
def test_the_estimate_is_the_angle_that_the_object_has_turned(seed, angle, aspect):
    state = rotation.init(polar(texture(GRID, seed), HERE, aspect))
    features = polar(turned_texture(seed, angle, aspect), HERE, aspect)
    for most in (rotation.MOST, rotation.ANGLES // 2):
        if abs(angle) < most * 2 * np.pi / rotation.ANGLES:
            found = rotation.estimate(state.first_frame, features, most)
            off = (found - angle + np.pi) % (2 * np.pi) - np.pi
            assert abs(off) < np.deg2rad(1.5)


@given(seed=seeds, angle=angles, aspect=aspects)
def test_the_turned_window_is_that_of_the_reference(seed, angle, aspect):
    cells = texture(GRID, seed)
    found = rotation.turn_window(integral(cells), number(angle), number(aspect))
    wanted = reference.integral(expected.turned_cells(cells, np.float32(angle), np.float32(aspect)))
    np.testing.assert_allclose(found, wanted, atol=1e-4 * np.abs(wanted).max())


@given(seed=seeds, angle=angles)
def test_on_the_turned_canvas_the_object_is_upright(seed, angle):
    aspect = 1.2
    window = integral(turned_texture(seed, angle, aspect))
    window = rotation.turn_window(window, number(angle), number(aspect))
    seen, upright = (
        describe(cells, jnp.zeros(2), np.ones(1), GRID)[0]
        for cells in (window, integral(texture(GRID, seed)))
    )
    assert (seen * upright).sum() > 0.97


def test_a_canvas_that_is_not_turned_is_as_it_is():
    window = integral(texture(GRID, 3))
    found = rotation.turn_window(window, number(0), number(1.3))
    np.testing.assert_array_equal(found, window)


@given(angle=angles, aspect=aspects, displacement=displacements)
def test_a_displacement_is_turned_as_in_the_reference_and_back(angle, aspect, displacement):
    turn = rotation.turn_by(number(angle), number(aspect))
    found = turned(turn, *map(number, displacement))
    wanted = reference.turned(np.array(displacement), angle, aspect)
    np.testing.assert_allclose(found, wanted, atol=1e-4)
    back = turned(rotation.turn_by(number(-angle), number(aspect)), *found)
    np.testing.assert_allclose(back, displacement, atol=1e-4)


@given(angle=angles)
def test_the_hull_is_that_of_the_turned_ellipse(angle):
    box = np.array([30.0, 40, 60, 20], np.float32)
    found = rotation.hull(jnp.asarray(box), number(angle))
    np.testing.assert_allclose(found, expected.hull(box.astype(float), angle), atol=1e-3)


def test_the_hull_of_a_box_that_has_not_turned_is_the_box():
    box = np.array([30.5, 40.25, 61.3, 20.7], np.float32)
    np.testing.assert_array_equal(rotation.hull(jnp.asarray(box), number(0)), box)
