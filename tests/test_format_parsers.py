"""Parsers that are not ours read the same boxes."""

import importlib.metadata
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from track_files import SIZE, some_tracks

from dcs_jax import formats
from dcs_jax.formats import Tracks, to_supervision


def visible(tracks):
    """Boxes by (number of the object, frame)."""
    return {
        (number, track.start + row): track.boxes[row]
        for number, track in enumerate(tracks.objects, 1)
        for row in np.flatnonzero(track.visible)
    }


@pytest.fixture
def tracks():
    return some_tracks()


# Of pandas 3, for code of motmetrics.
@pytest.mark.filterwarnings("ignore:Operation with tuple is deprecated")
def test_motmetrics(tracks, tmp_path):
    motmetrics = pytest.importorskip("motmetrics")
    formats.write(tmp_path / "a.txt", tracks, "mot")
    table = motmetrics.io.loadtxt(tmp_path / "a.txt", fmt="mot15-2D")
    boxes = {
        (number, frame - 1): row
        for (frame, number), row in zip(
            table.index, table[["X", "Y", "Width", "Height"]].to_numpy(), strict=True
        )
    }
    wanted = visible(tracks)
    assert set(boxes) == set(wanted)
    for key, box in boxes.items():
        np.testing.assert_allclose(box, wanted[key], atol=1e-9)
    confidence = table["Confidence"].xs(2, level="Id").tolist()
    np.testing.assert_allclose(confidence, [0.5, 0.1, 1], rtol=1e-7)


def test_pycocotools(tracks, tmp_path, capsys):
    coco = pytest.importorskip("pycocotools.coco")
    formats.write(tmp_path / "a.json", tracks)
    document = coco.COCO(str(tmp_path / "a.json"))
    names = [category["name"] for category in document.loadCats(document.getCatIds())]
    assert names == [track.name for track in tracks.objects]
    assert len(document.getImgIds()) == tracks.length
    wanted = visible(tracks)
    for (number, frame), box in wanted.items():
        (image,) = (i for i in document.imgs.values() if i["frame_id"] == frame)
        assert (image["width"], image["height"]) == SIZE
        (found,) = document.loadAnns(document.getAnnIds([image["id"]], [number]))
        np.testing.assert_array_equal(np.float32(found["bbox"]), box)
    assert len(document.getAnnIds()) == len(wanted)


def test_yaml_of_yolo(tracks, tmp_path):
    yaml = pytest.importorskip("yaml")
    formats.write(tmp_path / "a", tracks, "yolo")
    data = yaml.safe_load((tmp_path / "a" / "data.yaml").read_text(encoding="utf-8"))
    assert data["names"] == [track.name for track in tracks.objects]
    assert data["size"] == list(SIZE)


def test_xml_of_cvat(tracks, tmp_path):
    """As CVAT's importer reads it: the keyframes of each track."""
    formats.write(tmp_path / "a.xml", tracks)
    root = ET.parse(tmp_path / "a.xml").getroot()
    labels = [label.text for label in root.findall("meta/task/labels/label/name")]
    assert labels == [track.name for track in tracks.objects]
    found = {}
    for number, track in enumerate(root.findall("track"), 1):
        assert track.get("label") == labels[number - 1]
        for box in track.findall("box"):
            assert box.get("keyframe") == "1"
            if box.get("outside") == "0":
                corners = [float(box.get(name)) for name in ("xtl", "ytl", "xbr", "ybr")]
                sides = [corners[2] - corners[0], corners[3] - corners[1]]
                found[number, int(box.get("frame"))] = corners[:2] + sides
    assert found.keys() == visible(tracks).keys()
    for key, box in visible(tracks).items():
        np.testing.assert_allclose(found[key], box, atol=1e-9)


def test_supervision(tracks):
    supervision = pytest.importorskip("supervision")
    found = to_supervision(tracks, 2)
    assert isinstance(found, supervision.Detections)
    np.testing.assert_array_equal(found.xyxy, [[10.5, 20, 40.5, 60]])
    assert found.tracker_id.tolist() == [1]
    assert found["class_name"].tolist() == [tracks.objects[0].name]
    assert found.confidence is None
    found = to_supervision(tracks, 1)
    assert found.tracker_id.tolist() == [2]
    np.testing.assert_allclose(found.confidence, [0.1], rtol=1e-6)
    assert len(to_supervision(tracks, 8)) == 0
    supervision.BoxAnnotator().annotate(np.zeros((360, 640, 3), np.uint8), found)


def test_supervision_is_asked_for_where_it_is_missing(tracks):
    try:
        importlib.metadata.version("supervision")
    except importlib.metadata.PackageNotFoundError:
        with pytest.raises(ValueError, match="pip install supervision"):
            to_supervision(tracks, 2)
    else:
        assert isinstance(to_supervision(Tracks(()), 0).xyxy, np.ndarray)
