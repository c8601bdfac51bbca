"""The rotation filter, and the canvas that turns with the object."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from hypothesis import assume, given
from hypothesis import strategies as st
from reference import rotation as expected
from scipy import ndimage
from settings import SMALL_DEFAULT
from textures import integral, texture, turned_frames

import dcs_jax
from dcs_jax.config import Config, RotationFilter
from dcs_jax.core.window import turned
from dcs_jax.evaluation.metrics import overlap
from dcs_jax.extensions import rotation
from dcs_jax.extensions.descriptors import describe
from dcs_jax.synthetic import render

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


def turn_window(window: jax.Array, angle: float, aspect: float) -> jax.Array:
    turn = rotation.turn_by(number(angle), number(aspect))
    return rotation.turn_window(window, number(angle), turn)


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
    found = turn_window(integral(cells), angle, aspect)
    wanted = reference.integral(expected.turned_cells(cells, np.float32(angle), np.float32(aspect)))
    np.testing.assert_allclose(found, wanted, atol=1e-4 * np.abs(wanted).max())


@given(seed=seeds, angle=angles)
def test_on_the_turned_canvas_the_object_is_upright(seed, angle):
    aspect = 1.2
    window = integral(turned_texture(seed, angle, aspect))
    window = turn_window(window, angle, aspect)
    seen, upright = (
        describe(cells, jnp.zeros(2), np.ones((1, 2)), GRID)[0]
        for cells in (window, integral(texture(GRID, seed)))
    )
    assert (seen * upright).sum() > 0.97


def test_a_canvas_that_is_not_turned_is_as_it_is():
    window = integral(texture(GRID, 3))
    found = turn_window(window, 0, 1.3)
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


@given(
    seed=seeds,
    angle=angles,
    held=st.one_of(st.just(0.0), angles),
    gain=st.floats(0, 0.6),
    confidence=st.floats(0, 1),
)
def test_a_frame_counts_as_in_the_reference(seed, angle, held, gain, confidence):
    aspect, held = 1.2, float(np.float32(held))
    cells = turned_texture(seed, angle, aspect)
    if held:
        cells = expected.turned_cells(cells, held, aspect)
    window, nowhere = integral(cells), jnp.zeros(2)
    first = texture(GRID, seed)
    description, initial = (
        describe(seen, nowhere, np.ones((1, 2)), GRID)[0] for seen in (window, integral(first))
    )
    trained = rotation.init(polar(first, HERE, aspect))
    state = trained._replace(angle=number(held), gain=number(gain))
    numbers = jax.tree.map(number, SETTINGS)
    found = rotation.follow(
        state,
        description,
        initial,
        number(confidence),
        window,
        nowhere,
        number(aspect),
        numbers,
        GRID,
    )

    def similarity(angle: float) -> float:
        seen = (
            reference.descriptors.describe(cells, HERE, 1.0, GRID)
            if angle == 0
            else expected.describe_turned(cells, HERE, angle, aspect, GRID)
        )
        return float(np.asarray(initial, float) @ seen)

    features = expected.polar(first, HERE, aspect, GRID)
    same = expected.init(features)._replace(angle=held, gain=gain)
    settings = reference.RotationFilter(**dataclasses.asdict(SETTINGS))
    wanted = expected.follow(
        same, expected.polar(cells, HERE, aspect, GRID), similarity, confidence, settings
    )
    # But for what rounding decides.
    limits = [
        wanted.gain - (SETTINGS.gain_below if held else SETTINGS.gain_above),
        abs(held or angle) - expected.LEAST,
        confidence - SETTINGS.follow_above,
        1 - similarity(0.0) - SETTINGS.gain_above,
    ]
    assume(min(map(abs, limits)) > 0.02)
    assert found.gain == pytest.approx(wanted.gain, abs=5e-3)
    off = (found.angle - wanted.angle + np.pi) % (2 * np.pi) - np.pi
    assert abs(off) < 5e-3


DEGREES = 2.0


def turning(length: int) -> tuple[np.ndarray, np.ndarray]:
    """Frames of a scene that turns around an object, and the box around its ellipse in each."""
    clip = render(1, (120, 160), (30, 42), lookalike=False, seed=4)
    frames = turned_frames(clip.frames[0], clip.boxes[0], DEGREES, length)
    boxes = [expected.hull(clip.boxes[0], np.deg2rad(DEGREES * frame)) for frame in range(length)]
    return frames, np.array(boxes)


def test_an_object_that_turns_once_around_is_followed():
    frames, boxes = turning(181)
    track = dcs_jax.track_sequence(frames, boxes[0], None, SMALL_DEFAULT)
    assert overlap(track.boxes, boxes).min() > 0.9
    assert not np.asarray(track.lost).any()
    without = dataclasses.replace(SMALL_DEFAULT, rotation=None)
    track = dcs_jax.track_sequence(frames, boxes[0], None, without)
    assert overlap(track.boxes, boxes).min() < 0.7


def test_in_a_batch_each_turns_by_itself():
    frames, boxes = turning(40)
    both = np.stack([frames, np.repeat(frames[:1], 40, axis=0)])
    tracks = dcs_jax.track_batch(both, np.stack([boxes[0]] * 2), None, SMALL_DEFAULT)
    for found, video in zip(tracks.boxes, both, strict=True):
        single = dcs_jax.track_sequence(video, boxes[0], None, SMALL_DEFAULT)
        np.testing.assert_array_equal(found, single.boxes)
    for found, wanted in zip(tracks.boxes, (boxes, boxes[[0] * 40]), strict=True):
        assert overlap(found, wanted).min() > 0.9


def angles_of(frames: np.ndarray, box: np.ndarray, config: Config) -> list[float]:
    """By how much the object has turned in each frame."""
    state, found = dcs_jax.init(frames[0], box, jax.random.key(0), config), []
    step = jax.jit(dcs_jax.step)
    for frame in frames[1:]:
        state, _ = step(state, frame, config)
        assert state.rotation
        found.append(float(state.rotation.angle))
    return found


def test_the_angle_is_that_of_the_frame():
    frames, boxes = turning(31)
    found = np.rad2deg(angles_of(frames, boxes[0], SMALL_DEFAULT))
    # Upright until it is clear that it turns.
    assert not found[:3].any()
    np.testing.assert_allclose(found[-15:], DEGREES * np.arange(16, 31), atol=3)


def test_what_does_not_turn_stays_upright():
    clip = render(30, (120, 160), (36, 30))
    assert not any(angles_of(clip.frames, clip.boxes[0], SMALL_DEFAULT))


def test_without_verification_nothing_turns():
    frames, boxes = turning(20)
    settings = dataclasses.replace(SMALL_DEFAULT, verification=None, redetection=None)
    assert not any(angles_of(frames, boxes[0], settings))
