"""Two tracks made one: exactly through both keyframes, and with the one that has the object."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from dcs_jax.annotate import StretchTrack
from dcs_jax.annotate.joining import join, overlaps

SIDES = st.floats(4, 200, width=32)
PLACES = st.floats(-100, 1000, width=32)


@st.composite
def two_tracks(draw):
    n = draw(st.integers(2, 12))
    return [
        StretchTrack(
            np.hstack(
                [
                    draw(arrays.arrays(np.float32, (n, 2), elements=PLACES)),
                    draw(arrays.arrays(np.float32, (n, 2), elements=SIDES)),
                ]
            ),
            draw(
                arrays.arrays(
                    np.float32, n, elements=st.floats(0, 1, width=32) | st.just(np.float32("nan"))
                )
            ),
            draw(arrays.arrays(bool, n)),
            np.full(n, np.nan, np.float32),
        )
        for _ in range(2)
    ]


def moving(n, confidence=0.9):
    """An object that goes to the right by 3 pixels a frame."""
    boxes = np.tile(np.array([50, 60, 40, 30], np.float32), (n, 1))
    boxes[:, 0] += 3 * np.arange(n)
    return StretchTrack(
        boxes, np.full(n, confidence, np.float32), np.zeros(n, bool), np.full(n, np.nan, np.float32)
    )


def lost(track, rows, confidence=0.1):
    """The track that is somewhere else in these rows."""
    boxes, sure = track.boxes.copy(), track.confidence.copy()
    boxes[rows, 1] += 200
    sure[rows] = confidence
    return track._replace(boxes=boxes, confidence=sure)


@given(two_tracks())
def test_the_joined_track_passes_exactly_through_both_keyframes(tracks):
    forward, backward = tracks
    joined = join(forward, backward)
    np.testing.assert_array_equal(joined.boxes[0], forward.boxes[0])
    np.testing.assert_array_equal(joined.boxes[-1], backward.boxes[-1])
    assert all(values.dtype in (np.float32, bool) for values in joined)
    assert np.isfinite(joined.boxes).all()
    assert (joined.boxes[:, 2:] > 0).all()
    for values in (joined.confidence, joined.disagreement):
        assert ((values >= 0) & (values <= 1)).all()


@given(two_tracks())
def test_time_has_no_direction(tracks):
    there = join(*tracks)
    mirrored = [track.rows(slice(None, None, -1)) for track in reversed(tracks)]
    back = join(*mirrored).rows(slice(None, None, -1))
    np.testing.assert_allclose(overlaps(there.boxes, back.boxes)[[0, -1]], 1, atol=1e-5)
    np.testing.assert_allclose(there.disagreement, back.disagreement, atol=1e-4)


@given(two_tracks())
def test_two_equal_tracks_are_joined_to_the_same_places(tracks):
    one = tracks[0]
    joined = join(one, one)
    centres = [track.boxes[:, :2] + track.boxes[:, 2:] / 2 for track in (joined, one)]
    np.testing.assert_allclose(*centres, atol=1e-2)
    np.testing.assert_allclose(joined.disagreement, 0, atol=1e-4)


def test_the_track_that_has_the_object_is_believed():
    right = moving(40)
    for start in (5, 20, 33):
        forward, backward = lost(right, slice(start, 40)), lost(right, slice(0, start - 4))
        assert overlaps(join(forward, backward).boxes, right.boxes).min() > 0.9
        assert overlaps(join(forward, right).boxes, right.boxes).min() > 0.9
        assert overlaps(join(right, backward).boxes, right.boxes).min() > 0.9


def test_a_track_that_is_sure_at_the_other_keyframe_and_not_there_is_believed_less():
    right = moving(60)
    # It holds what is in front of the object from the keyframe at the end on, surer than the other.
    backward = moving(60, confidence=1.0)
    backward.boxes[:55] = backward.boxes[55]
    forward = lost(right, slice(52, 60))
    forward.confidence[:52] = 0.7
    joined = join(forward, backward)
    assert overlaps(joined.boxes, right.boxes)[:44].min() > 0.9  # then the two overlap


def test_drift_is_taken_out_of_both_tracks():
    right = moving(40)
    late = np.linspace(0, 1, 40, dtype=np.float32)
    forward, backward = moving(40), moving(40)
    forward.boxes[:, 1] += 4 * late
    backward.boxes[:, 0] -= 4 * (1 - late)
    assert overlaps(join(forward, backward).boxes, right.boxes).min() > 0.99


def test_where_both_are_lost_the_boxes_go_straight():
    right = moving(40)
    forward = lost(right, slice(15, 40))
    backward = lost(right, slice(0, 25), confidence=0.12)
    backward.boxes[:25, 1] += 200  # not where the other one is
    joined = join(forward, backward)
    assert overlaps(joined.boxes, right.boxes).min() > 0.9
    assert joined.confidence[20] < 0.2
    assert joined.disagreement[20] == 1


def test_it_is_lost_where_both_tracks_are():
    forward, backward = moving(9), moving(9)
    forward.lost[3:7] = True
    backward.lost[5:8] = True
    assert np.flatnonzero(join(forward, backward).lost).tolist() == [5, 6]
