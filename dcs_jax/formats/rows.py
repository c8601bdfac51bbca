"""Tables of text, read in pieces, with errors that name the line and the column."""

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcs_jax.formats.tracks import LAST_FRAME, is_box

PIECE = 2000  # rows: what stays in the cache is read three times faster than 50,000 rows
SIDES = ("x", "y", "w", "h")


class Rows:
    """Some rows of a table: their cells by column, and the line of each row."""

    def __init__(
        self, path: Path, lines: Sequence[int], cells: Mapping[str, Sequence[str]]
    ) -> None:
        self._path, self.lines, self._cells = path, lines, cells

    def __len__(self) -> int:
        return len(self.lines)

    def __contains__(self, column: str) -> bool:
        return column in self._cells

    def texts(self, column: str) -> Sequence[str]:
        """The cells of a column."""
        return self._cells[column]

    def numbers(self, column: str, expected: str) -> NDArray[np.float64]:
        """The numbers of a column, NaN for an empty cell; ValueError at anything else."""
        cells = self._cells[column]
        try:
            return np.fromiter(map(float, cells), np.float64, len(cells))
        except ValueError:  # an empty cell, or one that is wrong
            return np.array([self._number(column, row, expected) for row in range(len(cells))])

    def counts(self, column: str, least: int, expected: str) -> NDArray[np.int64]:
        """Whole numbers from `least` on; 300.0, as pandas writes it, is 300."""
        values = self.numbers(column, expected)
        good = (values >= least) & (values <= LAST_FRAME) & (values == np.floor(values))
        self.check(good, column, expected)
        return values.astype(np.int64)

    def boxes(self, gaps: bool) -> NDArray[np.float64]:
        """The boxes [m, 4]; four empty cells or NaN are a row of NaN where `gaps` allows them."""
        boxes = np.column_stack([self.numbers(side, "a number of pixels") for side in SIDES])
        missing = np.isnan(boxes).all(axis=1) & gaps
        for side, column in zip(SIDES, boxes.T, strict=True):
            self.check(missing | (np.abs(column) < 3e38), side, "finite pixels")
        for side in "wh":
            self.check(missing | (boxes[:, SIDES.index(side)] > 0), side, "a positive side")
        self.check(missing | is_box(boxes), "w", "a side that float32 can hold")
        return boxes

    def confidence(self) -> NDArray[np.float64]:
        """The confidences [m]; an empty cell or NaN is NaN. Without that column, all are NaN."""
        if "confidence" not in self:
            return np.full(len(self), np.nan)
        values = self.numbers("confidence", "a finite number, or nothing")
        self.check(np.isnan(values) | (np.abs(values) < 3e38), "confidence", "a finite number")
        return values

    def check(self, good: NDArray[np.bool_], column: str, expected: str) -> None:
        """ValueError at the first row that is not good."""
        if not good.all():
            raise self._wrong(column, int(np.argmin(good)), expected)

    def _number(self, column: str, row: int, expected: str) -> float:
        cell = self._cells[column][row].strip()
        try:
            return float(cell) if cell else math.nan
        except ValueError:
            raise self._wrong(column, row, expected) from None

    def _wrong(self, column: str, row: int, expected: str) -> ValueError:
        return ValueError(
            f"{self._path}, line {self.lines[row]}, column {column} is "
            f"{self._cells[column][row]!r}: expected {expected}"
        )


def read_rows(path: Path, columns: Sequence[str] = (), least: int = 0) -> Iterator[Rows]:
    """The rows of a CSV file in pieces; empty lines are left out.

    columns: names of the columns of a file without a header, which may have `least` of them; by
        default, the first line has the names.

    Raises ValueError if the file is no CSV in UTF-8, has no rows, or one of a different length.
    """
    with open(path, newline="", encoding="utf-8-sig") as file:
        table = csv.reader(file, skipinitialspace=bool(columns))
        try:
            header = list(columns) or [name.strip() for name in next(table, [])]
            twice = [name for name in header if header.count(name) > 1]
            if twice:
                raise ValueError(f"{path}, line 1 has the column {twice[0]!r} twice")
            lines: list[int] = []
            rows: list[list[str]] = []
            empty = True
            for row in table:
                if not row:
                    continue
                if columns and empty and least <= len(row) < len(header):
                    del header[len(row) :]
                if len(row) != len(header):
                    raise ValueError(
                        f"{path}, line {table.line_num} has {len(row)} cells: "
                        f"expected {', '.join(header)}"
                    )
                empty = False
                lines.append(table.line_num)
                rows.append(row)
                if len(rows) == PIECE:
                    yield Rows(path, lines, dict(zip(header, zip(*rows, strict=True), strict=True)))
                    lines, rows = [], []
            if rows:
                yield Rows(path, lines, dict(zip(header, zip(*rows, strict=True), strict=True)))
        except (csv.Error, UnicodeDecodeError) as error:
            raise ValueError(
                f"{path}, line {table.line_num} is not CSV in UTF-8: {error}"
            ) from None
    if empty:
        raise ValueError(f"{path} has no rows: expected one row per box")
