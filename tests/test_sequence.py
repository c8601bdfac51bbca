"""Whole sequences: compilation, reproducibility, chunks, and what is refused."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from settings import SMALL_DEFAULT, WITHOUT_COMPONENTS

import dcs_jax
from dcs_jax import tracker
from dcs_jax.synthetic import render

SMALL = SMALL_DEFAULT


@pytest.fixture(scope="module")
def clip():
    return render(21, (120, 160), (36, 30))


def test_a_track_has_the_shapes_and_ranges_it_promises(clip):
    track = dcs_jax.track_sequence(clip.frames, clip.boxes[0], config=SMALL)
    assert track.boxes.shape == (21, 4)
    assert track.boxes.dtype == np.float32
    np.testing.assert_array_equal(track.boxes[0], clip.boxes[0])
    assert track.confidence.shape == (21,)
    assert track.part_scores.shape == (21, 5)
    for scores in (track.confidence, track.part_scores):
        assert ((scores >= 0) & (scores <= 1)).all()


def test_one_frame_is_a_sequence(clip):
    track = dcs_jax.track_sequence(clip.frames[:1], clip.boxes[0], config=SMALL)
    assert track.boxes.shape == (1, 4)
    inside = jax.eval_shape(dcs_jax.track_sequence, clip.frames[:1], clip.boxes[0], config=SMALL)
    assert jax.tree.map(jnp.shape, inside) == jax.tree.map(jnp.shape, track)


def test_another_box_key_number_or_length_compiles_nothing(clip, traces):
    frames = clip.frames[:6, :110]  # a shape no other test has: nothing is traced yet
    dcs_jax.track_sequence(frames, clip.boxes[0], config=SMALL)
    before = dict(traces)
    assert min(before.values()) >= 1
    for box in ((10, 20, 30, 40), [50.5, 20.25, 8, 60]):
        dcs_jax.track_sequence(frames, box, jax.random.key(7), SMALL)
        other = dataclasses.replace(SMALL, lam=0.5, smoothing=0.7, prior=0.1, overhang=0.2)
        dcs_jax.track_sequence(frames[:4], box, jax.random.key(8), other)
    dcs_jax.track_sequence(np.concatenate([frames] * 7), clip.boxes[0], config=SMALL)
    assert traces == before


def test_under_jit_it_is_the_same_track(clip):
    frames, box = clip.frames[:8], clip.boxes[0]
    key = jax.random.key(2)
    plain = dcs_jax.track_sequence(frames, box, key, SMALL)
    inside = jax.jit(dcs_jax.track_sequence)(frames, box, key, SMALL)
    np.testing.assert_allclose(inside.boxes, plain.boxes, atol=0.05)
    np.testing.assert_array_equal(inside.lost, plain.lost)


def test_the_same_key_gives_the_same_boxes_bit_for_bit(clip):
    one, two = (
        dcs_jax.track_sequence(clip.frames, clip.boxes[0], jax.random.key(3), SMALL)
        for _ in range(2)
    )
    assert jax.tree.all(jax.tree.map(lambda a, b: (a == b).all(), one, two))


def test_another_key_draws_other_features(clip):
    one, two = (
        dcs_jax.track_sequence(clip.frames, clip.boxes[0], jax.random.key(seed), SMALL)
        for seed in (3, 4)
    )
    assert (one.part_scores != two.part_scores).any()


# Each length is a program of its own, and the transforms of the size filter are rounded differently
# in each: with the components the boxes differ by some thousandths of a pixel.
@pytest.mark.parametrize(
    ("config", "tolerance"),
    [(dataclasses.replace(SMALL, **WITHOUT_COMPONENTS), 1e-3), (SMALL, 0.05)],
    ids=["paper", "default"],
)
@pytest.mark.parametrize("length", [1, 4, 20])
def test_chunks_are_the_whole(clip, length, config, tolerance):
    whole = dcs_jax.track_sequence(clip.frames, clip.boxes[0], jax.random.key(0), config)
    state = jax.jit(dcs_jax.init)(clip.frames[0], clip.boxes[0], jax.random.key(0), config)
    boxes = []
    for start in range(1, 21, length):
        state, infos = dcs_jax.track_chunk(state, clip.frames[start : start + length], config)
        boxes.append(infos.box)
    np.testing.assert_allclose(np.concatenate(boxes), whole.boxes[1:], atol=tolerance)


def test_grey_frames_and_their_rgb_copies_give_the_same_track(clip):
    grey = clip.frames[..., 1]
    rgb = np.repeat(grey[..., None], 3, axis=-1)
    one, two = (
        dcs_jax.track_sequence(frames, clip.boxes[0], config=SMALL) for frames in (grey, rgb)
    )
    np.testing.assert_array_equal(one.boxes, two.boxes)


def test_numpy_and_jax_frames_give_the_same_track(clip):
    one, two = (
        dcs_jax.track_sequence(frames, clip.boxes[0], config=SMALL)
        for frames in (clip.frames, jax.numpy.asarray(clip.frames))
    )
    np.testing.assert_array_equal(one.boxes, two.boxes)


FRAMES = np.zeros((3, 40, 60), np.uint8)
BOX = (10, 10, 20, 20)


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        (FRAMES[:0], r"frames must not be empty, but has the shape \(0, 40, 60\)"),
        (FRAMES[0], r"frames must be \[T, H, W\] grey or .*\(40, 60\)"),
        (FRAMES[None, None], r"but has the shape \(1, 1, 3, 40, 60\)"),
        (np.zeros((3, 40, 60, 4), np.uint8), r"3 channels .*\(3, 40, 60, 4\)"),
        (FRAMES.astype(np.float32), "must be uint8 .* but is float32"),
        (np.full((3, 40, 60), np.nan), "must be uint8 .* but is float64"),
        ([[1, 2]], "must be a NumPy or JAX array .* but is a list"),
    ],
)
def test_bad_frames_are_refused_before_any_compilation(frames, message, monkeypatch):
    monkeypatch.setattr(tracker, "init", None)  # nothing is traced
    with pytest.raises(ValueError, match=message):
        dcs_jax.track_sequence(frames, BOX)


@pytest.mark.parametrize(
    ("box", "message"),
    [
        ((1, 2, 3), r"four finite numbers .*shape \(3,\)"),
        ("abcd", "four finite numbers .* 'abcd'"),
        ((1, 2, np.nan, 4), r"four finite numbers .* \(1, 2, nan, 4\)"),
        ((1, 2, np.inf, 4), r"four finite numbers .* inf"),
        ((10, 10, 0, 20), r"positive width and height, but is \(10, 10, 0, 20\)"),
        ((10, 10, 20, -5), r"positive width and height, but is \(10, 10, 20, -5\)"),
        ((10, 10, 3, 20), r"at least 4 pixels .* \(10, 10, 3, 20\)"),
        ((60, 10, 20, 20), r"frame of 60 x 40 pixels, but \(60, 10, 20, 20\) is wholly outside"),
        ((10, -20, 20, 20), "wholly outside"),
        ((0, 0, 4e19, 20), r"at most 1e\+06 pixels wide and high, .* but is \(0, 0, 4e\+19, 20\)"),
        ((0, 0, 20, 1000001), "at most 1e.06 pixels wide and high"),
        ((0, 0, 10**400, 20), r"four finite numbers .* but is \(0, 0, 1000"),
        ((0, 0, "20", "20"), "four finite numbers .* but is"),
        ((0, 0, 20j, 20), "four finite numbers .* but is .*20j"),
        ((0, 0, None, 20), "four finite numbers .* None"),
    ],
)
def test_bad_boxes_are_refused_before_any_compilation(box, message, monkeypatch):
    monkeypatch.setattr(tracker, "init", None)  # nothing is traced
    with pytest.raises(ValueError, match=message):
        dcs_jax.track_sequence(FRAMES, box)


@pytest.mark.parametrize(
    "track",
    [
        lambda key: dcs_jax.track_sequence(FRAMES, BOX, key),
        lambda key: dcs_jax.init(FRAMES[0], BOX, key, SMALL),
        lambda key: jax.jit(dcs_jax.init)(FRAMES[0], BOX, key, SMALL),
    ],
    ids=["track_sequence", "init", "init under jit"],
)
def test_what_is_not_one_key_is_refused(track, monkeypatch):
    monkeypatch.setattr(tracker, "draw_pool", None)  # nothing is drawn
    with pytest.raises(ValueError, match=r"key must be made by jax\.random\.key\(seed\)"):
        track(np.zeros(2, np.uint32))
    with pytest.raises(ValueError, match=r"one key, but is an array of keys of shape \(2,\)"):
        track(jax.random.split(jax.random.key(0)))


@pytest.mark.parametrize("key", [0, "seed"])
def test_bad_keys_are_refused(key):
    with pytest.raises(ValueError, match=r"jax\.random\.key\(seed\)"):
        dcs_jax.track_sequence(FRAMES, BOX, key)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"state": None}, r"state must be a dcs_jax\.State, as init gives it, but is None"),
        ({"frames": FRAMES[0]}, r"frames must be \[T, H, W\] grey or .*\(40, 60\)"),
        ({"frames": FRAMES[:0]}, r"frames must not be empty, but has the shape \(0, 40, 60\)"),
        ({"frames": FRAMES.astype(float)}, "frames must be uint8 .* but is float64"),
        ({"frames": None}, "frames must be a NumPy or JAX array .* but is a NoneType"),
        ({"config": None}, r"config must be a dcs_jax\.Config, but is None"),
        (
            {"config": dataclasses.replace(SMALL, selectors=7)},
            r"state.strong.selected must have the shape \(5, 7\), .* but has \(5, 6\)",
        ),
        (
            {"config": dataclasses.replace(SMALL, pool_size=11)},
            r"state.pool.corners must have the shape \(9, 330\), .* but has \(9, 360\)",
        ),
        (
            {"config": dataclasses.replace(SMALL, weak="gaussian")},
            "config.weak is 'gaussian', but the state was initialised with another rule",
        ),
        (
            {"config": dataclasses.replace(SMALL, lam=np.ones(3))},
            r"config.lam must be one number here, but has the shape \(3,\)",
        ),
    ],
)
def test_a_chunk_of_bad_arguments_is_refused(arguments, message):
    key = jax.random.key(0)
    state = jax.eval_shape(dcs_jax.init, FRAMES[0], BOX, key, SMALL)
    with pytest.raises(ValueError, match=message):
        dcs_jax.track_chunk(**({"state": state, "frames": FRAMES, "config": SMALL} | arguments))


def test_a_filter_that_sees_another_window_is_refused():
    state = jax.eval_shape(dcs_jax.init, FRAMES[0], BOX, jax.random.key(0), SMALL_DEFAULT)
    config = dataclasses.replace(
        SMALL_DEFAULT, translation=dcs_jax.TranslationFilter(window_factor=3.0)
    )
    message = r"state\.translation must have .* \(30, 16\), .*window_factor=3, .* \(45, 23\)"
    with pytest.raises(ValueError, match=message):
        dcs_jax.track_chunk(state=state, frames=FRAMES, config=config)


def test_a_config_of_another_type_is_refused():
    with pytest.raises(ValueError, match=r"must be a dcs_jax\.Config, but is 'paper'"):
        dcs_jax.track_sequence(FRAMES, BOX, config="paper")
