"""Tracks frame by frame: the boxes of a whole sequence, and errors that say what lacks."""

import cv2
import jax
import numpy as np
import pytest
from settings import SMALL, SMALL_DEFAULT

import dcs_jax
from dcs_jax.synthetic import render

LENGTH = 12
NO_TRACK = "call init with a frame and a box first"


@pytest.fixture(scope="module")
def clip():
    return render(LENGTH, (120, 160), (40, 32), speed=4)


@pytest.fixture(scope="module")
def track(clip):
    return dcs_jax.track_sequence(
        clip.frames, clip.boxes[0], jax.random.key(2), config=SMALL_DEFAULT
    )


def started(clip, **changes):
    tracker = dcs_jax.Tracker(**({"config": SMALL_DEFAULT, "seed": 2} | changes))
    tracker.init(clip.frames[0], clip.boxes[0])
    return tracker


def test_updates_give_the_boxes_of_the_sequence(clip, track):
    tracker = started(clip)
    np.testing.assert_allclose(tracker.result.box, track.boxes[0])
    for t in range(1, LENGTH):
        ok, box = tracker.update(clip.frames[t])
        assert box == tracker.result.box
        np.testing.assert_allclose(box, track.boxes[t], atol=1e-3)
        np.testing.assert_allclose(tracker.result.confidence, track.confidence[t], atol=1e-4)
        np.testing.assert_allclose(tracker.result.part_scores, track.part_scores[t], atol=1e-4)
        assert ok is not bool(track.lost[t])
        assert tracker.result.lost is bool(track.lost[t])


def frames_like(frames):
    """The same pictures in other forms."""
    image = pytest.importorskip("PIL.Image")
    wide = np.zeros((*frames.shape[:2], 2 * frames.shape[2], 3), np.uint8)
    wide[:, :, ::2] = frames
    return {
        "PIL": [image.fromarray(frame) for frame in frames],
        "PIL with transparency": [image.fromarray(frame).convert("RGBA") for frame in frames],
        "not contiguous": list(wide[:, :, ::2]),
        "JAX": list(map(jax.numpy.asarray, frames)),
        "read-only": [np.frombuffer(f.tobytes(), np.uint8).reshape(f.shape) for f in frames],
    }


@pytest.mark.parametrize(
    "form", ["PIL", "PIL with transparency", "not contiguous", "JAX", "read-only"]
)
def test_frames_in_any_form(clip, track, form):
    frames = frames_like(clip.frames[:4])[form]
    tracker = dcs_jax.Tracker(SMALL_DEFAULT, seed=2)
    tracker.init(frames[0], clip.boxes[0])
    boxes = [tracker.update(frame)[1] for frame in frames[1:]]
    np.testing.assert_allclose(boxes, track.boxes[1:4], atol=1e-3)


def test_frames_of_opencv(clip, track):
    buffer = np.empty_like(clip.frames[0])  # which a camera fills again and again
    tracker = dcs_jax.Tracker(SMALL_DEFAULT, seed=2, order="bgr")
    for t, frame in enumerate(clip.frames[:4]):
        cv2.cvtColor(frame, cv2.COLOR_RGB2BGR, buffer)
        if t == 0:
            tracker.init(buffer, clip.boxes[0])
        else:
            np.testing.assert_allclose(tracker.update(buffer)[1], track.boxes[t], atol=1e-3)


def test_grey_frames(clip):
    grey = np.stack([cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY) for frame in clip.frames[:4]])
    expected = dcs_jax.track_sequence(
        grey, clip.boxes[0], jax.random.key(2), config=SMALL_DEFAULT
    ).boxes
    tracker = dcs_jax.Tracker(SMALL_DEFAULT, seed=2, order="bgr")
    tracker.init(grey[0], clip.boxes[0])
    boxes = [tracker.update(frame)[1] for frame in grey[1:]]
    np.testing.assert_allclose(boxes, expected[1:], atol=1e-3)


def test_a_state_goes_back_and_into_another_tracker(clip):
    tracker = started(clip)
    tracker.update(clip.frames[1])
    kept = tracker.state
    boxes = [tracker.update(frame)[1] for frame in clip.frames[2:6]]
    tracker.state = kept
    assert [tracker.update(frame)[1] for frame in clip.frames[2:6]] == boxes
    other = started(clip, seed=5)
    other.state = kept
    assert [other.update(frame)[1] for frame in clip.frames[2:6]] == boxes


def test_a_state_alone_goes_on(clip):
    tracker = started(clip)
    other = dcs_jax.Tracker(SMALL_DEFAULT)
    other.state = tracker.state
    assert other.update(clip.frames[1]) == tracker.update(clip.frames[1])


def test_a_correction_starts_again_from_there(clip):
    tracker = started(clip)
    tracker.update(clip.frames[1])
    tracker.correct(clip.boxes[1] + np.float32(3))
    np.testing.assert_allclose(tracker.result.box, clip.boxes[1] + 3, atol=1e-4)
    fresh = dcs_jax.Tracker(SMALL_DEFAULT, seed=2)
    fresh.init(clip.frames[1], clip.boxes[1] + np.float32(3))
    assert tracker.update(clip.frames[2]) == fresh.update(clip.frames[2])


def test_without_verification_nothing_is_lost(clip):
    tracker = dcs_jax.Tracker(SMALL)
    tracker.init(clip.frames[0], clip.boxes[0])
    ok, _ = tracker.update(clip.frames[1])
    assert ok
    assert np.isnan(tracker.result.confidence)


def test_updates_compile_once(clip, traces):
    tracker = started(clip, config=dcs_jax.Config(canvas=20, parts=1, selectors=3, pool_size=5))
    counts = None
    for frame in clip.frames[1:4]:
        tracker.update(frame)
        counts = counts or dict(traces)
    tracker.init(clip.frames[3], clip.boxes[3])
    tracker.update(clip.frames[4])
    assert traces == counts


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda t, f: dcs_jax.Tracker().update(f), NO_TRACK),
        (lambda t, f: dcs_jax.Tracker().correct((1, 2, 30, 40)), NO_TRACK),
        (lambda t, f: dcs_jax.Tracker().result, NO_TRACK),
        (lambda t, f: dcs_jax.Tracker().state, NO_TRACK),
        (lambda t, f: t.update(f[:-1]), r"shape of those before it, \(120, 160, 3\), but has"),
        (lambda t, f: t.update(f / 255), "uint8"),
        (lambda t, f: t.update(None), "NoneType"),
        (lambda t, f: t.init(f, (1, 2, 3)), "four finite numbers"),
        (lambda t, f: t.correct((900, 2, 30, 40)), "wholly outside"),
        (lambda t, f: setattr(t, "state", 3), "must be a dcs_jax.State, but is 3"),
        (lambda t, f: dcs_jax.Tracker(config="paper"), "must be a dcs_jax.Config"),
        (lambda t, f: dcs_jax.Tracker(seed=-1), "seed must be an integer of at least 0"),
        (lambda t, f: dcs_jax.Tracker(seed=2**32), "and at most 4294967295"),
        (lambda t, f: dcs_jax.Tracker(order="brg"), "order must be one of 'rgb', 'bgr'"),
    ],
)
def test_bad_calls(clip, call, message):
    with pytest.raises(ValueError, match=message):
        call(started(clip), clip.frames[0])


def test_tracks_come_and_go(clip, track):
    tracker = dcs_jax.MultiTracker(3, SMALL_DEFAULT, seed=2)
    first = tracker.add(clip.frames[0], clip.boxes[0])
    alone = [tracker.update(frame)[first].box for frame in clip.frames[1:4]]
    np.testing.assert_allclose(alone, track.boxes[1:4], atol=1e-3)
    second = tracker.add(clip.frames[3], clip.boxes[3] + np.float32(2))
    assert (first, second, tracker.active) == (0, 1, [0, 1])
    results = tracker.update(clip.frames[4])
    assert results.keys() == {0, 1}
    np.testing.assert_allclose(results[first].box, track.boxes[4], atol=1e-3)
    own = dcs_jax.Tracker(SMALL_DEFAULT, seed=2)
    own.init(clip.frames[3], clip.boxes[3] + np.float32(2))
    np.testing.assert_allclose(results[second].box, own.update(clip.frames[4])[1], atol=1e-3)
    tracker.drop(first)
    assert tracker.update(clip.frames[5]).keys() == {second}
    assert tracker.add(clip.frames[5], clip.boxes[5]) == first


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda t, f: dcs_jax.MultiTracker(0), "slots must be an integer of at least 1"),
        (lambda t, f: dcs_jax.MultiTracker().update(f), "call add with a frame and a box first"),
        (lambda t, f: t.drop(1), r"slot 1 has no track: those that have one are \[0\]"),
        (lambda t, f: t.update(f[:-1]), "shape of those before it"),
        (lambda t, f: [t.add(f, (5, 5, 20, 20)) for _ in range(3)], "all 3 slots have a track"),
    ],
)
def test_bad_calls_of_several(clip, call, message):
    tracker = dcs_jax.MultiTracker(3, SMALL_DEFAULT, seed=2)
    tracker.add(clip.frames[0], clip.boxes[0])
    with pytest.raises(ValueError, match=message):
        call(tracker, clip.frames[0])
