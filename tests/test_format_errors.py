"""What is wrong with a file or with tracks is said in a sentence, and nothing is left of it."""

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from track_files import SIZE, cvat, cvat_box, object_track, some_tracks

from dcs_jax import formats
from dcs_jax.formats import Tracks, assembly


def test_a_folder_that_is_not_empty_is_left_alone(tmp_path):
    (tmp_path / "yolo").mkdir()
    formats.write(tmp_path / "yolo", some_tracks(), "yolo")
    for format in ("yolo", "otb"):
        with pytest.raises(ValueError, match="not empty: expected a new folder"):
            formats.write(tmp_path / "yolo", some_tracks(), format)
    assert [path.name for path in tmp_path.iterdir()] == ["yolo"]


@pytest.mark.parametrize("format", formats.NAMES)
def test_what_fails_leaves_nothing(tmp_path, format):
    tracks = some_tracks()
    wrong = tracks.objects[0]._replace(boxes=tracks.objects[0].boxes * np.inf)
    with pytest.raises(ValueError, match="must have finite boxes"):
        formats.write(tmp_path / "out", Tracks((wrong,), SIZE), format)
    assert not list(tmp_path.iterdir())


def test_formats_by_suffix(tmp_path):
    for name in ("a.csv", "a.xml", "a.JSON"):
        formats.write(tmp_path / name, some_tracks())
    assert [formats.sniff(tmp_path / name) for name in ("a.csv", "a.xml", "a.JSON")] == [
        "csv",
        "cvat",
        "coco",
    ]
    with pytest.raises(ValueError, match=r"a.txt would hold 2 objects, but .* expected a folder"):
        formats.write(tmp_path / "a.txt", some_tracks())
    with pytest.raises(ValueError, match=r"no suffix that says the format: expected \.csv \(csv\)"):
        formats.write(tmp_path / "a", some_tracks())
    with pytest.raises(ValueError, match="format must be one of csv, otb, mot, cvat, coco, yolo"):
        formats.write(tmp_path / "a.csv", some_tracks(), "kitti")


@pytest.mark.parametrize("format", ["coco", "yolo"])
def test_a_format_that_needs_the_frame_size(tmp_path, format):
    with pytest.raises(ValueError, match=f"{format} needs the size of the frames"):
        formats.write(tmp_path / "a", some_tracks(size=None), format)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"name": ""}, "text without control characters"),
        ({"name": "a\nb"}, "text without control characters"),
        ({"start": -1}, "frame counted from 0"),
        ({"boxes": np.zeros((3, 3))}, r"boxes \[n, 4\]"),
        ({"boxes": np.array([[1, 2, 0, 4]] * 3)}, "w and h positive"),
        ({"boxes": np.array([[1, np.nan, 3, 4]] * 3)}, "four NaN"),
        ({"boxes": np.array([[1e39, 2, 3, 4]] * 3)}, "finite boxes"),
        ({"confidence": np.zeros(2)}, "3 boxes, but confidence has the shape"),
        ({"confidence": np.full(3, np.inf)}, "finite confidences"),
        ({"lost": np.zeros(2, bool)}, "3 boxes, but lost"),
        ({"name": "7"}, "must differ, but '7' is there twice"),
    ],
)
def test_tracks_that_are_wrong(tmp_path, change, message):
    tracks = some_tracks()
    objects = (tracks.objects[0]._replace(**change), tracks.objects[1])
    with pytest.raises(ValueError, match=message):
        formats.write(tmp_path / "a.csv", tracks._replace(objects=objects))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"size": (640, 0)}, "a width and a height"),
        ({"size": 640}, "a width and a height"),
        ({"length": 4}, "length must be at least 5"),
        ({"fps": np.nan}, "fps must be finite"),
        ({"source": "\x00"}, "source must have no control characters"),
    ],
)
def test_facts_that_are_wrong(tmp_path, fields, message):
    with pytest.raises(ValueError, match=message):
        formats.write(tmp_path / "a.csv", some_tracks(**fields))


HEAD = "frame,x,y,w,h,confidence\n"
DEEP = "[" * 100_000
COCO: dict[str, Any] = {
    "videos": [{"id": 1, "name": "a"}],
    "images": [{"id": 5, "frame_id": 0, "video_id": 1}],
    "categories": [{"id": 1, "name": "cat"}],
    "annotations": [{"image_id": 5, "category_id": 1, "track_id": 3, "bbox": [1, 2, 3, 4]}],
}


def coco(**changes):
    annotation = COCO["annotations"][0] | changes
    return json.dumps(COCO | {"annotations": [annotation]})


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.csv", "", "is empty"),
        ("a.csv", HEAD, "has no rows"),
        ("a.csv", HEAD + "0,1,2,3\n", "line 2 has 4 cells: expected frame, x, y, w, h, confidence"),
        ("a.csv", HEAD + "0,1,2,3,4,\nx,1,2,3,4,\n", "line 3, column frame is 'x'"),
        ("a.csv", HEAD + "1.5,1,2,3,4,\n", "line 2, column frame is '1.5': expected a frame"),
        ("a.csv", HEAD + "-1,1,2,3,4,\n", "line 2, column frame is '-1'"),
        ("a.csv", HEAD + "1e300,1,2,3,4,\n", "line 2, column frame is '1e300'"),
        ("a.csv", HEAD + "0,1,inf,3,4,\n", "line 2, column y is 'inf': expected finite pixels"),
        ("a.csv", HEAD + "0,1,,3,4,\n", "line 2, column y is '': expected finite pixels"),
        ("a.csv", HEAD + "0,1,2,3,0,\n", "line 2, column h is '0': expected a positive side"),
        ("a.csv", HEAD + "0,1,2,3,4,inf\n", "line 2, column confidence is 'inf'"),
        ("a.csv", HEAD + "0,1,2,3,4,\n0,1,2,3,4,\n", "line 3 is a second box of 'a' in the"),
        ("a.csv", HEAD + "0,1,2,3,4,\n999999999,1,2,3,4,\n", "1000000000 boxes; expected"),
        ("a.csv", "frame,x,y,w\n0,1,2,3\n", "line 1: the column h is missing"),
        ("a.csv", "frame,x,x,w\n0,1,2,3\n", "line 1 has the column 'x' twice"),
        ("a.csv", "id," + HEAD + ",0,1,2,3,4,\n", "line 2, column id is '': expected a name"),
        ("a.csv", "lost," + HEAD + "2,0,1,2,3,4,\n", "column lost is '2': expected 0 or 1"),
        ("a.csv", 'id,frame,x,y,w,h\n"a,0,1,2', "expected id, frame, x, y, w, h"),
        ("a.txt", "1,2,3,4\n1,2,3\n", "line 2 is '1,2,3': expected four numbers"),
        ("a.txt", "1,2,3,4\n1,2,3,-4\n", "line 2"),
        ("a.txt", "1,2,3,4\n1e39,2,3,4\n", "finite boxes"),
        ("a.txt", "hello\n", "begins with 'hello': expected a table with a column frame"),
        ("mot.txt", "1,1,1,1,5,5,1,-1,-1,-1\n1,2,1\n", "line 2 has 3 cells: expected frame, id"),
        ("mot.txt", "0,1,1,1,5,5,1,-1,-1,-1\n", "column frame is '0': expected a frame"),
        ("mot.txt", "1,a,1,1,5,5,1,-1,-1,-1\n1,1,1,1,5,5,1,-1,-1,-1\n", "begins with '1,a,1"),
        ("mot.txt", "1,1,1,1,5,5,1\n2,1,1,nan,5,5,1\n", "line 2, column y is 'nan'"),
        ("mot.txt", "1,1,1,1,5,5,1\n1,1,1,1,5,5,1\n", "line 2 is a second box of '1' in the same"),
        ("a.xml", cvat(cvat_box(0, 1))[:-20], "line 1 is not XML: unclosed token"),
        ("a.xml", "<!DOCTYPE a [<!ENTITY b 'c'>]><annotations/>", "document type, which is"),
        ("a.xml", "<html></html>", "begins with <html>: expected <annotations>"),
        ("a.xml", "<annotations><image/></annotations>", "expected CVAT for video"),
        ("a.xml", cvat(cvat_box(0, "NaN", right=1)), "xtl is 'NaN': expected a number of pixels"),
        ("a.xml", cvat(cvat_box(0, 1, right=1)), "xbr is '1': expected more than xtl"),
        ("a.xml", cvat(cvat_box(-1, 1)), "frame is '-1': expected a frame"),
        ("a.xml", cvat(cvat_box(0, 1, outside="x")), "outside is 'x': expected 0 or 1"),
        ("a.xml", cvat(cvat_box(1, 1) * 2), "second box of track 0 ('cat') in the same"),
        ("a.xml", cvat('<box frame="1"/>'), "line 1 has a box without xtl"),
        ("a.xml", cvat(cvat_box(0, 1), "<task><size>x</size></task>"), "size in meta is 'x'"),
        (
            "a.xml",
            cvat(cvat_box(0, 1), "<task><size>999999999</size></task>"),
            "999999999 boxes; expected",
        ),
        ("a.json", coco()[:-5], "line 1 is not JSON"),
        ("a.json", '{"a": ' + DEEP, "nested too deeply"),
        ("a.json", "{}", "has no videos: expected COCO's JSON for videos"),
        ("a.json", '{"videos": 3}', "videos is not a list of records"),
        ("a.json", '{"videos": [3]}', "videos[0] is not a record"),
        ("a.json", json.dumps(COCO | {"videos": [{}, {}]}), "has 2 videos: expected one"),
        ("a.json", coco(bbox=[1, 2, 3]), "annotations[0].bbox is [1, 2, 3]: expected four finite"),
        ("a.json", coco(bbox=[1, 2, 3, 0]), "annotations[0].bbox is [1, 2, 3, 0]"),
        ("a.json", coco(bbox=[1, 2, 3, True]), "annotations[0].bbox is [1, 2, 3, True]"),
        ("a.json", coco(bbox=[1e39, 2, 3, 4]), "annotations[0].bbox is [1e+39, 2, 3, 4]"),
        ("a.json", coco(bbox=[np.nan, 2, 3, 4]), "NaN is not a number of JSON"),
        ("a.json", coco(image_id=6), "annotations[0].image_id is 6: expected the id of one of"),
        ("a.json", coco(track_id="x"), "annotations[0].track_id is 'x': expected a whole number"),
        ("a.json", coco(score="x"), "annotations[0].score is 'x': expected a finite number"),
        ("a.json", json.dumps(COCO | {"images": [{"id": 5}]}), "has no frame_id or frame_index"),
    ],
)  # fmt: skip
def test_errors_name_the_file_and_the_place(tmp_path, name, text, message):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(ValueError, match=name) as error:
        formats.read(path)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("0 0.5 0.5 0.1", "expected class cx cy w h"),
        ("0 0.5 0.5 0.1 x", "expected class cx cy w h"),
        ("0 0.5 0.5 0.1 0", "expected class cx cy w h"),
        ("0 0.5 0.5 0.1 nan", "expected class cx cy w h"),
        ("0 0.5 320 0.1 0.1", "expected class cx cy w h"),
        ("0.5 0.5 0.5 0.1 0.1", "expected class cx cy w h"),
        ("0 0.5 0.5 0.1 0.1 0.5 0.5", "expected class cx cy w h"),
        ("0 0.5 0.5 0.1 0.1\n0 0.5 0.5 0.1 0.1", "line 2 is a second box of '0' in"),
    ],
)
def test_errors_of_yolo_name_the_file_and_the_line(tmp_path, line, message):
    (tmp_path / "labels").mkdir()
    (tmp_path / "labels" / "a_3.txt").write_text(line)
    with pytest.raises(ValueError, match=r"a_3.txt, line \d") as error:
        formats.read(tmp_path, size=SIZE)
    assert message in str(error.value)


def test_folders_that_are_wrong(tmp_path):
    with pytest.raises(ValueError, match="is a folder without labels"):
        formats.read(tmp_path)
    with pytest.raises(ValueError, match="is a folder: expected a file of cvat"):
        formats.read(tmp_path, "cvat")
    (tmp_path / "labels").mkdir()
    with pytest.raises(ValueError, match="yolo needs the size of the frames"):
        formats.read(tmp_path)
    with pytest.raises(ValueError, match=r"has no files \*.txt"):
        formats.read(tmp_path, size=SIZE)
    (tmp_path / "a.csv").write_text(HEAD)
    with pytest.raises(ValueError, match="is a file: expected a folder of yolo"):
        formats.read(tmp_path / "a.csv", "yolo")
    with pytest.raises(FileNotFoundError):
        formats.read(tmp_path / "b.csv")


def test_files_of_otb_of_different_lengths(tmp_path):
    (tmp_path / "a.txt").write_text("1,2,3,4\n")
    (tmp_path / "b.txt").write_text("1,2,3,4\n5,6,7,8\n")
    with pytest.raises(ValueError, match=r"a.txt has 1 lines, but .*b.txt 2"):
        formats.read(tmp_path)


def test_names_that_would_be_one_file(tmp_path):
    tracks = Tracks(tuple(object_track(name, 0, [[1, 2, 3, 4]]) for name in ("a", "A")))
    with pytest.raises(ValueError, match="'A' and 'a' would be one file"):
        formats.write(tmp_path / "a", tracks, "otb")


def test_tracks_that_would_not_fit_into_memory(tmp_path, monkeypatch):
    monkeypatch.setattr(assembly, "MOST_BOXES", 20)
    (tmp_path / "a.csv").write_text(HEAD + "0,1,2,3,4,\n20,1,2,3,4,\n")
    with pytest.raises(ValueError, match="are 21 boxes; expected 20 at most"):
        formats.read(tmp_path / "a.csv")


@pytest.fixture(scope="module")
def contents(tmp_path_factory):
    """What is in the files of each format, to be damaged."""
    folder = tmp_path_factory.mktemp("good")
    found = {}
    for name in formats.NAMES:
        path = folder / name
        formats.write(path, some_tracks(), name)
        files = [path] if path.is_file() else sorted(p for p in path.rglob("*") if p.is_file())
        found[name] = [(str(file.relative_to(folder)), file.read_bytes()) for file in files]
    return found


pieces = st.one_of(
    st.binary(max_size=3),
    st.sampled_from(
        [b"nan", b"inf", b"-1", b"1e999", b"9999999999", b"\x00", b'"', b",", b"\n", b"<", b"null"]
    ),
)


@pytest.mark.parametrize("name", formats.NAMES)
@settings(max_examples=200)
@given(data=st.data())
def test_a_damaged_file_is_refused_or_read(contents, tmp_path_factory, name, data):
    """Some bytes are replaced, or the file is cut short: no other error, no warning."""
    folder = tmp_path_factory.mktemp("damaged")
    number = data.draw(st.integers(0, len(contents[name]) - 1))
    for at, (file, content) in enumerate(contents[name]):
        if at == number:
            start = data.draw(st.integers(0, len(content)))
            end = data.draw(st.one_of(st.just(len(content)), st.integers(start, start + 8)))
            content = content[:start] + data.draw(pieces) + content[end:]
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_bytes(content)
    try:
        tracks = formats.read(folder / name, name)
    except ValueError as error:
        message = str(error)
    else:
        formats.write(folder / "again.csv", tracks)
        return
    assert str(folder) in message


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"size": [640]}', "data.yaml.size is [640]: expected a width and a height"),
        ('{"names": [[]]}', "data.yaml.names is [[]]: expected a list of names"),
        ('{"names": {"a": "b"}}', "data.yaml.names is {'a': 'b'}: expected a list of names"),
        ('{"length": "x"}', "data.yaml.length is 'x': expected a whole number"),
        ("[]", "data.yaml holds a list: expected names of classes"),
    ],
)
def test_errors_in_the_classes_of_yolo(tmp_path, text, message):
    (tmp_path / "data.yaml").write_text(text)
    with pytest.raises(ValueError, match=r"data\.yaml") as error:
        formats.read(tmp_path)
    assert message in str(error.value)


@pytest.mark.parametrize("name", ["size", "length", "source", "names"])
def test_yaml_that_would_grow_without_bound(tmp_path, name):
    pytest.importorskip("yaml")
    levels = "".join(f"l{n}: &l{n} [{', '.join([f'*l{n - 1}'] * 9)}]\n" for n in range(1, 30))
    (tmp_path / "data.yaml").write_text(f"l0: &l0 [a]\n{levels}{name}: *l29\n")
    with pytest.raises(ValueError, match=rf"data\.yaml\.{name} is \[\[\[.*: expected"):
        formats.read(tmp_path)
