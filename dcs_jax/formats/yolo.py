"""YOLO's folder: labels/NAME_000001.txt per frame, and data.yaml, which names the classes.

    class cx cy w h [confidence] [id]

cx, cy is the centre of the box; all four are in widths and heights of the frame, which has to be
known. This is what Ultralytics' tracker writes (save_txt, save_conf). Frames are counted from 1;
one without a box has no file. Confidence is there where it is known. Id is there with a confidence,
and where objects share a class: without either, lines are what YOLO is trained with. A sixth number
alone is an id, if it is a whole number in every line of the folder that has one.

Boxes are cut at the edges of the frame, and those beyond them left out: a trainer refuses others.
The class is the object's label or, without one, its name. data.yaml is written as JSON, which is
YAML, and has the size and length of the clip beside what a trainer looks for.
"""

import json
import math
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dcs_jax.formats.assembly import VisibleRows, assemble, decimals, visible_rows
from dcs_jax.formats.tracks import LAST_FRAME, Tracks, ids_of, names_of
from dcs_jax.formats.yolo_classes import CLASSES, DATA, facts_of, lines_of
from dcs_jax.io.files import atomic_folder

LABELS = "labels"
SMALLEST = 1e-6  # pixels, a side of what is left of a box in the frame
EXPECTED = "class cx cy w h, each of the four in [0, 1], and optionally a confidence and an id"


def write(path: Path, tracks: Tracks) -> None:
    """Write a new folder.

    Raises ValueError if the frame size is unknown, or the folder is there and not empty.
    """
    if tracks.size is None:
        raise ValueError(f"{path}: yolo needs the size of the frames, width and height in pixels")
    classes = list(dict.fromkeys(track.category for track in tracks.objects))
    numbers = [classes.index(track.category) for track in tracks.objects]
    rows, boxes = _in_frame(visible_rows(tracks), tracks.size)
    scored = ~np.isnan(rows.confidence)
    with_ids = len(classes) < len(numbers) or bool(scored.any())
    ids = ids_of(tracks)
    stem = Path(tracks.source or "frame").stem
    with atomic_folder(path) as folder:
        (folder / LABELS).mkdir()
        (folder / DATA).write_text(_data(tracks, classes), encoding="utf-8")
        lines: dict[int, list[str]] = {}
        for owner, frame, box, score in zip(
            rows.owners.tolist(), rows.frames.tolist(), boxes.tolist(), rows.confidence, strict=True
        ):
            fields = [str(numbers[owner]), *(f"{side:.10g}" for side in box)]
            if not np.isnan(score):
                fields.append(str(score))
            if with_ids:
                fields.append(str(ids[owner]))
            lines.setdefault(frame, []).append(" ".join(fields) + "\n")
        for frame, found in lines.items():
            name = f"{stem}_{frame + 1:06d}.txt"
            (folder / LABELS / name).write_text("".join(found), encoding="utf-8")


def read(path: Path, size: tuple[int, int] | None = None) -> Tracks:
    """Read a folder; ValueError names the file and the line.

    size: width and height of the frames in pixels, needed where data.yaml does not say it.

    Files are numbered from 0 where there is a number 0, as CVAT writes them.
    """
    facts = facts_of(path)
    size = size or facts.size
    if size is None:
        raise ValueError(
            f"{path}: yolo needs the size of the frames, width and height in pixels, "
            f"and {DATA} does not say it"
        )
    files = _numbered(path)
    first = 0 if 0 in files else 1
    lines = [
        _parse(line, file, n, number - first)
        for number, file in sorted(files.items())
        for n, line in enumerate(lines_of(file), 1)
        if line.strip()
    ]
    # An id, unless one of them cannot be one.
    sixth_is_id = all(line.more[0].is_integer() for line in lines if len(line.more) == 1)
    ids = [line.id(sixth_is_id) for line in lines]
    keys = sorted({(line.label, id) for line, id in zip(lines, ids, strict=True)})
    number = {key: n for n, key in enumerate(keys)}
    labels = [facts.label(label) for label, _ in keys]
    names = names_of(labels, [id for _, id in keys])
    width, height = size
    boxes = np.array([line.box for line in lines], float).reshape(-1, 4)
    boxes[:, :2] -= boxes[:, 2:] / 2
    objects = assemble(
        names,
        np.array([number[line.label, id] for line, id in zip(lines, ids, strict=True)], int),
        np.array([line.frame for line in lines], int),
        boxes * (width, height, width, height),
        np.array([line.confidence(sixth_is_id) for line in lines], float),
        lambda row: f"{lines[row].file}, line {lines[row].number}",
    )
    objects = tuple(
        track._replace(label=None if label == track.name else label)
        for track, label in zip(objects, labels, strict=True)
    )
    length = max([facts.length or 0, *(track.end for track in objects)]) or None
    return Tracks(objects, size, length if facts.length else None, facts.source, facts.fps)


class _Line(NamedTuple):
    """A line of a file: class, cx, cy, w, h, and up to two numbers more."""

    file: Path
    number: int
    frame: int
    label: int
    box: list[float]
    more: list[float]

    def id(self, sixth_is_id: bool) -> int:
        if len(self.more) == 2 or (self.more and sixth_is_id):
            return int(self.more[-1])
        return 0

    def confidence(self, sixth_is_id: bool) -> float:
        if len(self.more) == 2 or (self.more and not sixth_is_id):
            return self.more[0]
        return math.nan


def _data(tracks: Tracks, classes: list[str]) -> str:
    data: dict[str, Any] = {"path": ".", "train": "images", "val": "images", "names": classes}
    facts = [(name, getattr(tracks, name)) for name in ("size", "length", "source", "fps")]
    data |= {name: value for name, value in facts if value is not None}
    fields = (f"{json.dumps(name)}: {json.dumps(data[name], ensure_ascii=False)}" for name in data)
    return "{\n" + ",\n".join(fields) + "\n}\n"


def _in_frame(rows: VisibleRows, size: tuple[int, int]) -> tuple[VisibleRows, NDArray[np.float64]]:
    """The rows with a part in the frame, and that part [m, 4] as cx, cy, w, h in [0, 1]."""
    corners = decimals(rows.boxes)
    corners[:, 2:] += corners[:, :2]
    corners = np.clip(corners, 0, (*size, *size))
    sides = corners[:, 2:] - corners[:, :2]
    kept = (sides > SMALLEST).all(axis=1)
    boxes = np.column_stack([(corners[:, :2] + corners[:, 2:]) / 2, sides]) / (*size, *size)
    kept_rows = VisibleRows(
        rows.owners[kept], rows.frames[kept], rows.boxes[kept], rows.confidence[kept]
    )
    return kept_rows, boxes[kept]


def _numbered(path: Path) -> dict[int, Path]:
    """The files of labels by the last number in their names."""
    folder = path / LABELS if (path / LABELS).is_dir() else path
    found: dict[int, Path] = {}
    for file in sorted(folder.glob("*.txt")):
        if file.name == CLASSES:
            continue
        digits = re.search(r"([0-9]{1,9})[^0-9]*$", file.stem)
        if digits is None:
            raise ValueError(f"{file} has no number in its name: expected that of its frame")
        number = int(digits[1])
        if number in found:
            raise ValueError(f"{file} and {found[number].name} have the same number {number}")
        found[number] = file
    if not found:
        raise ValueError(f"{folder} has no files *.txt: expected one per frame")
    return found


def _parse(line: str, file: Path, n: int, frame: int) -> _Line:
    def refuse() -> ValueError:
        return ValueError(f"{file}, line {n} is {line.strip()[:80]!r}: expected {EXPECTED}")

    try:
        label, *numbers = map(float, line.split())
    except ValueError:
        raise refuse() from None
    box, more = numbers[:4], numbers[4:]
    # Rounded numbers may be above 1 by a little.
    good = len(box) == 4 and all(0 <= side <= 1 + 1e-3 for side in box) and min(box[2:]) > 0
    whole = label.is_integer() and 0 <= label <= LAST_FRAME
    if not good or not whole or len(more) > 2 or not all(map(math.isfinite, more)):
        raise refuse()
    if len(more) == 2 and not more[1].is_integer():
        raise refuse()
    return _Line(file, n, frame, int(label), box, more)
