"""CVAT for video 1.1, an XML file: a track per object, in it a box per frame.

    <track id="1" label="car">
      <box frame="0" outside="0" occluded="0" keyframe="1" xtl="2.5" ytl=".." xbr=".." ybr=".." />

An object is outside where it is lost or has no box, and in one more frame after its last one, where
CVAT would show its last box to the end of the clip. The label is the object's label or, without
one, its name. On reading, the label is the name, with the id behind it where several tracks share a
label.

CVAT reads only the boxes that are keyframes, and puts those between on straight lines. So a box
that is not on the line between the marked keyframes is written as a keyframe, too, and all boxes
are where none is marked. Reading does the same as CVAT: a last box without an end lasts as long as
the clip.

Confidences are not held. Shapes that are not boxes are left out on reading.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import NDArray

from dcs_jax.formats.assembly import DIGITS, check_total, decimals
from dcs_jax.formats.cvat_parser import Shapes, parse
from dcs_jax.formats.tracks import ObjectTrack, Tracks, ids_of, names_of
from dcs_jax.io.files import atomic

ON_LINE = 0.01  # pixels: CVAT's own files have two digits


def write(path: Path, tracks: Tracks) -> None:
    """Write the tracks; an object that is visible in no frame is left out."""
    with atomic(path, text=True) as file:
        file.write('<?xml version="1.0" encoding="utf-8"?>\n<annotations>\n')
        file.write("  <version>1.1</version>\n")
        file.writelines(_meta(tracks))
        for number, track in zip(ids_of(tracks), tracks.objects, strict=True):
            if track.visible.any():
                file.write(f'  <track id="{number}" label={quoteattr(track.category)}>\n')
                file.writelines(_boxes(track, tracks.length))
                file.write("  </track>\n")
        file.write("</annotations>\n")


def read(path: Path) -> Tracks:
    """Read a file; ValueError names the line.

    A document type is refused, as the entities it may define can grow without bound.
    """
    clip, found = parse(path)
    found = [shapes for shapes in found if shapes.frames]
    names = names_of([shapes.label for shapes in found], [shapes.id for shapes in found])
    lines = [_sorted(path, shapes) for shapes in found]
    ends = [_end(line, clip.length) for line in lines]
    check_total(
        [end - int(line.frames[0]) for line, end in zip(lines, ends, strict=True)], str(path)
    )
    objects = (
        _fill(name, shapes.label, line, end)
        for name, shapes, line, end in zip(names, found, lines, ends, strict=True)
    )
    kept = tuple(track for track in objects if len(track.boxes))
    last = max((track.end for track in kept), default=0)
    length = clip.length if clip.length and clip.length >= last else None
    return Tracks(kept, clip.size, length, clip.source)


class _Line(NamedTuple):
    """The boxes of a track by frame: frames [m], boxes [m, 4], outside [m], keyframes [m]."""

    frames: NDArray[np.int64]
    boxes: NDArray[np.float64]
    outside: NDArray[np.bool_]
    keyframes: NDArray[np.bool_]


def _meta(tracks: Tracks) -> Iterator[str]:
    yield "  <meta>\n    <task>\n"
    if tracks.source:
        yield f"      <name>{escape(tracks.source)}</name>\n"
    yield f"      <size>{tracks.end}</size>\n      <mode>interpolation</mode>\n"
    yield "      <overlap>0</overlap>\n      <flipped>False</flipped>\n      <labels>\n"
    for label in dict.fromkeys(track.category for track in tracks.objects):
        yield f"        <label><name>{escape(label)}</name><attributes></attributes></label>\n"
    yield "      </labels>\n"
    if tracks.size:
        width, height = tracks.size
        yield f"      <original_size><width>{width}</width><height>{height}</height>"
        yield "</original_size>\n"
    yield "    </task>\n"
    if tracks.source:
        yield f"    <source>{escape(tracks.source)}</source>\n"
    yield "  </meta>\n"


def _boxes(track: ObjectTrack, length: int | None) -> Iterator[str]:
    shown = np.flatnonzero(track.visible)
    frames = np.arange(shown[0], shown[-1] + 1)
    outside = ~track.visible[frames]
    # An object that is outside stays where it was.
    last_shown = np.maximum.accumulate(np.where(outside, 0, frames))
    corners = decimals(track.boxes[last_shown])
    corners[:, 2:] += corners[:, :2]
    keyframes = _keyframes(track.keyframes, frames, corners, outside)
    if length is None or track.start + shown[-1] + 1 < length:
        frames = np.append(frames, shown[-1] + 1)
        outside, keyframes = np.append(outside, True), np.append(keyframes, True)
        corners = np.concatenate([corners, corners[-1:]])
    for frame, gone, key, (left, top, right, bottom) in zip(
        (track.start + frames).tolist(),
        outside.tolist(),
        keyframes.tolist(),
        np.round(corners, DIGITS).tolist(),
        strict=True,
    ):
        yield (
            f'    <box frame="{frame}" outside="{gone:d}" occluded="0" keyframe="{key:d}" '
            f'xtl="{left}" ytl="{top}" xbr="{right}" ybr="{bottom}" z_order="0"></box>\n'
        )


def _keyframes(
    marked: NDArray[np.bool_] | None,
    frames: NDArray[np.int64],
    corners: NDArray[np.float64],
    outside: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Which boxes CVAT has to be told: [m] bool."""
    if marked is None:
        return np.ones(len(frames), np.bool_)
    keys = marked[frames].copy()
    keys[[0, -1]] = True
    keys[1:] |= outside[1:] != outside[:-1]
    keys[:-1] |= outside[1:] != outside[:-1]
    known = np.flatnonzero(keys)
    at = np.arange(len(frames))
    straight = np.column_stack([np.interp(at, known, column[known]) for column in corners.T])
    off = (np.abs(straight - corners) > ON_LINE).any(axis=1) & ~outside
    # One box off the line bends it for all between two keyframes.
    gaps = np.searchsorted(known, at, "right")
    return keys | np.isin(gaps, gaps[off])


def _sorted(path: Path, shapes: Shapes) -> _Line:
    frames = np.array(shapes.frames)
    order = np.argsort(frames, kind="stable")
    same = np.flatnonzero(np.diff(frames[order]) == 0)
    if same.size:
        raise ValueError(
            f"{path}, line {shapes.lines[order[same[0] + 1]]} is a second box of track {shapes.id} "
            f"({shapes.label!r}) in the same frame"
        )
    corners = np.array(shapes.corners)[order]
    boxes = np.concatenate([corners[:, :2], corners[:, 2:] - corners[:, :2]], axis=1)
    return _Line(
        frames[order], boxes, np.array(shapes.outside)[order], np.array(shapes.keyframes)[order]
    )


def _end(line: _Line, length: int | None) -> int:
    """The frame after the last one: that of the clip if the last box has no end."""
    end = int(line.frames[-1]) + 1
    return end if line.outside[-1] else max(end, length or 0)


def _fill(name: str, label: str, line: _Line, end: int) -> ObjectTrack:
    """The track in every frame: boxes between two are on the line between them."""
    frames = np.arange(line.frames[0], end)
    before = np.searchsorted(line.frames, frames, "right") - 1
    lost = line.outside[before]
    shown = np.flatnonzero(~lost)
    if shown.size:
        kept = slice(int(shown[0]), int(shown[-1]) + 1)
        frames, before, lost = frames[kept], before[kept], lost[kept]
    else:
        frames, before, lost = frames[:0], before[:0], lost[:0]
    boxes = np.column_stack([np.interp(frames, line.frames, side) for side in line.boxes.T])
    boxes[lost] = np.nan
    keyframes = line.keyframes[before] & (line.frames[before] == frames)
    return ObjectTrack(
        name,
        int(frames[0]) if len(frames) else 0,
        boxes.astype(np.float32),
        np.full(len(frames), np.nan, np.float32),
        lost,
        keyframes,
        None if label == name else label,
    )
