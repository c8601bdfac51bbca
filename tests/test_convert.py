"""`dcs-jax convert` as a user sees it: one line of result, one sentence for bad input."""

import numpy as np
import pytest
from track_files import SIZE, object_track, some_tracks
from typer.testing import CliRunner

from dcs_jax import formats
from dcs_jax.cli import app


def convert(*arguments):
    return CliRunner().invoke(app, ["convert", *map(str, arguments)])


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "tracks.csv"
    formats.write(path, some_tracks())
    return path


@pytest.mark.parametrize("format", formats.NAMES)
def test_a_table_becomes_any_format(table, tmp_path, format):
    out = tmp_path / "out"
    result = convert(table, out, "--to", format, "--size", "640x360", "--length", 9)
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout == f"2 objects, 5 boxes in {out} ({format})\n"
    assert formats.sniff(out) == format
    tracks = formats.read(out, size=SIZE)
    assert sum(track.visible.sum() for track in tracks.objects) == 5
    back = convert(out, tmp_path / "back.csv", "--size", "640X360")
    assert back.exit_code == 0, back.stderr


def test_the_suffix_says_the_format(table, tmp_path):
    result = convert(table, tmp_path / "a.xml")
    assert result.stdout == f"2 objects, 5 boxes in {tmp_path / 'a.xml'} (cvat)\n"
    one = tmp_path / "one.csv"
    formats.write(one, formats.Tracks((object_track("cat", 0, [[1, 2, 3, 4]]),)))
    result = convert(one, tmp_path / "one.txt")
    assert result.stdout == f"1 object, 1 box in {tmp_path / 'one.txt'} (otb)\n"


def test_the_format_of_the_source_may_be_told(tmp_path):
    """Six columns are MOT's, with or without a confidence."""
    source = tmp_path / "a.txt"
    source.write_text("1,1,1,1,5,5\n")
    assert convert(source, tmp_path / "a.csv", "--from", "mot").exit_code == 0
    result = convert(source, tmp_path / "a.csv", "--from", "otb")
    assert (result.exit_code, "expected four numbers x,y,w,h" in result.stderr) == (2, True)


def test_size_and_length_are_written(table, tmp_path):
    convert(table, tmp_path / "a.json", "--size", "320x240", "--length", 50)
    tracks = formats.read(tmp_path / "a.json")
    assert (tracks.size, tracks.length) == ((320, 240), 50)
    np.testing.assert_array_equal(tracks.objects[1].boxes[0], [1, 2, 3, 4])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["out.csv", "--from", "kitti"], "format must be one of csv, otb, mot, cvat, coco, yolo"),
        (["out.csv", "--to", "kitti"], "format must be one of csv, otb, mot, cvat, coco, yolo"),
        (["out"], "has no suffix that says the format: expected .csv (csv)"),
        (["out.json"], "coco needs the size of the frames"),
        (["out.json", "--size", "640"], "--size is '640': expected width and height in pixels"),
        (["out.json", "--size", "0x9"], "--size is '0x9'"),
        (["out.csv", "--length", "3"], "length must be at least 5"),
        (["out.txt"], "would hold 2 objects"),
        (["tracks.csv"], "is the source: it would be overwritten"),
        (["out.csv", "--from", "coco"], "line 1 is not JSON"),
    ],
)
def test_bad_calls_are_one_sentence(table, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    before = table.read_bytes()
    result = convert(table, *arguments)
    assert result.exit_code == 2
    assert message in result.stderr
    assert result.stderr.startswith("error: ")
    assert result.stderr.count("\n") == 1
    assert table.read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["tracks.csv"]


def test_a_source_that_is_missing(tmp_path):
    result = convert(tmp_path / "none.csv", tmp_path / "out.xml")
    assert result.exit_code == 2
    assert "none.csv: No such file or directory" in result.stderr
