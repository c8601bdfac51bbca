"""Many tracks in one call: each is the one that `track_sequence` gives."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from settings import SMALL, SMALL_DEFAULT

import dcs_jax
from dcs_jax import Config, TranslationFilter, Verification, tracker
from dcs_jax.runners import slots
from dcs_jax.runners.slots import Slots
from dcs_jax.synthetic import render

SHIFTS = np.array([(0, 0, 0, 0), (5, -4, 3, 8), (-9, 3, -6, 2)], np.float32)
KEYS = jax.vmap(jax.random.key)(jnp.arange(3))


@pytest.fixture(scope="module")
def clip():
    return render(39, (120, 160), (36, 30))


def assert_same(track, single):
    """The same boxes bit for bit; scores, of which nothing is computed, up to their rounding."""
    np.testing.assert_array_equal(track.boxes, single.boxes)
    for one, other in zip(track, single, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-6)


def row(tree, number):
    return jax.tree.map(lambda leaf: leaf[number], tree)


@pytest.mark.parametrize("grey", [False, True])
@pytest.mark.parametrize("keys", [None, KEYS], ids=["one-pool", "own-pools"])
def test_targets_of_different_size_in_one_video(clip, keys, grey):
    frames = clip.frames[..., 1] if grey else clip.frames
    boxes = clip.boxes[0] + SHIFTS
    tracks = dcs_jax.track_batch(frames, boxes, keys, SMALL)
    assert tracks.boxes.shape == (3, 39, 4)
    assert tracks.part_scores.shape == (3, 39, 5)
    for number in range(3):
        key = None if keys is None else keys[number]
        single = dcs_jax.track_sequence(frames, boxes[number], key, SMALL)
        assert_same(row(tracks, number), single)


@pytest.mark.parametrize("keys", [None, KEYS], ids=["one-key", "own-keys"])
def test_many_videos_and_a_sweep(clip, keys):
    frames = np.stack([np.roll(clip.frames, shift, 2) for shift in (0, 6, 12)])
    boxes = clip.boxes[0] + SHIFTS
    numbers: dict[str, Any] = {
        "block": np.array([0.2, 0.4, 0.6]),
        "lam": jnp.array([0.01, 0.1, 0.5]),
    }
    tracks = dcs_jax.track_batch(frames, boxes, keys, dataclasses.replace(SMALL, **numbers))
    for number in range(3):
        key = None if keys is None else keys[number]
        changes = {name: float(values[number]) for name, values in numbers.items()}
        config = dataclasses.replace(SMALL, **changes)
        single = dcs_jax.track_sequence(frames[number], boxes[number], key, config)
        assert_same(row(tracks, number), single)


def test_numbers_of_a_group_may_be_one_for_each_track(clip):
    rates = np.array([0.0, 0.02, 0.5], np.float32)
    groups = [TranslationFilter(learning_rate=rate) for rate in (rates, *rates)]
    swept, *configs = (dataclasses.replace(SMALL, translation=group) for group in groups)
    tracks = dcs_jax.track_batch(clip.frames[:15], [clip.boxes[0]] * 3, config=swept)
    for number, config in enumerate(configs):
        single = dcs_jax.track_sequence(clip.frames[:15], clip.boxes[0], config=config)
        np.testing.assert_allclose(tracks.boxes[number], single.boxes, atol=0.05)
    assert np.abs(tracks.boxes[0] - tracks.boxes[2]).max() > 0.1


def test_with_components_they_differ_by_rounding(clip):
    """The size of the box is a sum of many terms, which every program rounds in its own way."""
    boxes = clip.boxes[0] + SHIFTS
    tracks = dcs_jax.track_batch(clip.frames[:20], boxes, config=SMALL_DEFAULT)
    for number, box in enumerate(boxes):
        single = dcs_jax.track_sequence(clip.frames[:20], box, config=SMALL_DEFAULT)
        np.testing.assert_allclose(tracks.boxes[number], single.boxes, atol=0.05)
        np.testing.assert_array_equal(tracks.lost[number], single.lost)


def test_the_batch_has_no_part_in_a_track(clip):
    boxes = clip.boxes[0] + SHIFTS
    three = dcs_jax.track_batch(clip.frames, boxes, config=SMALL)
    one = dcs_jax.track_batch(clip.frames, boxes[1:2], config=SMALL)
    assert_same(row(one, 0), row(three, 1))


@pytest.mark.parametrize("length", [1, 6])
def test_the_length_of_the_chunks_has_no_part_in_a_track(clip, monkeypatch, length):
    boxes = clip.boxes[0] + SHIFTS
    whole = dcs_jax.track_batch(clip.frames, boxes, config=SMALL)
    monkeypatch.setattr(slots, "CHUNK_FRAMES", length)
    parts = dcs_jax.track_batch(jnp.asarray(clip.frames), boxes, config=SMALL)
    assert_same(parts, whole)


def test_one_frame_and_the_native_grid(clip):
    config = Config.paper(selectors=2, pool_size=4, window_minimum=0.0)
    track = dcs_jax.track_batch(clip.frames[:1], clip.boxes[:1], config=config)
    np.testing.assert_array_equal(track.boxes, clip.boxes[None, :1])


def test_other_boxes_keys_numbers_and_lengths_compile_nothing(clip, traces):
    frames = clip.frames[:, :104]  # a shape no other test has
    boxes = clip.boxes[0] + SHIFTS
    dcs_jax.track_batch(frames, boxes, config=SMALL)
    before = dict(traces)
    assert min(before.values()) >= 1
    other = dataclasses.replace(SMALL, lam=0.5, prior=np.array([0.1, 0.2, 0.3]))
    dcs_jax.track_batch(frames[:9], boxes * 0.9 + 3, jax.random.key(4), other)
    assert traces == before


def test_one_key_is_one_pool(clip):
    shape = clip.frames.shape[1:]
    assert Slots(3, shape, KEYS[0], SMALL).shared
    assert not Slots(3, shape, KEYS, SMALL).shared
    sweep = dataclasses.replace(SMALL, block=np.array([0.2, 0.3, 0.4]))
    assert not Slots(3, shape, KEYS[0], sweep).shared


FRAMES = np.zeros((3, 40, 60), np.uint8)
BOXES = [(10, 10, 20, 20), (12, 10, 24, 20)]


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        (FRAMES[0], r"frames must be \[T, H, W\] grey or .*\(40, 60\)"),
        (
            FRAMES[None, None, None],
            r"\[B, T, H, W\].*\(1, 1, 1, 3, 40, 60\)|\(1, 1, 1, 3, 40, 60\)",
        ),
        (FRAMES[None], r"\(1, 3, 40, 60\) are 1 videos, but there are 2 boxes"),
        (np.zeros((2, 3, 40, 60, 4), np.uint8), r"3 channels .*\(2, 3, 40, 60, 4\)"),
        (np.zeros((2, 0, 40, 60), np.uint8), "must not be empty"),
        (np.zeros((2, 3, 40, 60), np.float32), "must be uint8 .* but is float32"),
        ("frames", "must be a NumPy or JAX array"),
    ],
)
def test_bad_frames_are_refused_before_any_compilation(frames, message, monkeypatch):
    monkeypatch.setattr(tracker, "init", None)  # nothing is traced
    with pytest.raises(ValueError, match=message):
        dcs_jax.track_batch(frames, BOXES)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"boxes": BOXES[0]}, r"boxes must be \[B, 4\].*shape \(4,\)"),
        ({"boxes": np.zeros((0, 4))}, r"at least one box, but has the shape \(0, 4\)"),
        ({"boxes": [BOXES[0], "abcd"]}, r"boxes must be \[B, 4\]"),
        ({"boxes": [BOXES[0], (70, 0, 9, 9)]}, r"boxes\[1\]: box must lie at least partly"),
        ({"keys": 0}, r"jax\.random\.key\(seed\)"),
        ({"keys": KEYS}, r"one key for all 2 boxes or one for each, .* \(3,\)"),
        ({"config": "paper"}, r"must be a dcs_jax\.Config, but is 'paper'"),
        (
            {"config": dataclasses.replace(SMALL, lam=np.ones(3))},
            r"config\.lam must be one number for all tracks or \[2\], .* \(3,\)",
        ),
        (
            {"config": Config(verification=Verification(slope=np.ones(3)))},
            r"config\.verification\.slope must be one number for all tracks or \[2\], .* \(3,\)",
        ),
        (
            {"config": Config.paper(window_minimum=0.0)},
            r"boxes\[0\] has 20 x 20 pixels and boxes\[1\] 24 x 20: expected boxes of one size",
        ),
        (
            {"config": Config(window_minimum=80.0), "boxes": [BOXES[0], (9, 9, 25, 25)]},
            "window_minimum=80.0 takes its shape from the box",
        ),
        ({"mesh": jax.make_mesh((1,), ("x",))}, r'mesh must have an axis "batch".*\(.x.,\)'),
    ],
)
def test_bad_arguments_are_refused_before_any_compilation(arguments, message, monkeypatch):
    monkeypatch.setattr(tracker, "init", None)  # nothing is traced
    with pytest.raises(ValueError, match=message):
        dcs_jax.track_batch(FRAMES, **({"boxes": BOXES} | arguments))


def test_four_axes_with_three_at_the_end_are_one_colour_video(clip):
    tracks = dcs_jax.track_batch(clip.frames[:2], clip.boxes[0] + SHIFTS, config=SMALL)
    assert tracks.boxes.shape == (3, 2, 4)
