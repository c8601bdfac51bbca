"""Annotations in, results out."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dcs_jax.io.annotations import BoxWriter, find_annotation, read_boxes

coordinates = st.floats(-1e4, 1e4, width=32)


@pytest.mark.parametrize("separator", [",", "\t", " ", ", ", "  ", " ,"])
def test_separators(tmp_path, separator):
    path = tmp_path / "boxes.txt"
    path.write_text("".join(separator.join(row) + "\n" for row in (["1", "2.5", "3", "4"],) * 2))
    np.testing.assert_array_equal(read_boxes(path), [[1, 2.5, 3, 4]] * 2)


@pytest.mark.parametrize("nothing", ["NaN,NaN,NaN,NaN", "0,0,0,0", "1,1,-1,-1", "-1,-1,-1,-1"])
def test_unlabelled_frames_are_nan(tmp_path, nothing):
    path = tmp_path / "boxes.txt"
    path.write_text(f"1,2,3,4\r\n{nothing}\r\n5,6,7,8\r\n\r\n")
    boxes = read_boxes(path)
    assert boxes.dtype == np.float64
    np.testing.assert_array_equal(boxes, [[1, 2, 3, 4], [np.nan] * 4, [5, 6, 7, 8]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("1,2,3,4\n1,2,3\n", "line 2 is '1,2,3': expected four numbers"),
        ("1,2,3,4\n1,2,3,4,5\n", "line 2"),
        ("x,y,w,h\n1,2,3,4\n", "line 1 is 'x,y,w,h'"),
        ("1,2,3,4\n\n1,2,3,4\n", "line 2 is ''"),
        ("1,2,0,4\n", "w and h positive"),
        ("1,2,3,-4\n", "w and h positive"),
        ("1,inf,3,4\n", "finite"),
    ],
)
def test_bad_annotations(tmp_path, text, message):
    path = tmp_path / "boxes.txt"
    path.write_text(text)
    with pytest.raises(ValueError, match=message):
        read_boxes(path)


def test_annotation_of_a_folder_of_images(tmp_path):
    images = tmp_path / "david" / "img"
    images.mkdir(parents=True)
    assert find_annotation(images) is None
    truth = tmp_path / "david" / "groundtruth_rect.txt"
    truth.write_text("1,2,3,4\n")
    assert find_annotation(images) == truth
    assert find_annotation(tmp_path / "david") == truth
    own = images / "groundtruth_rect.txt"
    own.write_text("1,2,3,4\n")
    assert find_annotation(images) == own


def test_annotation_of_the_parent_folder_is_not_used(tmp_path):
    (tmp_path / "frames").mkdir()
    (tmp_path / "groundtruth_rect.txt").write_text("1,2,3,4\n")
    assert find_annotation(tmp_path / "frames") is None
    assert find_annotation(tmp_path / "video.mp4") is None


@given(st.lists(st.tuples(*[coordinates] * 5), min_size=1, max_size=6), st.integers(0, 10**6))
def test_results_are_read_back_exactly(tmp_path_factory, rows, start):
    path = tmp_path_factory.mktemp("results") / "boxes.csv"
    table = np.array(rows, np.float32)
    lost = np.arange(len(rows)) % 2
    with BoxWriter(path) as writer:
        for part in (slice(0, 1), slice(1, None)):
            frames = range(start, start + len(rows))[part]
            writer.write(table[None, part, :4], table[None, part, 4], lost[None, part], frames)
    assert path.read_text().splitlines()[0] == "frame,x,y,w,h,confidence,lost"
    found = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    np.testing.assert_array_equal(found[:, 0], start + np.arange(len(rows)))
    np.testing.assert_array_equal(found[:, 1:6].astype(np.float32), table)
    np.testing.assert_array_equal(found[:, 6], lost)


def test_a_confidence_of_nan_is_an_empty_field(tmp_path):
    path = tmp_path / "boxes.csv"
    with BoxWriter(path) as writer:
        writer.write([[[1, 2, 3, 4], [5, 6, 7, 8]]], [[0.5, np.nan]], [[False, True]], (0, 4))
    assert path.read_text().splitlines()[1:] == ["0,1.0,2.0,3.0,4.0,0.5,0", "4,5.0,6.0,7.0,8.0,,1"]


def test_several_objects_have_names_and_only_rows_with_a_box(tmp_path):
    path = tmp_path / "boxes.csv"
    boxes = np.arange(16.0).reshape(2, 2, 4)
    boxes[1, 0] = np.nan
    with BoxWriter(path, ["a car", "b"]) as writer:
        writer.write(boxes, np.full((2, 2), 0.5), np.zeros((2, 2), bool), (7, 8))
    assert path.read_text().splitlines() == [
        "id,frame,x,y,w,h,confidence,lost",
        "a car,7,0.0,1.0,2.0,3.0,0.5,0",
        "a car,8,4.0,5.0,6.0,7.0,0.5,0",
        "b,8,12.0,13.0,14.0,15.0,0.5,0",
    ]


def test_every_chunk_reaches_the_disk(tmp_path):
    writer = BoxWriter(tmp_path / "boxes.csv")
    with writer:
        writer.write([[[1, 2, 3, 4]]], [[0.5]], [[False]], (7,))
        text = (tmp_path / "boxes.csv").read_text()
    assert text == "frame,x,y,w,h,confidence,lost\n7,1.0,2.0,3.0,4.0,0.5,0\n"


def test_a_table_has_one_writer(tmp_path):
    path = tmp_path / "boxes.csv"
    with BoxWriter(path) as writer:
        writer.write([[[1, 2, 3, 4]]], [[0.5]], [[False]], (7,))
        with pytest.raises(ValueError, match=r"boxes\.csv is being written by another run"):
            BoxWriter(path)
    assert len(path.read_text().splitlines()) == 2
    with BoxWriter(path):
        pass
    assert len(path.read_text().splitlines()) == 1
