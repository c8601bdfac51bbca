"""The correlation filters of place and size."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from hypothesis import given
from hypothesis import strategies as st
from reference import correlation as expected
from scipy import ndimage

from dcs_jax.config import Config
from dcs_jax.extensions import correlation
from dcs_jax.extensions.appearance import describe

CONFIG = Config(canvas=(24, 20))
GRID = CONFIG.grid
HERE = jnp.zeros(2, jnp.float32)


def window(seed: int, zoom: float = 1.0, shift: tuple[int, int] = (0, 0)) -> np.ndarray:
    """Soft random cells of a window [Gy, Gx], enlarged around the middle or moved."""
    cells = ndimage.gaussian_filter(np.random.default_rng(seed).normal(size=(200, 200)), 1.5) * 200
    rows, columns = GRID.window
    down = (np.arange(rows) - (rows - 1) / 2) / zoom + 100 - shift[0]
    across = (np.arange(columns) - (columns - 1) / 2) / zoom + 100 - shift[1]
    return ndimage.map_coordinates(cells, np.meshgrid(down, across, indexing="ij"), order=3)


def integral(cells: np.ndarray) -> jax.Array:
    return jnp.asarray(reference.integral(cells), jnp.float32)


def describe_all(cells: np.ndarray) -> jax.Array:
    return describe(integral(cells), HERE, CONFIG)


# Sums of an integral image in float32 are exact to some 1e-3 grey values, and a weak frequency
# divides that by the ridge, a hundredth of the mean power.
@given(seed=st.integers(0, 2**31))
def test_place_filter_and_answer_are_those_of_the_reference(seed):
    first, second = window(seed), window(seed, shift=(2, -1))
    learned = correlation.learn_place(integral(first), GRID)
    place = expected.learn_place(first, GRID)
    # Of the last axis, half of the frequencies.
    half = place[1].shape[1] // 2 + 1
    for found, wanted in zip(learned, (part[..., :half] for part in place), strict=True):
        np.testing.assert_allclose(found, wanted, atol=1e-3 * np.abs(wanted).max())
    answer = correlation.place_answer(learned, integral(second), GRID)
    np.testing.assert_allclose(answer, expected.place_answer(place, second, GRID), atol=4e-3)


@given(seed=st.integers(0, 2**31), down=st.integers(-3, 3), across=st.integers(-3, 3))
def test_the_answer_peaks_at_the_displacement_of_a_shifted_window(seed, down, across):
    place = correlation.learn_place(integral(window(seed)), GRID)
    shift = (2 * down, 2 * across)  # whole cells of the filter
    answer = correlation.place_answer(place, integral(window(seed, shift=shift)), GRID)
    row, column = np.unravel_index(np.argmax(answer), answer.shape)
    found = row - GRID.margin_rows, column - GRID.margin_columns
    np.testing.assert_allclose(found, shift, atol=1)


@given(seed=st.integers(0, 2**31), zoom=st.sampled_from([0.92, 1.0, 1.05]))
def test_size_filter_is_that_of_the_reference(seed, zoom):
    first, second = (np.asarray(describe_all(window(seed, scale))) for scale in (1.0, zoom))
    steps = correlation.size_steps(correlation.learn_size(jnp.asarray(first)), jnp.asarray(second))
    size = expected.learn_size(first.astype(float))
    assert steps == pytest.approx(expected.size_steps(size, second.astype(float)), abs=1e-3)


@given(seed=st.integers(0, 2**31))
def test_the_size_steps_are_none_on_the_same_patch_and_have_the_sign_of_growth(seed):
    same, grown, shrunk = (
        describe_all(window(seed, CONFIG.size_step**steps)) for steps in (0, 2, -2)
    )
    size = correlation.learn_size(same)
    assert abs(correlation.size_steps(size, same)) < 0.05
    # On a texture at random, fine and alike everywhere, it answers with less than the two steps.
    assert correlation.size_steps(size, grown) > 0
    assert correlation.size_steps(size, shrunk) < 0


@given(peak=st.floats(-0.5, 0.5), curvature=st.floats(0.1, 50), height=st.floats(-10, 10))
def test_a_parabola_has_its_peak_found(peak, curvature, height):
    values = [jnp.float32(height - curvature * (x - peak) ** 2) for x in (-1, 0, 1)]
    assert correlation.parabola_peak(*values) == pytest.approx(peak, abs=1e-3)
    assert expected.parabola_peak(*map(float, values)) == pytest.approx(peak, abs=1e-3)


@pytest.mark.parametrize(
    "values", [(-np.inf, 1, 0), (0, 1, -np.inf), (-np.inf, 1, -np.inf), (1, 1, 1), (2, 1, 2)]
)
def test_at_an_edge_and_without_a_peak_nothing_is_added(values):
    assert correlation.parabola_peak(*map(jnp.float32, values)) == 0
    assert expected.parabola_peak(*values) == 0
