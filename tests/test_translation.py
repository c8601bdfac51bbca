"""The translation filter."""

import jax
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from reference import filters
from reference import translation as expected
from textures import integral, texture

from dcs_jax.config import Config, TranslationFilter
from dcs_jax.extensions import translation

CONFIG = Config(canvas=(24, 20))
GRID = CONFIG.grid


def spectrum(cells: np.ndarray) -> jax.Array:
    return translation.spectrum(integral(cells), GRID)


def window(seed: int, shift: tuple[int, int] = (0, 0)) -> np.ndarray:
    return texture(GRID, seed, shift=shift)


# Sums of an integral image in float32 are exact to some 1e-3 grey values, and a weak frequency
# divides that by the ridge, a hundredth of the mean power.
@given(seed=st.integers(0, 2**31))
def test_filter_and_response_are_those_of_the_reference(seed):
    first, second = window(seed), window(seed, shift=(2, -1))
    learned = translation.train(spectrum(first), GRID)
    trained = expected.train(first, GRID)
    # Of the last axis, half of the frequencies.
    half = trained[1].shape[1] // 2 + 1
    for found, wanted in zip(learned, (part[..., :half] for part in trained), strict=True):
        np.testing.assert_allclose(found, wanted, atol=1e-3 * np.abs(wanted).max())
    response = translation.response(learned, spectrum(second), GRID)
    np.testing.assert_allclose(response, expected.response(trained, second, GRID), atol=4e-3)


@given(seed=st.integers(0, 2**31), down=st.integers(-3, 3), across=st.integers(-3, 3))
def test_the_response_peaks_at_the_displacement_of_a_shifted_window(seed, down, across):
    trained = translation.train(spectrum(window(seed)), GRID)
    shift = (2 * down, 2 * across)  # whole cells of the filter
    response = translation.response(trained, spectrum(window(seed, shift=shift)), GRID)
    row, column = np.unravel_index(np.argmax(response), response.shape)
    found = row - GRID.margin_rows, column - GRID.margin_columns
    np.testing.assert_allclose(found, shift, atol=1)


def test_the_first_frame_keeps_its_weight_in_the_score():
    first, later = window(1), window(2)
    settings = TranslationFilter(weight=2.0, learning_rate=0.5, first_frame=0.25)
    initial = translation.init(spectrum(first), GRID)
    state = translation.update(initial, spectrum(later), settings, GRID)
    np.testing.assert_array_equal(state.first_frame.numerator, initial.running.numerator)
    one, other = (expected.train(cells, GRID) for cells in (first, later))
    mixed = filters.interpolate(one, other, 0.5 * (1 - 0.25))
    score = translation.score(state, spectrum(later), settings, GRID)
    np.testing.assert_allclose(score, 2 * expected.response(mixed, later, GRID), atol=1e-2)
