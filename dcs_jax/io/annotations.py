"""Boxes in and out: OTB annotations and the table of results.

An annotation is a text file `groundtruth_rect.txt` with one box per frame: x, y, w, h in pixels,
separated by commas, tabs or blanks, NaN where the frame is unlabelled.
"""

import csv
import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

ANNOTATION_NAME = "groundtruth_rect.txt"
COLUMNS = ("frame", "x", "y", "w", "h", "confidence")  # of a table of results


def read_boxes(path: str | Path, zeros_unlabelled: bool = False) -> NDArray[np.float64]:
    """Read an annotation: boxes [T, 4], x, y, w, h in pixels; all four NaN where unlabelled.

    zeros_unlabelled: whether a line of zeros, too, means that the frame is unlabelled.

    Raises ValueError if there are no lines, or one is neither a box of positive size nor has a NaN;
    the message names the line.
    """
    lines = read_lines(path)
    if not lines:
        raise ValueError(f"{path} is empty: expected one box x,y,w,h a line")
    return np.array(
        [_parse(line, f"{path}, line {n}", zeros_unlabelled) for n, line in enumerate(lines, 1)]
    )


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


def _parse(line: str, where: str, zeros_unlabelled: bool) -> list[float]:
    box = parse_numbers(line, where, (4,), "four numbers x,y,w,h")
    if any(map(math.isnan, box)) or (zeros_unlabelled and not any(box)):
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


class BoxWriter:
    """Writes results as a table with the columns frame, x, y, w, h, confidence: one row per frame.

    A context manager. Every call of `write` reaches the disk, so that nothing tracked is lost.
    """

    def __init__(self, path: str | Path, start: int = 0) -> None:
        """Open the file and write the header; `start` is the index of the first frame."""
        self._file = Path(path).open("w", encoding="utf-8", newline="")  # noqa: SIM115
        self._table = csv.writer(self._file, lineterminator="\n")
        self._frame = start
        self._table.writerow(COLUMNS)
        self._file.flush()

    def write(self, boxes: ArrayLike, confidence: ArrayLike) -> None:
        """Append the boxes [n, 4] and confidences [n] of the next n frames."""
        for row in box_rows(boxes, confidence, self._frame):
            self._table.writerow(row)
            self._frame += 1
        self._file.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._file.close()
