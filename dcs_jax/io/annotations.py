"""Boxes in and out: OTB annotations and the table of results.

An annotation is a text file `groundtruth_rect.txt` with one box a frame: x, y, w, h in pixels,
separated by commas, tabs or blanks, NaN where the frame is unlabelled.
"""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

ANNOTATION_NAME = "groundtruth_rect.txt"
COLUMNS = ("frame", "x", "y", "w", "h", "confidence")  # of a table of results


def read_boxes(path: str | Path, zeros_unlabelled: bool = False) -> NDArray[np.float64]:
    """Read an annotation: boxes [T, 4], x, y, w, h in pixels; all four NaN for no label.

    zeros_unlabelled: whether a line of zeros, too, stands for no label.

    Raises:
        ValueError: no lines, or a line that is neither a box of positive size nor has a NaN; the
            message names the line.
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


def parse_numbers(line: str, place: str, counts: Sequence[int], expected: str) -> list[float]:
    """The numbers of a line, separated by commas, tabs or blanks.

    Raises ValueError, with `place` and what was `expected`, unless there are as many as one of
    `counts`.
    """
    try:
        numbers = [float(field) for field in re.split(r"\s*,\s*|\s+", line.strip())]
    except ValueError:
        numbers = []
    if len(numbers) not in counts:
        raise ValueError(f"{place} is {line.strip()!r}: expected {expected}")
    return numbers


def _parse(line: str, place: str, zeros_unlabelled: bool) -> list[float]:
    box = parse_numbers(line, place, (4,), "four numbers x,y,w,h")
    if np.isnan(box).any() or (zeros_unlabelled and not any(box)):
        return [np.nan] * 4
    if not np.isfinite(box).all() or box[2] <= 0 or box[3] <= 0:
        raise ValueError(
            f"{place} is {line.strip()!r}: expected finite numbers with w and h positive, "
            "or NaN for an unlabelled frame"
        )
    return box


def find_annotation(source: str | Path) -> Path | None:
    """The `groundtruth_rect.txt` of a folder of images, None if there is none.

    It lies beside the images or, where their folder is called `img`, beside that folder.
    """
    folder = Path(source)
    if not folder.is_dir():
        return None
    places = [folder, folder.resolve().parent] if folder.resolve().name == "img" else [folder]
    candidates = (place / ANNOTATION_NAME for place in [*places, folder / "img"])
    return next((path for path in candidates if path.is_file()), None)


def box_rows(boxes: ArrayLike, confidence: ArrayLike, start: int) -> Iterator[tuple[str, ...]]:
    """The rows of a table of results, with `COLUMNS`: boxes [n, 4] and confidence [n] from `start`.

    Numbers are as short as gives the same float32 when read again.
    """
    columns = np.column_stack([boxes, confidence]).astype(np.float32)
    for frame, row in enumerate(columns, start):
        yield (str(frame), *map(str, row))


class BoxWriter:
    """Writes results as a table with the columns frame, x, y, w, h, confidence: one row a frame.

    A context manager. Every call of `write` reaches the disk, so that nothing tracked is lost.
    """

    def __init__(self, path: str | Path, start: int = 0) -> None:
        """Open the file; `start` is the index of the first frame that will be written."""
        self._file = Path(path).open("w", encoding="utf-8", newline="")  # noqa: SIM115
        self._frame = start
        self._file.write(",".join(COLUMNS) + "\n")
        self._file.flush()

    def write(self, boxes: ArrayLike, confidence: ArrayLike) -> None:
        """Append the boxes [n, 4] and confidences [n] of the next n frames."""
        for row in box_rows(boxes, confidence, self._frame):
            self._file.write(",".join(row) + "\n")
            self._frame += 1
        self._file.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()
