"""Tracks taken apart into rows, one per box, and put together from them."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dcs_jax.formats.tracks import ObjectTrack, Tracks

MOST_BOXES = 5 * 10**7  # of all objects together, frames without a box counted: 1.3 GB
DIGITS = 9  # after the point, of sums and differences of coordinates


class VisibleRows(NamedTuple):
    """Every box of every object that is visible, by frame, in a frame by object: m rows.

    owners: [m], index of the object. frames: [m]. boxes: [m, 4] float32. confidence: [m] float32.
    """

    owners: NDArray[np.int64]
    frames: NDArray[np.int64]
    boxes: NDArray[np.float32]
    confidence: NDArray[np.float32]


def visible_rows(tracks: Tracks) -> VisibleRows:
    """The rows of all objects."""
    found = [(track, np.flatnonzero(track.visible)) for track in tracks.objects]
    owners = np.repeat(np.arange(len(found)), [len(rows) for _, rows in found])
    frames = np.concatenate([np.empty(0, int), *(track.start + rows for track, rows in found)])
    boxes = np.concatenate([np.empty((0, 4), np.float32), *(t.boxes[rows] for t, rows in found)])
    confidence = np.concatenate(
        [np.empty(0, np.float32), *(track.confidence[rows] for track, rows in found)]
    )
    order = np.argsort(frames, kind="stable")
    return VisibleRows(owners[order], frames[order], boxes[order], confidence[order])


def assemble(
    names: Sequence[str],
    owners: NDArray[np.int64],
    frames: NDArray[np.int64],
    boxes: NDArray[np.float64],
    confidence: NDArray[np.float64] | None,
    where: Callable[[int], str],
    lost: NDArray[np.bool_] | None = None,
    keyframes: NDArray[np.bool_] | None = None,
) -> tuple[ObjectTrack, ...]:
    """The tracks of objects from m rows in any order; a frame without a row has no box.

    names: of the objects; each has at least one row.
    owners: [m], index of the object of each row. frames: [m]. boxes: [m, 4]. confidence: [m].
    where: file and line of a row, for the error message.

    Raises ValueError if a frame has two boxes of an object, or the tracks are too long.
    """
    order = np.lexsort((frames, owners))
    sorted_owners, sorted_frames = owners[order], frames[order]
    same = (np.diff(sorted_owners) == 0) & (np.diff(sorted_frames) == 0)
    if same.any():
        row = int(order[1:][same].min())
        raise ValueError(
            f"{where(row)} is a second box of {names[owners[row]]!r} in the same frame"
        )
    bounds = np.searchsorted(sorted_owners, np.arange(len(names) + 1))
    check_total(sorted_frames[bounds[1:] - 1] - sorted_frames[bounds[:-1]] + 1, where(0))
    tracks = []
    for name, first, end in zip(names, bounds[:-1], bounds[1:], strict=True):
        rows = order[first:end]
        start = int(frames[rows[0]])
        at, length = frames[rows] - start, int(frames[rows[-1]]) - start + 1
        tracks.append(
            ObjectTrack(
                name,
                start,
                _spread(boxes, rows, at, length, np.nan, np.float32),
                np.full(length, np.nan, np.float32)
                if confidence is None
                else _spread(confidence, rows, at, length, np.nan, np.float32),
                np.zeros(length, np.bool_)
                if lost is None
                else _spread(lost, rows, at, length, False, np.bool_),
                None
                if keyframes is None
                else _spread(keyframes, rows, at, length, False, np.bool_),
            )
        )
    return tuple(tracks)


def check_total(lengths: Any, where: str) -> None:
    """ValueError if tracks of these lengths would not fit into memory."""
    total = int(np.sum(lengths))
    if total > MOST_BOXES:
        raise ValueError(
            f"{where}: tracks from their first to their last frame are {total} boxes; "
            f"expected {MOST_BOXES} at most"
        )


def _spread(
    values: NDArray[Any],
    rows: NDArray[np.int64],
    at: NDArray[np.int64],
    length: int,
    fill: float | bool,
    dtype: type,
) -> NDArray[Any]:
    spread = np.full((length, *values.shape[1:]), fill, dtype)
    spread[at] = values[rows]
    return spread


def decimals(values: NDArray[np.float32]) -> NDArray[np.float64]:
    """The numbers that the shortest digits of these float32 say: 0.1, not 0.10000000149."""
    return values.astype("U32").astype(np.float64)
