"""Edits of a project: what they say, that all can be undone, and what is left to track."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dcs_jax.annotate import Editor, Keyframe, Project, Stretch, StretchTrack
from dcs_jax.annotate.stretches import stretches_of

LENGTH = 12
BOX = (10.0, 11.0, 30.0, 40.0)

frames = st.integers(0, LENGTH - 1)
boxes = st.tuples(*(st.integers(0, 20),) * 2, *(st.integers(4, 40),) * 2)  # in the frame
edits = st.lists(
    st.one_of(
        st.tuples(st.just("add"), frames, boxes),
        st.tuples(st.just("set"), st.integers(1, 3), frames, st.none() | boxes),
        st.tuples(st.just("remove"), st.integers(1, 3), frames),
        st.tuples(st.just("rename"), st.integers(1, 3), st.sampled_from(["car", "dog", "ball"])),
        st.tuples(st.just("delete"), st.integers(1, 3)),
        st.tuples(st.just("track")),
        st.tuples(st.just("undo")),
        st.tuples(st.just("redo")),
    ),
    max_size=12,
)


def project(length=LENGTH):
    return Project("clip.mp4", {"bytes": 1}, (80, 60), length, 25.0)


def track_of(stretch, confidence=0.9, disagreement=0.1):
    """A track that tells of which stretch it is."""
    n = stretch.length
    box = (stretch.first, stretch.last, 5 + stretch.object, 9)
    return StretchTrack(
        np.tile(np.array(box, np.float32), (n, 1)),
        np.full(n, confidence, np.float32),
        np.zeros(n, bool),
        np.full(n, disagreement, np.float32),
    )


def apply(editor, edit):
    """Make an edit; one that the project refuses changes nothing."""
    kind, *arguments = edit
    calls = {
        "add": editor.add_object,
        "set": editor.set_keyframe,
        "remove": editor.remove_keyframe,
        "rename": editor.rename,
        "delete": editor.delete,
        "undo": editor.undo,
        "redo": editor.redo,
    }
    if kind == "track":
        for stretch in editor.pending():
            editor.fill(stretch, track_of(stretch))
        return
    before = content(editor.project)
    try:
        calls[kind](*arguments)
    except ValueError:
        assert content(editor.project) == before


def content(project):
    """All that a project says, in values that can be compared."""
    return [
        (
            lane.id,
            lane.name,
            lane.colour,
            lane.keyframes,
            *(
                np.nan_to_num(values, nan=-1).tolist()
                for values in (lane.boxes, lane.confidence, lane.disagreement, lane.lost)
            ),
        )
        for lane in project.objects
    ]


def said(project):
    """What a person has said."""
    return [(lane.id, lane.name, lane.keyframes) for lane in project.objects]


@given(edits)
def test_all_edits_undone_are_the_start_and_done_again_the_end(made):
    editor = Editor(project())
    for edit in made:
        apply(editor, edit)
    end = content(editor.project)
    count = 0
    while editor.can_undo:
        assert editor.undo()
        count += 1
    assert not editor.undo()
    assert not editor.project.objects
    while editor.can_redo:
        assert editor.redo()
        count -= 1
    assert not editor.redo()
    # What was undone among the edits is done again, too.
    for _ in range(-count):
        editor.undo()
    assert content(editor.project) == end


@given(edits)
def test_pending_never_asks_for_what_is_known(made):
    editor = Editor(project())
    tracked: set[Stretch] = set()
    for edit in made:
        if edit[0] == "track":
            assert tracked.isdisjoint(editor.pending())
            tracked.update(editor.pending())
        apply(editor, edit)
        assert tracked.isdisjoint(editor.pending())


@given(edits)
def test_after_tracking_every_frame_has_a_box_or_the_object_is_absent(made):
    editor = Editor(project())
    for edit in made:
        apply(editor, edit)
    apply(editor, ("track",))
    assert not editor.pending()
    for lane in editor.project.objects:
        assert (~np.isnan(lane.boxes[:, 0]) | lane.lost).all()
        for frame, keyframe in lane.keyframes.items():
            if keyframe.box is None:
                assert lane.lost[frame]
                assert np.isnan(lane.boxes[frame]).all()
            else:
                assert tuple(lane.boxes[frame].tolist()) == keyframe.box
                assert lane.confidence[frame] == 1


@given(edits)
def test_a_project_is_not_changed_by_later_edits(made):
    editor = Editor(project())
    editor.add_object(3, BOX)
    kept = editor.project
    before = content(kept)
    for edit in made:
        apply(editor, edit)
    assert content(kept) == before


@given(edits)
def test_an_editor_goes_on_from_a_project(made):
    editor = Editor(project())
    for edit in made:
        apply(editor, edit)
    again = Editor(editor.project)
    assert said(again.project) == said(editor.project)
    assert set(again.pending()) <= set(editor.pending())
    apply(editor, ("track",))
    again = Editor(editor.project)
    assert not again.pending()
    assert content(again.project) == content(editor.project)


@given(st.dictionaries(frames, st.none() | boxes, min_size=1))
def test_stretches_are_between_neighbouring_keyframes(said):
    keyframes = {frame: Keyframe(box) for frame, box in said.items()}
    stretches = stretches_of(1, keyframes, LENGTH)
    inner = np.zeros(LENGTH, int)
    for stretch in stretches:
        assert (stretch.left, stretch.right) != (None, None)
        for frame, box in ((stretch.first, stretch.left), (stretch.last, stretch.right)):
            assert box is None or keyframes[frame].box == box
        for frame in range(stretch.first, stretch.last + 1):
            inner[frame] += frame not in keyframes
    # Every frame is in one stretch, unless the keyframe before it says that the object is absent.
    for frame in set(range(LENGTH)) - set(keyframes):
        before = max((at for at in keyframes if at < frame), default=min(keyframes))
        assert inner[frame] == (keyframes[before].box is not None)


def test_only_the_stretches_next_to_a_new_keyframe_are_pending():
    editor = Editor(project())
    id = editor.add_object(0, BOX)
    editor.set_keyframe(id, 11, BOX)
    editor.set_keyframe(id, 6, BOX)
    apply(editor, ("track",))
    editor.set_keyframe(id, 3, BOX)
    assert [(s.first, s.last) for s in editor.pending()] == [(0, 3), (3, 6)]


def test_not_here_is_absent_up_to_the_next_keyframe():
    editor = Editor(project())
    id = editor.add_object(2, BOX)
    editor.set_keyframe(id, 5, None)
    editor.set_keyframe(id, 8, BOX)
    assert editor.pending() == [
        Stretch(id, 0, 2, None, BOX),
        Stretch(id, 2, 4, BOX, None),
        Stretch(id, 8, 11, BOX, None),
    ]
    apply(editor, ("track",))
    lane = editor.project.objects[0]
    assert np.flatnonzero(lane.lost).tolist() == [5, 6, 7]
    assert np.isnan(lane.boxes[5:8]).all()


def test_a_track_that_comes_too_late_is_kept_for_an_undo():
    editor = Editor(project())
    id = editor.add_object(0, BOX)
    stretch = editor.pending()[0]
    editor.set_keyframe(id, 5, BOX)
    before = content(editor.project)
    assert not editor.fill(stretch, track_of(stretch))
    assert content(editor.project) == before
    editor.undo()
    assert not editor.pending()


def test_a_track_that_is_still_made_is_shown_and_stays_pending():
    editor = Editor(project())
    editor.add_object(0, BOX)
    (stretch,) = editor.pending()
    part = track_of(stretch)
    part.boxes[4:] = np.nan
    assert editor.fill(stretch, part, complete=False)
    assert np.isnan(editor.project.objects[0].boxes[:, 0]).sum() == LENGTH - 4
    assert editor.pending() == [stretch]
    assert editor.fill(stretch, track_of(stretch))
    # One that is late does not take the place of the whole.
    editor.fill(stretch, part, complete=False)
    assert not np.isnan(editor.project.objects[0].boxes).any()


def test_the_next_doubtful_frame_is_the_worst_of_its_stretch_and_comes_around():
    editor = Editor(project(200))
    id, other = editor.add_object(0, BOX), editor.add_object(0, BOX)
    for stretch in editor.pending():
        track = track_of(stretch, confidence=0.99, disagreement=np.nan)
        track.confidence[100] = 0.0  # a frame by itself
        if stretch.object == id:
            track.confidence[25:56] = 0.2
            track.confidence[145:176] = 0.1
            track.boxes[40:] += 9  # it jumps while it is not recognised
            track.boxes[160:] += 9
        editor.fill(stretch, track)
    found = [editor.next_doubtful(frame) for frame in (0, 100)]
    first, second = (frame for frame, _ in filter(None, found))
    assert 35 < first < 45
    assert 155 < second < 165
    assert editor.next_doubtful(first) == (second, id)
    assert editor.next_doubtful(second, id) == (first, id)
    assert editor.next_doubtful(0, other) is None
    editor.set_keyframe(id, first, None)  # absent from there to the end
    assert editor.next_doubtful(first) is None


def test_where_an_object_is_never_recognised_again_the_last_frame_is_the_most_doubtful():
    editor = Editor(project(120))
    editor.add_object(0, BOX)
    for stretch in editor.pending():
        track = track_of(stretch, confidence=0.99, disagreement=np.nan)
        track.confidence[40:] = 0.1
        # Where it is alike for a while it is less in doubt, though later.
        track.confidence[100:] = 0.25
        editor.fill(stretch, track)
    found = editor.next_doubtful(0)
    assert found is not None
    assert 80 < found[0] < 100


def test_what_was_followed_until_it_is_recognised_again_is_not_in_doubt():
    def found(change=lambda track: None):
        editor = Editor(project(120))
        editor.add_object(0, BOX)
        for stretch in editor.pending():
            track = track_of(stretch, confidence=0.99, disagreement=np.nan)
            track.confidence[30:91] = 0.1
            change(track)
            editor.fill(stretch, track)
        return editor.next_doubtful(0)

    def apart(track):
        track.disagreement[30:91] = 0.9

    def near(track):
        track.disagreement[30:91] = 0.5

    def jumps_back(track):
        track.boxes[91:] += 9

    def moves(track):
        track.boxes[:, 0] += 2 * np.arange(120)

    def never_again(track):
        track.confidence[91:] = 0.6

    assert found() is found(near) is found(moves) is None
    for change in (apart, jumps_back, never_again):
        assert 30 < found(change)[0] < 90, change


def test_an_id_is_never_given_again():
    editor = Editor(project())
    first = editor.add_object(0, BOX)
    editor.delete(first)
    assert editor.add_object(0, BOX) != first


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda e: e.set_keyframe(7, 0, BOX), "there is no object 7: expected one of 1, 2"),
        (lambda e: e.set_keyframe(1, 12, BOX), "frame must be an integer .* but is 12"),
        (lambda e: e.set_keyframe(1, 3, (0, 0, 2, 9)), "at least 4 pixels wide and high"),
        (lambda e: e.set_keyframe(1, 3, (90, 0, 9, 9)), "wholly outside"),
        (lambda e: e.set_keyframe(1, 0, None), "would have no box at all: delete it"),
        (lambda e: e.set_keyframe(1, 3, (1, 2, 3)), "four finite numbers"),
        (lambda e: e.remove_keyframe(1, 0), "would have no box at all: delete it"),
        (lambda e: e.remove_keyframe(1, 5), "no keyframe in frame 5: it has those of 0"),
        (lambda e: e.rename(1, "object 2"), "another object named 'object 2'"),
        (lambda e: e.rename(1, " "), "name must be text"),
        (lambda e: e.add_object(-1, BOX), "frame must be an integer"),
        (lambda e: e.delete("1"), "there is no object '1'"),
        (lambda e: e.next_doubtful(0, 3), "there is no object 3"),
        (
            lambda e: e.fill(e.pending()[0], track_of(Stretch(1, 0, 4, BOX, None))),
            r"boxes must have the shape \(12, 4\)",
        ),
    ],
)
def test_what_cannot_be_is_refused(edit, message):
    editor = Editor(project())
    editor.add_object(0, BOX)
    editor.add_object(0, BOX)
    before = content(editor.project)
    with pytest.raises(ValueError, match=message):
        edit(editor)
    assert content(editor.project) == before
