"""Boxes in and out: OTB annotations and the table of results.

An annotation is a text file `groundtruth_rect.txt` with one box per frame: x, y, w, h in pixels,
separated by commas, tabs or blanks. NaN, or neither width nor height, where it is unlabelled.
"""

import csv
import io
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dcs_jax.io.files import lock

ANNOTATION_NAME = "groundtruth_rect.txt"
COLUMNS = ("frame", "x", "y", "w", "h", "confidence")
# Of a table of results; one of several objects begins with a column id.
RESULT_COLUMNS = (*COLUMNS, "lost")


def read_boxes(path: str | Path) -> NDArray[np.float64]:
    """Read an annotation: boxes [T, 4], x, y, w, h in pixels; all four NaN where unlabelled.

    A frame is unlabelled where its line has a NaN, or a width and a height that are not positive,
    such as 0,0,0,0 or 1,1,-1,-1.

    Raises ValueError if there are no lines, or one is anything else than that or a box; the message
    names the line.
    """
    lines = read_lines(path)
    if not lines:
        raise ValueError(f"{path} is empty: expected one box x,y,w,h a line")
    return np.array([_parse(line, f"{path}, line {n}") for n, line in enumerate(lines, 1)])


def read_lines(path: str | Path) -> list[str]:
    """The lines of an annotation, without empty ones at its end."""
    return Path(path).read_text(encoding="utf-8-sig", errors="replace").rstrip().splitlines()


def parse_numbers(line: str, where: str, counts: Sequence[int], expected: str) -> list[float]:
    """The numbers in a line, separated by commas, tabs or blanks.

    where: file and line, for the error message.
    counts: how many numbers there may be.
    expected: what the line should hold, for the error message.

    Raises ValueError if the line is anything else.
    """
    try:
        numbers = [float(field) for field in re.split(r"\s*,\s*|\s+", line.strip())]
    except ValueError:
        numbers = []
    if len(numbers) not in counts:
        raise ValueError(f"{where} is {line.strip()!r}: expected {expected}")
    return numbers


def _parse(line: str, where: str) -> list[float]:
    box = parse_numbers(line, where, (4,), "four numbers x,y,w,h")
    if any(map(math.isnan, box)) or (box[2] <= 0 and box[3] <= 0):
        return [math.nan] * 4
    if not all(map(math.isfinite, box)) or box[2] <= 0 or box[3] <= 0:
        raise ValueError(
            f"{where} is {line.strip()!r}: expected finite numbers with w and h positive, "
            "or NaN for an unlabelled frame"
        )
    return box


def find_annotation(source: str | Path) -> Path | None:
    """The `groundtruth_rect.txt` of a folder of images, None if there is none.

    It is in the folder of the images or, if that is called `img`, in its parent.
    """
    folder = Path(source)
    if not folder.is_dir():
        return None
    parents = [folder.resolve().parent] if folder.resolve().name == "img" else []
    paths = (directory / ANNOTATION_NAME for directory in (folder, *parents, folder / "img"))
    return next((path for path in paths if path.is_file()), None)


def box_rows(boxes: ArrayLike, confidence: ArrayLike, start: int) -> Iterator[tuple[str, ...]]:
    """The rows of a table of results, with `COLUMNS`.

    Numbers have as many digits as they need to give the same float32 when read again. A confidence
    of NaN is an empty field.

    boxes: [n, 4], x, y, w, h in pixels. confidence: [n]. start: index of the first frame.
    """
    columns = np.column_stack([boxes, confidence]).astype(np.float32)
    for frame, (*box, confident) in enumerate(columns, start):
        yield str(frame), *map(str, box), "" if np.isnan(confident) else str(confident)


def result_rows(
    boxes: ArrayLike, confidence: ArrayLike, lost: ArrayLike, start: int
) -> Iterator[tuple[str, ...]]:
    """`box_rows` with `lost` [n] as 0 or 1: `RESULT_COLUMNS`. A box of NaN has no row."""
    boxes = np.asarray(boxes)
    for row, box, gone in zip(
        box_rows(boxes, confidence, start), boxes, np.asarray(lost), strict=True
    ):
        if not np.isnan(box[0]):
            yield *row, str(int(gone))


class BoxWriter:
    """Writes results as a table, one row per frame and object, frame by frame.

    A context manager. Every call of `write` reaches the disk, so that nothing tracked is lost.
    """

    def __init__(self, path: str | Path, names: Sequence[str] | None = None) -> None:
        """Open the file and write the header.

        names: of the objects, for a column id; by default there is one object, and no such column.

        Raises ValueError where another run is writing the file, OSError where it cannot be written.
        """
        self._path, self._names = Path(path), names
        self._file = self._path.open("ab", buffering=0)  # not emptied before it is ours
        lock(self._file)
        if self._path.is_file():  # no pipe
            self._file.truncate(0)
        self._append([RESULT_COLUMNS if names is None else ("id", *RESULT_COLUMNS)])

    def write(
        self, boxes: ArrayLike, confidence: ArrayLike, lost: ArrayLike, frames: Sequence[int]
    ) -> None:
        """Append the rows of the next n frames.

        boxes: [S, n, 4]. confidence, lost: [S, n]. frames: [n], their indices.
        """
        of_all = zip(np.asarray(boxes), np.asarray(confidence), np.asarray(lost), strict=True)
        rows = [
            (int(place), number, row)
            for number, one in enumerate(of_all)
            for place, *row in result_rows(*one, 0)
        ]
        names = [()] if self._names is None else [(name,) for name in self._names]
        self._append(
            (*names[number], frames[place], *row)
            for place, number, row in sorted(rows, key=itemgetter(0, 1))
        )

    def _append(self, rows: Iterable[Iterable[Any]]) -> None:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(rows)
        # Names need not be in UTF-8, as those of files.
        rest = memoryview(text.getvalue().encode(errors="surrogateescape"))
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
        except OSError as error:
            self._file.close()
            raise OSError(error.errno, error.strerror, str(self._path)) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._file.close()
