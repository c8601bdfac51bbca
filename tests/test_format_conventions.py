"""What a file of each format looks like, and which variants of it are read."""

import numpy as np
import pytest
from track_files import (
    SIZE,
    assert_same_track,
    cvat,
    cvat_box,
    expected,
    object_track,
    one_object,
)

from dcs_jax import formats
from dcs_jax.formats import Tracks


@pytest.mark.parametrize("format", ["csv", "otb"])
def test_a_single_object_has_the_name_of_its_file(tmp_path, format):
    path = tmp_path / f"tracks{'.csv' if format == 'csv' else '.txt'}"
    formats.write(path, one_object())
    (found,) = formats.read(path).objects
    assert_same_track(found, expected(format, one_object()).objects[0])
    assert found.name == "tracks"


def test_the_table_of_one_object_is_that_of_track(tmp_path):
    formats.write(tmp_path / "boxes.csv", Tracks((object_track("a", 7, [[1, 2.5, 3, 4], None]),)))
    text = (tmp_path / "boxes.csv").read_text()
    assert text == "frame,x,y,w,h,confidence\n7,1.0,2.5,3.0,4.0,\n8,,,,,\n"


def test_columns_in_any_order_and_gaps_between_frames(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("h,lost,w,frame,y,x,id\n4,0,3,5.0,2,1,a\n4,1,3,3,2,-1,a\n8,0,7,0,6,5,b\n")
    first, second = formats.read(path).objects
    assert (first.name, first.start, second.name) == ("a", 3, "b")
    np.testing.assert_array_equal(first.boxes, [[-1, 2, 3, 4], [np.nan] * 4, [1, 2, 3, 4]])
    np.testing.assert_array_equal(first.lost, [True, False, False])


def test_otb_takes_tabs_blanks_and_zeros(tmp_path):
    path = tmp_path / "groundtruth_rect.txt"
    path.write_text("0 0 0 0\n1\t2\t3\t4\nNaN,NaN,NaN,NaN\n5, 6, 7, 8\n0,0,0,0\n")
    tracks = formats.read(path)
    assert (tracks.length, tracks.objects[0].start) == (5, 1)
    np.testing.assert_array_equal(tracks.objects[0].boxes[::2], [[1, 2, 3, 4], [5, 6, 7, 8]])


def test_mot_counts_frames_and_pixels_from_one(tmp_path):
    path = tmp_path / "gt.txt"
    formats.write(path, Tracks((object_track("cat", 4, [[0, 10.1, 20, 30]]),)), "mot")
    assert path.read_text() == "5,1,1.0,11.1,20.0,30.0,-1,-1,-1,-1\n"
    # Ground truth of MOT16, unsorted, with blanks.
    path.write_text("3, 2, 101, 51, 10, 20, 1, 1, 0.9\n1, 2, 1, 1, 10, 20, 0, 1, 0.5\n")
    (found,) = formats.read(path).objects
    assert (found.name, found.start) == ("2", 0)
    np.testing.assert_array_equal(found.boxes[::2], [[0, 0, 10, 20], [100, 50, 10, 20]])
    np.testing.assert_array_equal(found.confidence, [0, np.nan, 1])


def test_cvat_puts_boxes_on_lines_between_keyframes(tmp_path):
    path = tmp_path / "a.xml"
    boxes = cvat_box(2, 0) + cvat_box(6, 8, right=26) + cvat_box(7, 8, outside=1) + cvat_box(9, 4)
    path.write_text(cvat(boxes, "<task><size>12</size></task>"))
    tracks = formats.read(path)
    (found,) = tracks.objects
    assert (tracks.length, found.start) == (12, 2)
    nothing = [np.nan] * 2
    lefts_and_widths = [[0, 10], [2, 12], [4, 14], [6, 16], [8, 18], nothing, nothing]
    np.testing.assert_array_equal(found.boxes[:7, ::2], lefts_and_widths)
    # The last box has no end: it stays to the end of the clip.
    np.testing.assert_array_equal(found.boxes[7:, ::2], [[4, 10]] * 3)
    np.testing.assert_array_equal(np.flatnonzero(found.lost), [5, 6])
    np.testing.assert_array_equal(np.flatnonzero(found.keyframes), [0, 4, 5, 7])


def test_cvat_is_told_what_is_not_on_a_line(tmp_path):
    lefts = np.array([0, 1, 2, 3, 9, 5, 6, 6.001, 6])
    boxes = [[x, 0, 10, 10] for x in lefts]
    marked = np.isin(np.arange(9), [0, 3, 6])
    track = object_track("cat", 0, boxes, keyframes=marked)
    formats.write(tmp_path / "a.xml", Tracks((track,)))
    (found,) = formats.read(tmp_path / "a.xml").objects
    np.testing.assert_array_equal(np.flatnonzero(found.keyframes), [0, 3, 4, 5, 6, 8])
    np.testing.assert_allclose(found.boxes[:, 0], lefts, atol=0.01)


def test_cvat_ends_a_track_before_the_end_of_the_clip(tmp_path):
    path = tmp_path / "a.xml"
    tracks = Tracks((object_track("cat", 1, [[1, 2, 3, 4]]),), SIZE)
    for length, outside in ((None, True), (2, False), (3, True)):
        formats.write(path, tracks._replace(length=length))
        assert ('<box frame="2" outside="1"' in path.read_text()) == outside
        assert len(formats.read(path).objects[0].boxes) == 1


def test_tracks_of_a_label_have_its_number(tmp_path):
    objects = [object_track(name, 0, [[1, 2, 3, 4]], label="car") for name in ("5", "9")]
    for name, path in (("cvat", tmp_path / "a.xml"), ("yolo", tmp_path / "yolo")):
        formats.write(path, Tracks(tuple(objects), SIZE), name)
        found = [(track.name, track.label) for track in formats.read(path).objects]
        assert found == [("car-5", "car"), ("car-9", "car")]


def test_yolo_lines_of_one_object_a_class_are_what_is_trained_with(tmp_path):
    tracks = Tracks((object_track("cat", 4, [[320, 180, 64, 36]]),), SIZE, source="a/clip.mp4")
    formats.write(tmp_path / "yolo", tracks, "yolo")
    (file,) = (tmp_path / "yolo" / "labels").iterdir()
    assert file.name == "clip_000005.txt"
    assert file.read_text() == "0 0.55 0.55 0.1 0.1\n"


@pytest.mark.parametrize(
    ("lines", "names", "confidence"),
    [
        ("2 0.5 0.5 0.1 0.1 7\n2 0.5 0.5 0.2 0.1 8\n", ["2-7", "2-8"], [np.nan, np.nan]),
        ("2 0.5 0.5 0.1 0.1 0.25\n", ["2"], [0.25]),
        ("2 0.5 0.5 0.1 0.1 0.25 7\n1 0.5 0.5 0.2 0.1 1 8\n", ["1", "2"], [1, 0.25]),
    ],
)
def test_yolo_lines_of_a_tracker(tmp_path, lines, names, confidence):
    """As Ultralytics' save_txt writes them, with save_conf and without; no names of classes."""
    (tmp_path / "labels").mkdir()
    (tmp_path / "labels" / "clip_3.txt").write_text(lines)
    tracks = formats.read(tmp_path, size=SIZE)
    assert [track.name for track in tracks.objects] == names
    assert [track.start for track in tracks.objects] == [2] * len(names)
    np.testing.assert_array_equal([track.confidence[0] for track in tracks.objects], confidence)


def test_yolo_takes_names_of_classes(tmp_path):
    pytest.importorskip("yaml")
    (tmp_path / "labels").mkdir()
    (tmp_path / "labels" / "frame_000000.txt").write_text("1 0.5 0.5 0.1 0.1\n")
    for file, text in (
        ("data.yaml", "names:\n  0: dog\n  1: cat\n"),
        ("data.yaml", "names: [dog, cat]\n"),
        ("classes.txt", "dog\ncat\n"),
    ):
        (tmp_path / file).write_text(text)
        (found,) = formats.read(tmp_path, size=SIZE).objects
        assert (found.name, found.start) == ("cat", 0)
        (tmp_path / file).unlink()
