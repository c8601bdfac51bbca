"""CSV, the package's own table: one row per frame of an object.

    frame,x,y,w,h,confidence                    one object, whose name is that of the file
    id,frame,x,y,w,h,confidence                 several objects; id is the name

A frame without a box has empty cells, as has one without a confidence. Where they say something,
the columns `lost` and `keyframe` (0 or 1) and `label` follow. Columns are read in any order.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcs_jax.formats.assembly import assemble
from dcs_jax.formats.rows import SIDES, Rows, read_rows
from dcs_jax.formats.tracks import ObjectTrack, Tracks
from dcs_jax.io.annotations import COLUMNS, box_rows
from dcs_jax.io.files import write_table

_FLAGS = ("lost", "keyframe")
_KNOWN = ("id", *COLUMNS, *_FLAGS, "label")
_NEEDED = ("frame", *SIDES)


def write(path: Path, tracks: Tracks) -> None:
    """Write the tracks as a table, with a column `id` unless there is one object only."""
    objects = tracks.objects
    optional = {
        "lost": any(track.lost.any() for track in objects),
        "keyframe": any(track.keyframes is not None for track in objects),
        "label": any(track.label is not None for track in objects),
    }
    present = [name for name, wanted in optional.items() if wanted]
    single = len(objects) == 1
    header = (*(() if single else ("id",)), *COLUMNS, *present)
    rows = (
        (*(() if single else (track.name,)), *row)
        for track in objects
        for row in _rows_of(track, present)
    )
    write_table(path, header, rows)


def read(path: Path) -> Tracks:
    """Read a table; ValueError names the line and the column."""
    pieces = []
    lines: list[int] = []
    owners: list[int] = []
    numbers: dict[str, int] = {}  # of every name
    labels: dict[int, str] = {}
    for rows in read_rows(path):
        for name in _NEEDED:
            if name not in rows:
                raise ValueError(
                    f"{path}, line 1: the column {name} is missing; expected {', '.join(COLUMNS)}"
                    f" and optionally id, {', '.join(_FLAGS)}, label"
                )
        names = rows.texts("id") if "id" in rows else (path.stem,) * len(rows)
        rows.check(np.array([bool(name) for name in names]), "id", "a name")
        found = [numbers.setdefault(name, len(numbers)) for name in names]
        if "label" in rows:
            labels.update(zip(found, rows.texts("label"), strict=True))
        frames = rows.counts("frame", 0, "a frame counted from 0")
        flags = [_flag(rows, name) if name in rows else None for name in _FLAGS]
        pieces.append((frames, rows.boxes(gaps=True), rows.confidence(), flags))
        lines += rows.lines
        owners += found
    frames, boxes, confidence = (
        np.concatenate(parts) for parts in zip(*(piece[:3] for piece in pieces), strict=True)
    )
    lost, keyframes = (
        None if parts[0] is None else np.concatenate(parts)
        for parts in zip(*(piece[3] for piece in pieces), strict=True)
    )
    objects = assemble(
        list(numbers),
        np.array(owners),
        frames,
        boxes,
        confidence,
        lambda row: f"{path}, line {lines[row]}",
        lost,
        keyframes,
    )
    return Tracks(
        tuple(
            track._replace(label=labels.get(number) or None) for number, track in enumerate(objects)
        )
    )


def _rows_of(track: ObjectTrack, present: list[str]) -> Iterator[tuple[str, ...]]:
    flags = {"lost": track.lost, "keyframe": track.keyframes}
    for number, row in enumerate(box_rows(track.boxes, track.confidence, track.start)):
        cells = ["" if cell == "nan" else cell for cell in row]
        for name in present:
            if name == "label":
                cells.append(track.label or "")
            else:
                values = flags[name]
                cells.append(str(int(values is not None and values[number])))
        yield tuple(cells)


def _flag(rows: Rows, column: str) -> NDArray[np.bool_]:
    values = rows.numbers(column, "0 or 1")
    rows.check(np.isin(values, (0, 1)), column, "0 or 1")
    return values == 1
