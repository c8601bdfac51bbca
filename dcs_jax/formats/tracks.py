"""Tracks in memory, as every format reads and writes them: NumPy arrays, and facts of the clip.

A box is x, y, w, h in pixels; (0, 0) is the top-left corner of the top-left pixel. Frames are
counted from 0.
"""

import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

LAST_FRAME = 10**9

# XML cannot hold control characters, and UTF-8 no surrogates.
_UNWRITABLE = re.compile("[\x00-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]")


class ObjectTrack(NamedTuple):
    """One object in n frames of a clip, from its first frame on.

    name: text without control characters, different for every object.
    start: index of its first frame.
    boxes: [n, 4] float32, x, y, w, h in pixels; a row of NaN where no box is known.
    confidence: [n] float32; NaN where none is known.
    lost: [n] bool, whether the object is not there, or is lost; its box may be the last one known.
    keyframes: [n] bool, whether the box was drawn or corrected by hand; None where that is unknown.
    label: class of the object (car), which others may have, too; None where that is the name.
    """

    name: str
    start: int
    boxes: NDArray[np.float32]
    confidence: NDArray[np.float32]
    lost: NDArray[np.bool_]
    keyframes: NDArray[np.bool_] | None = None
    label: str | None = None

    @property
    def visible(self) -> NDArray[np.bool_]:
        """[n] bool, whether the object is in the frame, with a box that is known."""
        return ~(self.lost | np.isnan(self.boxes[:, 0]))

    @property
    def end(self) -> int:
        """Index of the frame after its last one."""
        return self.start + len(self.boxes)

    @property
    def category(self) -> str:
        """The label, or the name where there is none."""
        return self.label or self.name


class Tracks(NamedTuple):
    """The objects of one clip, and what is known of the clip.

    size: width and height of a frame in pixels. length: number of frames. source: name or path of
    the clip. fps: frames per second. Each is None where it is unknown.
    """

    objects: tuple[ObjectTrack, ...]
    size: tuple[int, int] | None = None
    length: int | None = None
    source: str | None = None
    fps: float | None = None

    @property
    def end(self) -> int:
        """Number of frames of the clip or, if that is unknown, up to the last one of any track."""
        return self.length or max((track.end for track in self.objects), default=0)


def check(tracks: Tracks) -> Tracks:
    """The same tracks with arrays of the types above; ValueError says what is wrong with them."""
    names = [track.name for track in tracks.objects]
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise ValueError(f"names of objects must differ, but {twice[0]!r} is there twice")
    if tracks.size is not None:
        check_size(tracks.size)
    if tracks.fps is not None and not (math.isfinite(tracks.fps) and tracks.fps > 0):
        raise ValueError(f"fps must be finite and positive, but is {tracks.fps!r}")
    if tracks.source is not None and _UNWRITABLE.search(tracks.source):
        raise ValueError(f"source must have no control characters, but is {tracks.source!r}")
    objects = tuple(map(_check_object, tracks.objects))
    last = max((track.end for track in objects), default=0)
    if tracks.length is not None and tracks.length < last:
        raise ValueError(
            f"length must be at least {last}, the frames that the tracks need, "
            f"but is {tracks.length!r}"
        )
    return tracks._replace(objects=objects)


def check_size(size: Any) -> None:
    """ValueError unless size is a width and a height in whole pixels."""
    try:
        good = len(size) == 2 and all(int(side) == side and side > 0 for side in size)
    except (TypeError, ValueError, OverflowError):
        good = False
    if not good:
        raise ValueError(f"size must be a width and a height in pixels, but is {size!r}")


def _check_object(track: ObjectTrack) -> ObjectTrack:
    for text in (track.name, track.category):
        if not isinstance(text, str) or not text or _UNWRITABLE.search(text):
            raise ValueError(f"a name must be text without control characters, but is {text!r}")
    what = f"the track of {track.name!r}"
    if int(track.start) != track.start or not 0 <= track.start <= LAST_FRAME:
        raise ValueError(f"{what} must start at a frame counted from 0, but start is {track.start}")
    with np.errstate(over="ignore"):
        boxes = np.asarray(track.boxes).astype(np.float32)
        confidence = np.asarray(track.confidence).astype(np.float32)
    if boxes.ndim != 2 or boxes.shape[1] != 4:
        raise ValueError(f"{what} must have boxes [n, 4], but they have the shape {boxes.shape}")
    lost = np.asarray(track.lost, np.bool_)
    keyframes = None if track.keyframes is None else np.asarray(track.keyframes, np.bool_)
    for name, values in (("confidence", confidence), ("lost", lost), ("keyframes", keyframes)):
        if values is not None and values.shape != boxes.shape[:1]:
            raise ValueError(
                f"{what} has {len(boxes)} boxes, but {name} has the shape {values.shape}"
            )
    wrong = np.flatnonzero(~(is_box(boxes) | np.isnan(boxes).all(axis=1)))
    if wrong.size:
        raise ValueError(
            f"{what} must have finite boxes with w and h positive, or four NaN, "
            f"but that of frame {track.start + wrong[0]} is {boxes[wrong[0]].tolist()}"
        )
    if np.isinf(confidence).any():
        raise ValueError(f"{what} must have finite confidences, or NaN, but one is infinite")
    return track._replace(
        start=int(track.start), boxes=boxes, confidence=confidence, lost=lost, keyframes=keyframes
    )


def is_box(boxes: NDArray[Any]) -> NDArray[np.bool_]:
    """[m] bool, whether each of the boxes [m, 4] is finite in float32, with w and h positive."""
    with np.errstate(over="ignore"):
        single = boxes.astype(np.float32)
    return np.asarray(np.isfinite(single).all(axis=1) & (single[:, 2:] > 0).all(axis=1))


def ids_of(tracks: Tracks) -> list[int]:
    """A number for each object: the names, if all are numbers from 1 on; else 1, 2, 3, ..."""
    names = [track.name for track in tracks.objects]
    if all(re.fullmatch("[1-9][0-9]{0,8}", name) for name in names):
        return list(map(int, names))
    return list(range(1, len(names) + 1))


def names_of(labels: Sequence[str], ids: Iterable[int | str]) -> list[str]:
    """A name for each object: its label if no other object has it, else LABEL-ID."""
    counts, names = Counter(labels), []
    taken = {label for label, count in counts.items() if count == 1}
    for label, number in zip(labels, ids, strict=True):
        name = label if counts[label] == 1 else f"{label}-{number}"
        while counts[label] > 1 and name in taken:
            name += "'"
        taken.add(name)
        names.append(name)
    return names
