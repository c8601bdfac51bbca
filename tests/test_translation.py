"""The translation filter."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from layout import reference_settings
from reference import filters
from reference import translation as expected
from textures import integral, texture

from dcs_jax.config import Config, TranslationFilter
from dcs_jax.core.window import place
from dcs_jax.extensions import translation

CONFIG = Config(canvas=(24, 20))
GRID = CONFIG.grid
SETTINGS = CONFIG.translation
assert SETTINGS is not None
FRAME = (900, 900)
BOX = jnp.array([400, 400, 40, 48], jnp.float32)  # of two pixels a cell


def features(cells: np.ndarray) -> jax.Array:
    return translation.features(integral(cells), GRID)


def middle_of(response: jax.Array, box: jax.Array, config: Config) -> jax.Array:
    return translation.search_middle(response, place(box, config), FRAME, config)


def window(seed: int, shift: tuple[int, int] = (0, 0)) -> np.ndarray:
    return texture(GRID, seed, shift=shift)


# Sums of an integral image in float32 are exact to some 1e-3 grey values, and a weak frequency
# divides that by the ridge, a hundredth of the mean power.
@given(
    seed=st.integers(0, 2**31),
    shift=st.tuples(st.integers(-20, 20), st.integers(-20, 20)),
    prior=st.sampled_from([0.0, 0.6]),
)
def test_filter_and_score_are_those_of_the_reference(seed, shift, prior):
    config = dataclasses.replace(CONFIG, prior=prior)
    settings = reference_settings(config)
    first, second = window(seed), window(seed, shift=shift)
    state = translation.init(features(first), SETTINGS, GRID)
    trained = expected.train(first, settings.translation, GRID)
    # Of the last axis, half of the frequencies.
    half = trained[1].shape[1] // 2 + 1
    for found, part in zip(state.running, trained, strict=True):
        wanted = part[..., :half]
        np.testing.assert_allclose(found, wanted, atol=1e-3 * np.abs(wanted).max())
    response = translation.respond(state, features(second), SETTINGS)
    of_reference = expected.respond(
        expected.init(first, settings.translation, GRID), second, settings.translation, GRID
    )
    middle = middle_of(response, BOX, config)
    assert (np.asarray(middle) % 2 == 0).all()
    best = expected.search_middle(of_reference, lambda _: 0.0, np.asarray(BOX), FRAME, settings)
    scores = [expected.score(of_reference, np.asarray(m), settings) for m in (middle, best)]
    np.testing.assert_allclose(translation.score(response, middle, config), scores[0], atol=0.06)
    # Of two cells that are as good up to rounding either may be taken.
    at = CONFIG.search_grid.margin_rows, CONFIG.search_grid.margin_columns
    assert scores[0][at] > scores[1][at] - 0.06


@given(
    seed=st.integers(0, 2**31),
    down=st.floats(-11, 11),
    across=st.floats(-9, 9),
    rate=st.floats(0, 1),
)
def test_responses_are_those_of_the_reference(seed, down, across, rate):
    settings = TranslationFilter(learning_rate=rate)
    of_reference = reference_settings(CONFIG).translation
    windows = window(seed), window(seed + 1), window(seed, shift=(3, 2))
    state = translation.init(features(windows[0]), settings, GRID)
    state = translation.update(state, features(windows[1]), settings, GRID)
    known = expected.init(windows[0], of_reference, GRID)
    second = expected.train(windows[1], of_reference, GRID)
    known = known._replace(running=filters.interpolate(known.running, second, rate))
    at = np.array([down, across], np.float32)
    found = translation.responses(state, features(windows[2]), jnp.asarray(at), GRID)
    wanted = expected.responses(known, windows[2], at, GRID)
    np.testing.assert_allclose(found, wanted, atol=4e-3)


@given(seed=st.integers(0, 2**31))
def test_both_respond_where_all_is_as_it_was_learned(seed):
    seen = features(window(seed))
    state = translation.init(seen, SETTINGS, GRID)
    here = translation.responses(state, seen, jnp.zeros(2), GRID)
    elsewhere = translation.responses(state, seen, jnp.asarray([12.0, 9.0]), GRID)
    assert here > 1.5
    assert abs(elsewhere) < here / 4


@given(seed=st.integers(0, 2**31), down=st.integers(-11, 11), across=st.integers(-9, 9))
def test_the_score_peaks_at_the_displacement_of_a_shifted_window(seed, down, across):
    state = translation.init(features(window(seed)), SETTINGS, GRID)
    shift = np.array([2 * down, 2 * across])  # whole cells of the filter
    response = translation.respond(state, features(window(seed, shift=tuple(shift))), SETTINGS)
    middle = middle_of(response, BOX, CONFIG)
    np.testing.assert_allclose(middle, shift, atol=2)
    score = translation.score(response, middle, CONFIG)
    row, column = np.unravel_index(np.argmax(score), score.shape)
    margins = CONFIG.search_grid.margin_rows, CONFIG.search_grid.margin_columns
    np.testing.assert_allclose(np.subtract((row, column), margins) + middle, shift, atol=1)


def test_a_window_of_one_colour_is_searched_in_its_middle():
    state = translation.init(features(window(1)), SETTINGS, GRID)
    flat = translation.respond(state, features(np.zeros(GRID.window)), SETTINGS)
    config = dataclasses.replace(CONFIG, prior=0.0)
    np.testing.assert_array_equal(middle_of(flat, BOX, config), 0)


def test_the_search_window_keeps_to_what_the_filter_sees_and_the_box_to_the_frame():
    state = translation.init(features(window(3)), SETTINGS, GRID)
    response = translation.respond(state, features(window(3, shift=(30, 26))), SETTINGS)
    limits = (
        GRID.margin_rows - CONFIG.search_grid.margin_rows,
        GRID.margin_columns - CONFIG.search_grid.margin_columns,
    )
    middle = middle_of(response, BOX, CONFIG)
    assert (np.abs(middle) <= limits).all()
    corner = BOX.at[:2].set(0)
    response = translation.respond(state, features(window(3, shift=(-8, -8))), SETTINGS)
    assert (np.asarray(middle_of(response, corner, CONFIG)) >= 0).all()


def test_the_first_frame_keeps_its_weight_in_the_score():
    first, later = window(1), window(2)
    settings = TranslationFilter(weight=2.0, learning_rate=0.5, first_frame=0.25)
    of_reference = reference_settings(dataclasses.replace(CONFIG, translation=settings)).translation
    initial = translation.init(features(first), SETTINGS, GRID)
    state = translation.update(initial, features(later), settings, GRID)
    np.testing.assert_array_equal(state.first_frame.numerator, initial.running.numerator)
    one, other = (expected.train(cells, of_reference, GRID) for cells in (first, later))
    mixed = filters.interpolate(one, other, 0.5 * (1 - 0.25))
    response = translation.respond(state, features(later), settings)
    half = response.shape[1]
    wanted = 2 * expected.response(mixed, later, GRID)[:, :half]
    np.testing.assert_allclose(response, wanted, atol=2e-3 * np.abs(wanted).max())


@given(
    seed=st.integers(0, 2**31),
    down=st.sampled_from([-8, 8]),
    across=st.sampled_from([-6, 6]),
)
def test_an_object_that_moves_before_a_still_background_is_followed(seed, down, across):
    background, card = window(seed), window(seed + 1)
    top, left = GRID.margin_rows, GRID.margin_columns

    def scene(down: int, across: int) -> jax.Array:
        cells = background.copy()
        y, x = top + down, left + across
        cells[y : y + GRID.rows, x : x + GRID.columns] = card[: GRID.rows, : GRID.columns]
        return features(cells)

    def found(settings: TranslationFilter) -> list[int]:
        state = translation.init(scene(0, 0), settings, GRID)
        response = translation.respond(state, scene(down, across), settings)
        score = translation.score(response, jnp.zeros(2, jnp.int32), CONFIG)
        row, column = np.unravel_index(np.argmax(score), score.shape)
        searched = CONFIG.search_grid
        return [int(row) - searched.margin_rows, int(column) - searched.margin_columns]

    np.testing.assert_allclose(found(TranslationFilter()), [down, across], atol=1)
    # The background is the larger part of what this one learns.
    np.testing.assert_allclose(found(TranslationFilter(learned_factor=100)), [0, 0], atol=1)
