"""Projects in files: as they were, whole or not at all, and of the clip they were made for."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_annotate_editing import BOX, apply, content, edits, project

from dcs_jax import formats
from dcs_jax.annotate import Editor, default_path, fingerprint, from_tracks, load, save, to_tracks

KEPT_WHOLE = ("csv", "cvat")  # formats that keep what is lost


def edited(made=()):
    """The project after these edits, all stretches tracked."""
    editor = Editor(project())
    for edit in made:
        apply(editor, edit)
    editor.add_object(2, BOX, "the last")  # a format need not hold a clip without objects
    apply(editor, ("track",))
    return editor.project


@given(edits)
def test_a_project_is_loaded_as_it_was_saved(tmp_path_factory, made):
    path = tmp_path_factory.mktemp("project") / "clip.mp4.dcs.json"
    before = edited(made)
    save(path, before)
    after = load(path)
    assert content(after) == content(before)
    for name in ("clip", "fingerprint", "size", "length", "fps", "settings"):
        assert getattr(after, name) == getattr(before, name)
    assert not Editor(after).pending()


@given(st.floats(width=32, min_value=2**-10, max_value=2**14))
def test_every_digit_is_kept(tmp_path_factory, number):
    path = tmp_path_factory.mktemp("project") / "project.json"
    before = edited()
    before.objects[0].boxes[5, 0] = number
    save(path, before)
    assert load(path).objects[0].boxes[5, 0] == np.float32(number)


def test_a_file_that_is_cut_short_is_refused(tmp_path):
    path = tmp_path / "project.json"
    save(path, edited())
    whole = path.read_bytes()
    for length in (0, 1, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(ValueError, match=r"project\.json is no project .* cut short"):
            load(path)


@pytest.mark.parametrize(
    "change",
    [
        lambda fields: fields.update(kind="dcs_jax states"),
        lambda fields: fields.pop("objects"),
        lambda fields: fields.update(length=5),
        lambda fields: fields.update(size=[80]),
        lambda fields: fields["objects"][0].update(keyframes={"4": None}),
        lambda fields: fields["objects"][0].update(keyframes={"40": None}),
        lambda fields: fields["objects"][0].update(keyframes={"4": [1, 2, 3]}),
        lambda fields: fields["objects"][0].update(boxes=[[1, 2, 3]] * 12),
        lambda fields: fields["objects"].append(fields["objects"][0]),
    ],
)
def test_a_damaged_file_is_refused(tmp_path, change):
    path = tmp_path / "project.json"
    save(path, edited())
    fields = json.loads(path.read_text())
    change(fields)
    path.write_text(json.dumps(fields))
    with pytest.raises(ValueError, match=r"project\.json is no project"):
        load(path)


def test_a_newer_version_is_refused_and_left_alone(tmp_path):
    path = tmp_path / "project.json"
    save(path, edited())
    newer = path.read_text().replace('"version":1', '"version":2')
    path.write_text(newer)
    with pytest.raises(ValueError, match=r"has the version 2, .* written by a newer one"):
        load(path)
    assert path.read_text() == newer


def test_a_file_that_cannot_be_written_leaves_the_last_one(tmp_path):
    path = tmp_path / "project.json"
    save(path, edited())
    before = path.read_bytes()
    wrong = edited()
    wrong.objects[0].confidence[3] = np.inf  # no number of JSON
    with pytest.raises(ValueError, match="JSON"):
        save(path, wrong)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_a_clip_that_was_replaced_is_noticed(tmp_path):
    clip = tmp_path / "clip.mp4"
    clip.write_bytes(bytes(3_000_000))
    path = default_path(clip)
    assert path.name == "clip.mp4.dcs.json"
    one = project()
    save(path, type(one)(str(clip), fingerprint(clip), (80, 60), 12, 25.0))
    assert load(path, clip).clip == str(clip)
    clip.write_bytes(bytes(2_999_999) + b"1")
    with pytest.raises(ValueError, match=r"is not the clip that .* was made for"):
        load(path, clip)


def test_the_fingerprint_of_a_folder_is_of_its_images(tmp_path):
    for number in range(3):
        (tmp_path / f"{number}.png").write_bytes(bytes(number))
    before = fingerprint(tmp_path)
    assert before["images"] == 3
    (tmp_path / "notes.txt").write_text("not an image")
    assert fingerprint(tmp_path) == before
    (tmp_path / "1.png").write_bytes(bytes(9))
    assert fingerprint(tmp_path) != before


@given(edits)
def test_tracks_and_back_are_the_same_boxes(made):
    before = edited(made)
    after = from_tracks(to_tracks(before), before)
    for one, other in zip(before.objects, after.objects, strict=True):
        assert other.name == one.name
        np.testing.assert_array_equal(other.boxes, one.boxes)
        np.testing.assert_array_equal(other.lost, one.lost)
        boxes = {at: key for at, key in one.keyframes.items() if key.box is not None}
        assert boxes.items() <= other.keyframes.items()
    assert not Editor(after).pending()


@given(made=edits, format=st.sampled_from(formats.NAMES))
def test_every_format_gives_the_boxes_back(tmp_path_factory, made, format):
    before = edited(made)
    path = tmp_path_factory.mktemp("tracks") / "tracks"
    formats.write(path, to_tracks(before), format)
    after = from_tracks(formats.read(path, format, before.size, before.length), before)
    assert len(after.objects) == len(before.objects)
    for one, other in zip(before.objects, after.objects, strict=True):
        np.testing.assert_allclose(other.boxes, one.boxes, atol=0.01)
        if format in KEPT_WHOLE:
            np.testing.assert_array_equal(other.lost, one.lost)


def test_tracks_of_another_clip_are_refused():
    one = edited()
    tracks = to_tracks(one)
    with pytest.raises(ValueError, match="of a clip of 80 x 61 pixels"):
        from_tracks(tracks._replace(size=(80, 61)), one)
    with pytest.raises(ValueError, match="at least 13 frames, but this one has 12"):
        from_tracks(tracks._replace(length=13), one)
