"""The list of what to track: a CSV file with one row per video and target.

Columns, in any order: `source`; `box` (x,y,w,h in pixels, in one cell) or `x`, `y`, `w`, `h`; and
optionally `start`, `end` and `id`.
"""

import csv
import math
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from dcs_jax.checks import SMALLEST_SIDE
from dcs_jax.io.annotations import parse_numbers

SIDES = ("x", "y", "w", "h")
_BYTES = re.compile("[\udc80-\udcff]")  # that are not UTF-8
OPTIONAL = ("start", "end", "id")


class Target(NamedTuple):
    """One object in one video.

    id: name in the results, different for every target.
    source: video file or folder of images.
    box: x, y, w, h in pixels, in the frame `start`.
    start: index of the first frame, counted from 0.
    end: index of the frame to stop before, None for all frames.
    """

    id: str
    source: str
    box: tuple[float, float, float, float]
    start: int = 0
    end: int | None = None


class Video(NamedTuple):
    """All targets of one source, which is decoded once, and finished or failed as a whole."""

    source: str
    targets: tuple[Target, ...]


def read_manifest(path: str | Path) -> list[Target]:
    """The targets of a manifest, in its order.

    A `source` that is not an absolute path is relative to the folder of the manifest. An `id` that
    is left out is the number of the row, counted from 1.

    Raises:
        OSError: the file cannot be read.
        ValueError: a column is missing, unknown or duplicate, there are no rows, a cell is not what
            its column holds, or an id is a duplicate. The message names line and column.
    """
    path = Path(path)
    targets: list[Target] = []
    lines: dict[str, int] = {}  # of every id
    # Names of files need not be UTF-8; everything else is, and is checked below.
    with open(path, newline="", encoding="utf-8-sig", errors="surrogateescape") as file:
        table = csv.reader(file, skipinitialspace=True)
        try:
            header = [name.strip() for name in next(table, [])]
            _check_header(path, header)
            for cells in table:
                if not any(cells):
                    continue
                line = table.line_num
                if len(cells) != len(header):
                    raise ValueError(
                        f"{path}, line {line} has {len(cells)} cells, but there are "
                        f"{len(header)} columns; a box in one cell needs quotes"
                    )
                row = _Row(path, line, dict(zip(header, map(str.strip, cells), strict=True)))
                row.check_encoding()
                target = row.target(len(targets) + 1)
                if target.id in lines:
                    raise row.wrong("id", f"a name of its own, but line {lines[target.id]} has it")
                lines[target.id] = line
                targets.append(target)
        except csv.Error as error:
            raise ValueError(
                f"{path}, line {table.line_num} is not CSV in UTF-8: {error}"
            ) from None
    if not targets:
        raise ValueError(f"{path} has no rows: expected one row per video and target")
    return targets


def group_by_video(targets: Iterable[Target]) -> list[Video]:
    """The targets of each source together; sources and targets keep their order."""
    videos: dict[str, list[Target]] = {}
    for target in targets:
        videos.setdefault(target.source, []).append(target)
    return [Video(source, tuple(members)) for source, members in videos.items()]


def _check_header(path: Path, header: list[str]) -> None:
    box = SIDES if "box" not in header else ("box",)
    expected = f"expected source, box or x, y, w, h, and optionally {', '.join(OPTIONAL)}"
    for name in header:
        if name not in ("source", *box, *OPTIONAL):
            raise ValueError(f"{path}, line 1: there is no column {name!r}; {expected}")
        if header.count(name) > 1:
            raise ValueError(f"{path}, line 1 has the column {name} twice; {expected}")
    for name in ("source", *box):
        if name not in header:
            raise ValueError(f"{path}, line 1: the column {name} is missing; {expected}")


class _Row:
    """The cells of a line by column, with file and line for error messages."""

    def __init__(self, path: Path, line: int, cells: dict[str, str]) -> None:
        self._path, self._line, self._cells = path, line, cells

    def wrong(self, column: str, expected: str) -> ValueError:
        return ValueError(
            f"{self._path}, line {self._line}, column {column} is {self._cells[column]!r}: "
            f"expected {expected}"
        )

    def check_encoding(self) -> None:
        """ValueError where a cell is not UTF-8, unless it is the name of a file that is there."""
        for column, cell in self._cells.items():
            if _BYTES.search(cell) and not (column == "source" and os.path.exists(self._source())):
                raise ValueError(
                    f"{self._path}, line {self._line} is not CSV in UTF-8: the column {column} is "
                    f"{cell!r}"
                )

    def _source(self) -> str:
        # Not resolved: a link keeps its name, and a million rows need no access to the disk.
        return os.path.normpath(self._path.parent.absolute() / self._cells["source"])

    def target(self, number: int) -> Target:
        """The target of row `number`."""
        if not self._cells["source"]:
            raise self.wrong("source", "a video file or a folder of images")
        source = self._source()
        start = self._count("start", 0) or 0
        end = self._count("end", start + 1)
        return Target(self._cells.get("id") or str(number), source, self._box(), start, end)

    def _box(self) -> tuple[float, float, float, float]:
        if "box" in self._cells:
            try:
                x, y, w, h = parse_numbers(self._cells["box"], "", (4,), "")
            except ValueError:
                raise self.wrong("box", "four numbers x,y,w,h") from None
            columns = ("box",) * 4
        else:
            x, y, w, h = map(self._number, SIDES)
            columns = SIDES
        for column, value in zip(columns, (x, y, w, h), strict=True):
            if not math.isfinite(value):
                raise self.wrong(column, "finite pixels")
        for column, side in zip(columns[2:], (w, h), strict=True):
            if side < SMALLEST_SIDE:
                raise self.wrong(column, f"w and h of at least {SMALLEST_SIDE} pixels")
        return x, y, w, h

    def _number(self, column: str) -> float:
        try:
            return float(self._cells[column])
        except ValueError:
            raise self.wrong(column, "a number of pixels") from None

    def _count(self, column: str, least: int) -> int | None:
        """A number of frames, None where the cell is empty; 300.0, as pandas writes it, is 300."""
        text = self._cells.get(column, "")
        if not text:
            return None
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not value.is_integer() or value < least:
            raise self.wrong(column, f"a frame, {least} or later, or nothing")
        return int(value)
