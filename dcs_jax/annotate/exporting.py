"""A project as the tracks that every format holds, and the other way round."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcs_jax.annotate.project import Keyframe, ObjectLane, Project, colour_of
from dcs_jax.formats.tracks import ObjectTrack, Tracks


def to_tracks(project: Project) -> Tracks:
    """The tracks of a project, for `dcs_jax.formats.write`.

    An object's track has the frames from the first to the last of which anything is known; where
    it is absent, it is lost and has no box.
    """
    objects = []
    for lane in project.objects:
        known = ~np.isnan(lane.boxes[:, 0]) | lane.lost
        first, last = np.flatnonzero(known)[[0, -1]]
        rows = slice(first, last + 1)
        keyframes = np.isin(np.arange(first, last + 1), sorted(lane.keyframes))
        objects.append(
            ObjectTrack(
                name=lane.name,
                start=int(first),
                boxes=lane.boxes[rows],
                confidence=lane.confidence[rows],
                lost=lane.lost[rows],
                keyframes=keyframes,
            )
        )
    name = Path(project.clip).name
    return Tracks(tuple(objects), project.size, project.length, name, project.fps)


def from_tracks(tracks: Tracks, project: Project) -> Project:
    """The project with the objects of these tracks in place of its own, to go on from.

    Keyframes are those that the tracks have marked, and the ends of every row of frames with
    boxes: what is between them is shown as it was read, and tracked anew only where a keyframe is
    set in it. Where an object is lost without a box, and before its first and behind its last
    frame, it is "not here". An object without any box is left out.

    Raises ValueError where the tracks are those of another clip: of another size, or longer.
    """
    if tracks.size is not None and tuple(tracks.size) != project.size:
        raise ValueError(
            f"the boxes are of a clip of {tracks.size[0]} x {tracks.size[1]} pixels, but this one "
            f"has {project.size[0]} x {project.size[1]}"
        )
    if tracks.end > project.length:
        raise ValueError(
            f"the boxes are of a clip of at least {tracks.end} frames, but this one has "
            f"{project.length}"
        )
    found = [track for track in tracks.objects if track.visible.any()]
    lanes = (_lane(id, track, project.length) for id, track in enumerate(found, 1))
    return replace(project, objects=tuple(lanes))


def _lane(id: int, track: ObjectTrack, length: int) -> ObjectLane:
    rows = slice(track.start, track.end)
    boxes = np.full((length, 4), np.nan, np.float32)
    boxes[rows] = track.boxes
    confidence = np.full(length, np.nan, np.float32)
    confidence[rows] = track.confidence
    lost = np.ones(length, np.bool_)
    lost[rows] = track.lost
    marked = np.zeros(length, np.bool_)
    if track.keyframes is not None:
        marked[rows] = track.keyframes
    keyframes = _keyframes(boxes, lost, marked)
    for frame, keyframe in keyframes.items():
        confidence[frame] = np.nan if keyframe.box is None else 1
    disagreement = np.full(length, np.nan, np.float32)
    disagreement[[at for at, keyframe in keyframes.items() if keyframe.box is not None]] = 0
    return ObjectLane(
        id, track.name, colour_of(id), keyframes, boxes, confidence, disagreement, lost
    )


def _keyframes(
    boxes: NDArray[np.float32], lost: NDArray[np.bool_], marked: NDArray[np.bool_]
) -> Mapping[int, Keyframe]:
    """Keyframes [T] that leave every box where it is."""
    known = ~np.isnan(boxes[:, 0])
    absent = lost & ~known
    keyframes: dict[int, Keyframe] = {}
    for start, end in _runs(absent):
        keyframes[start] = Keyframe(None)
        marked = marked & ~np.isin(np.arange(len(marked)), np.arange(start, end))
    sure = known & ~lost
    for start, end in _runs(known):
        seen = np.flatnonzero(sure[start:end]) + start
        if len(seen):
            marked[[seen[0], seen[-1]]] |= not marked[start:end].any()
    for frame in np.flatnonzero(marked & known).tolist():
        x, y, w, h = boxes[frame].tolist()
        keyframes[frame] = Keyframe((x, y, w, h))
    return keyframes


def _runs(where: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """The first frame of each row of true values, and the one after its last."""
    edges = np.flatnonzero(np.diff(np.r_[False, where, False].astype(np.int8)))
    return [(int(start), int(end)) for start, end in zip(edges[::2], edges[1::2], strict=True)]
