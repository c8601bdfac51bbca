"""A video with a table of boxes: NAME.mp4 (or avi, mkv ...) and NAME.csv in one folder.

The table has a header with the columns frame, x, y, w, h in any order (others are ignored). Frames
are counted from 0; those without a row are unlabelled. `dcs-jax track` writes such tables. Without
a header, the table has one line x,y,w,h for each frame.
"""

import csv
import functools
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcs_jax.evaluation.datasets.sequence import Entry, Sequence, open_sequence
from dcs_jax.io.annotations import read_boxes, read_lines
from dcs_jax.io.frames import open_source

SUFFIXES = frozenset((".mp4", ".m4v", ".avi", ".mov", ".mkv", ".webm", ".mpg", ".mpeg", ".ogv"))
COLUMNS = ("frame", "x", "y", "w", "h")


def entries(folder: Path, prefix: str) -> list[Entry]:
    """The videos of a folder; a video without a table fails on loading."""
    return [
        Entry(prefix + path.stem, functools.partial(_load, prefix + path.stem, path))
        for path in sorted(folder.iterdir())
        if path.suffix.lower() in SUFFIXES
    ]


def _load(name: str, video: Path) -> Sequence:
    table = video.with_suffix(".csv")
    if not table.is_file():
        raise ValueError(f"{video} has no table of boxes: expected {table.name} in its folder")
    length = open_source(video).length
    header = [field.strip().lower() for field in read_lines(table)[0].split(",")]
    labelled = "frame" in header
    truth = _read_table(table, header, length) if labelled else read_boxes(table)
    return open_sequence(name, video, truth, table)


def _read_table(path: Path, header: list[str], length: int) -> NDArray[np.float64]:
    missing = [column for column in COLUMNS if column not in header]
    if missing:
        raise ValueError(f"{path} has no column {', '.join(missing)}: expected frame,x,y,w,h")
    truth = np.full((length, 4), np.nan)
    with open(path, newline="", encoding="utf-8-sig") as file:
        rows = csv.reader(file)
        next(rows)
        for n, row in enumerate(rows, 2):
            where = f"{path}, line {n}"
            try:
                frame, *box = (float(row[header.index(column)]) for column in COLUMNS)
            except (ValueError, IndexError):
                raise ValueError(f"{where} is {','.join(row)!r}: expected numbers") from None
            if not (frame.is_integer() and 0 <= frame < length):
                raise ValueError(f"{where} names frame {frame:g}: the video has {length} frames")
            if not (np.isnan(box).any() or (np.isfinite(box).all() and min(box[2:]) > 0)):
                raise ValueError(f"{where} is {','.join(row)!r}: expected w and h positive")
            truth[int(frame)] = np.nan if np.isnan(box).any() else box
    return truth
