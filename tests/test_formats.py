"""Every format gives back what it can hold."""

import numpy as np
import pytest
from hypothesis import given
from track_files import (
    SIZE,
    assert_same_track,
    clips,
    expected,
    object_track,
)

from dcs_jax import formats

ON_LINE = 0.01  # pixels, of boxes that CVAT puts on a line
SUFFIXES = {"csv": ".csv", "otb": "", "mot": ".txt", "cvat": ".xml", "coco": ".json", "yolo": ""}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("tracks")


def there_and_back(folder, format, tracks):
    path = folder.joinpath(f"{len(list(folder.iterdir()))}{SUFFIXES[format]}")
    formats.write(path, tracks, format)
    assert formats.sniff(path) == format
    return formats.read(path)


def facts(tracks):
    return tracks.size, tracks.length, tracks.source, tracks.fps


def multiple(tracks):
    """With an object more: a single one has no name in a table."""
    extra = object_track("one\u00a0more", 0, [[1, 2, 3, 4]])
    return tracks._replace(objects=(*tracks.objects, extra))


@given(clips())
def test_csv_gives_everything_back_but_facts_of_the_clip(folder, tracks):
    tracks = multiple(tracks)
    found = there_and_back(folder, "csv", tracks)
    wanted = expected("csv", tracks)
    assert facts(found) == facts(wanted)
    with_keyframes = any(track.keyframes is not None for track in tracks.objects)
    for one, track in zip(found.objects, wanted.objects, strict=True):
        assert (one.name, one.label) == (track.name, track.label)
        assert_same_track(one, track)
        if with_keyframes:
            marked = np.zeros_like(track.lost) if track.keyframes is None else track.keyframes
            np.testing.assert_array_equal(one.keyframes, marked)


@given(clips())
def test_otb_gives_boxes_and_names_back(folder, tracks):
    found = there_and_back(folder, "otb", tracks)
    wanted = expected("otb", tracks)
    assert facts(found) == facts(wanted)
    by_name = {track.name: track for track in wanted.objects}
    assert {track.name for track in found.objects} == set(by_name)
    for one in found.objects:
        assert one.label is None
        assert_same_track(one, by_name[one.name])


@given(clips())
def test_mot_gives_boxes_and_numbers_back(folder, tracks):
    numbers = dict(zip((track.name for track in tracks.objects), ids(tracks), strict=True))
    wanted = expected("mot", tracks)
    if not wanted.objects:
        return
    found = there_and_back(folder, "mot", tracks)
    assert facts(found) == facts(wanted)
    by_name = {str(numbers[track.name]): track for track in wanted.objects}
    assert [track.name for track in found.objects] == sorted(by_name, key=int)
    for one in found.objects:
        # x and y are one more in the file.
        assert_same_track(one, by_name[one.name], atol=1e-9)


@given(clips())
def test_cvat_gives_boxes_labels_and_facts_back(folder, tracks):
    found = there_and_back(folder, "cvat", tracks)
    wanted = expected("cvat", tracks)
    assert facts(found) == facts(wanted)
    for one, track in zip(found.objects, wanted.objects, strict=True):
        assert (one.label or one.name) == track.category
        assert_same_track(one, track, atol=ON_LINE + 1e-6)
        if track.keyframes is not None:
            assert one.keyframes[track.keyframes].all()
        else:
            assert one.keyframes.all()


@given(clips())
def test_coco_gives_everything_back_that_is_visible(folder, tracks):
    found = there_and_back(folder, "coco", tracks)
    wanted = expected("coco", tracks)
    assert facts(found)[:2] + facts(found)[3:] == facts(wanted)[:2] + facts(wanted)[3:]
    assert found.source == (tracks.source or "video")
    for one, track in zip(found.objects, wanted.objects, strict=True):
        assert (one.name, one.label or one.name) == (track.name, track.category)
        assert_same_track(one, track)


@given(clips())
def test_yolo_gives_the_part_of_a_box_in_the_frame_back(folder, tracks):
    wanted = expected("yolo", in_frame(tracks))
    if not wanted.objects:
        return
    found = there_and_back(folder, "yolo", tracks)
    assert facts(found) == facts(wanted)

    def key(track):
        return track.category, track.start, track.boxes[0].tolist()

    pairs = zip(sorted(found.objects, key=key), sorted(wanted.objects, key=key), strict=True)
    for one, track in pairs:
        assert (one.label or one.name) == track.category
        assert_same_track(one, track, atol=1e-4)


def ids(tracks):
    names = [track.name for track in tracks.objects]
    if all(name.isascii() and name.isdigit() and name[0] != "0" for name in names):
        return list(map(int, names))
    return list(range(1, len(names) + 1))


def in_frame(tracks):
    """Boxes are cut at the edges of the frame; NaN where nothing is left."""
    objects = []
    for track in tracks.objects:
        corners = np.concatenate([track.boxes[:, :2], track.boxes[:, :2] + track.boxes[:, 2:]], 1)
        corners = np.clip(corners.astype(float), 0, SIZE * 2)
        boxes = np.concatenate([corners[:, :2], corners[:, 2:] - corners[:, :2]], 1)
        boxes[~(boxes[:, 2:] > 1e-6).all(1)] = np.nan
        objects.append(track._replace(boxes=boxes.astype(np.float32)))
    return tracks._replace(objects=tuple(objects))
