"""Stretches of a rendered clip are tracked both ways, in one batch, and through their keyframes."""

import jax
import numpy as np
import pytest
from settings import SMALL_DEFAULT

from dcs_jax import synthetic
from dcs_jax.annotate import (
    Editor,
    Project,
    Runs,
    Stretch,
    prepare,
    track_between,
    track_stretches,
    tracking,
)
from dcs_jax.evaluation.metrics import overlap
from dcs_jax.runners.sequence import track_sequence

LENGTH = 40


@pytest.fixture(scope="module")
def clip():
    return synthetic.render(LENGTH, (120, 160), (32, 32), seed=1, occlusion=0.0, lookalike=False)


class Reader:
    """Frames of a clip, and which of them were asked for."""

    def __init__(self, frames):
        self._frames = frames
        self.asked = []

    def __call__(self, start, end):
        self.asked.append((start, end))
        return self._frames[start:end]


def box_of(clip, frame):
    return tuple(np.asarray(clip.boxes[frame], np.float32).tolist())


def stretch_of(clip, first, last, left=True, right=True):
    left = box_of(clip, first) if left else None
    return Stretch(1, first, last, left, box_of(clip, last) if right else None)


def same(one, other):
    return all(np.array_equal(a, b, equal_nan=True) for a, b in zip(one, other, strict=True))


def test_a_track_goes_through_its_keyframes_and_follows_the_object(clip):
    keyframes = {4: box_of(clip, 4), 20: box_of(clip, 20), 30: None, 36: box_of(clip, 36)}
    track = track_between(clip.frames, keyframes, SMALL_DEFAULT)
    for frame, box in keyframes.items():
        if box is not None:
            assert tuple(track.boxes[frame].tolist()) == box
    assert np.isnan(track.boxes[30:36]).all()
    assert track.lost[30:36].all()
    there = np.r_[0:30, 36:LENGTH]
    assert overlap(track.boxes[there], clip.boxes[there]).min() > 0.5
    assert np.isfinite(track.disagreement[4:21]).all()
    assert np.isnan(track.disagreement[21:30]).all()


def test_forward_only_is_the_track_of_the_sequence(clip):
    stretch = stretch_of(clip, 0, LENGTH - 1, right=False)
    track = track_stretches(Reader(clip.frames), [stretch], SMALL_DEFAULT, seed=3)[stretch]
    plain = track_sequence(clip.frames, stretch.left, jax.random.key(3), SMALL_DEFAULT)
    np.testing.assert_array_equal(track.boxes, plain.boxes)
    np.testing.assert_array_equal(track.confidence, plain.confidence)


def test_many_stretches_are_tracked_while_the_clip_is_read_once(clip, monkeypatch):
    stretches = [stretch_of(clip, first, first + 9) for first in range(0, 30, 3)]
    reader, seen = Reader(clip.frames), []
    together = track_stretches(
        reader,
        stretches,
        SMALL_DEFAULT,
        on_progress=lambda stretch, track, complete: seen.append((stretch, complete)),
    )
    assert reader.asked == [(0, 37)]
    assert {stretch for stretch, complete in seen if complete} == set(stretches)
    assert len(seen) > 3 * len(stretches)
    # Memory for a few frames only: the same tracks.
    monkeypatch.setattr(tracking, "KEPT", 7 * clip.frames[0].nbytes)
    again = track_stretches(Reader(clip.frames), stretches, SMALL_DEFAULT)
    alone = track_stretches(Reader(clip.frames), stretches[4:5], SMALL_DEFAULT)
    assert all(same(together[stretch], again[stretch]) for stretch in stretches)
    assert same(together[stretches[4]], alone[stretches[4]])


def test_more_stretches_than_slots_take_more_passes(clip, monkeypatch):
    stretches = [stretch_of(clip, first, first + 12) for first in (0, 0, 2, 5, 9, 20)]
    stretches = [stretch._replace(object=number) for number, stretch in enumerate(stretches, 1)]
    expected = track_stretches(Reader(clip.frames), stretches, SMALL_DEFAULT)
    monkeypatch.setattr(tracking, "SLOTS", 2)
    found = track_stretches(Reader(clip.frames), stretches, SMALL_DEFAULT)
    assert all(same(found[stretch], expected[stretch]) for stretch in stretches)


def test_what_was_tracked_from_a_keyframe_is_not_tracked_again(clip):
    runs = Runs()
    whole = stretch_of(clip, 0, 30)
    track_stretches(Reader(clip.frames), [whole], SMALL_DEFAULT, runs=runs)
    halves = [stretch_of(clip, 0, 12), stretch_of(clip, 12, 30)]
    reader = Reader(clip.frames)
    found = track_stretches(reader, halves, SMALL_DEFAULT, runs=runs)
    assert reader.asked == [(12, 31), (0, 12)]  # frame 12 is kept
    fresh = track_stretches(Reader(clip.frames), halves, SMALL_DEFAULT)
    assert all(same(found[half], fresh[half]) for half in halves)
    reader = Reader(clip.frames)
    track_stretches(reader, [whole, *halves], SMALL_DEFAULT, runs=runs)
    assert not reader.asked


def test_what_was_tracked_before_a_stop_is_not_tracked_again(clip):
    runs, shown = Runs(), []
    track_stretches(
        Reader(clip.frames),
        [stretch_of(clip, 0, LENGTH - 1, right=False)],
        SMALL_DEFAULT,
        on_progress=lambda _, track, complete: shown.append(track),
        stopped=lambda: len(shown) == 3,
        runs=runs,
    )
    count = int(np.isfinite(shown[-1].boxes[:, 0]).sum())
    assert 9 < count < LENGTH
    reader = Reader(clip.frames)
    part = stretch_of(clip, 0, count - 1, right=False)
    found = track_stretches(reader, [part], SMALL_DEFAULT, runs=runs)
    assert not reader.asked
    assert same(found[part], shown[-1].rows(slice(count)))


def test_tracking_can_be_stopped_and_what_was_made_was_shown(clip):
    stretch = stretch_of(clip, 0, LENGTH - 1)
    shown = []
    found = track_stretches(
        Reader(clip.frames),
        [stretch],
        SMALL_DEFAULT,
        on_progress=lambda _, track, complete: shown.append((track, complete)),
        stopped=lambda: len(shown) == 2,
    )
    assert not found
    track, complete = shown[-1]
    known = np.isfinite(track.boxes[:, 0])
    assert known.any()
    assert not known.all()
    assert not complete


def test_a_clip_that_breaks_off_is_tracked_up_to_there(clip):
    def broken(start, end):
        yield from clip.frames[start:25]
        raise OSError("no more frames")

    shown = []
    with pytest.raises(OSError, match="no more frames"):
        track_stretches(
            broken,
            [stretch_of(clip, 0, LENGTH - 1, right=False)],
            SMALL_DEFAULT,
            on_progress=lambda _, track, complete: shown.append(track),
        )
    assert np.isfinite(shown[-1].boxes[:, 0]).sum() == 25


def test_prepared_frames_compile_nothing(clip, traces):
    prepare(clip.frames.shape[1:], SMALL_DEFAULT)
    before = dict(traces)
    stretches = [stretch_of(clip, 0, 9), stretch_of(clip, 3, 30)]
    track_stretches(Reader(clip.frames), stretches, SMALL_DEFAULT)
    assert traces == before


def test_an_annotation_from_the_first_box_to_the_last(clip):
    height, width = clip.frames.shape[1:3]
    editor = Editor(Project("clip.mp4", {}, (width, height), LENGTH, 25.0))
    id = editor.add_object(10, box_of(clip, 10))
    runs = Runs()
    for frame in (None, 35, 22):
        if frame is not None:
            editor.set_keyframe(id, frame, box_of(clip, frame))
        pending = editor.pending()
        found = track_stretches(Reader(clip.frames), pending, SMALL_DEFAULT, runs=runs)
        for stretch in pending:
            assert editor.fill(stretch, found[stretch])
    lane = editor.project.objects[0]
    assert overlap(lane.boxes, clip.boxes).min() > 0.5
    alone = track_between(
        clip.frames, {frame: box_of(clip, frame) for frame in (10, 22, 35)}, SMALL_DEFAULT
    )
    np.testing.assert_array_equal(lane.boxes, alone.boxes)


@pytest.mark.parametrize(
    ("keyframes", "message"),
    [
        ({}, "keyframes must have a box in one frame or more"),
        ({3: None}, "keyframes must have a box in one frame or more"),
        ({40: (1, 2, 30, 30)}, "the frame of a keyframe must be an integer"),
        ({0: (1, 2, 3, 30)}, "at least 4 pixels wide and high"),
        ({0: (300, 2, 30, 30)}, "wholly outside"),
    ],
)
def test_keyframes_that_cannot_be_are_refused(clip, keyframes, message):
    with pytest.raises(ValueError, match=message):
        track_between(clip.frames, keyframes, SMALL_DEFAULT)
