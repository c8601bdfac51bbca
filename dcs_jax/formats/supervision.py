"""Boxes of a frame as `supervision.Detections`, for the annotators and zones of that package."""

import importlib.util
from typing import TYPE_CHECKING, Any

import numpy as np

from dcs_jax.formats.tracks import Tracks, check, ids_of

if TYPE_CHECKING:
    from supervision import Detections


def to_supervision(tracks: Tracks, frame: int) -> "Detections":
    """The objects that are visible in a frame, with their boxes as left, top, right, bottom.

    tracker_id is the number of an object (its name, if all names are numbers; else 1, 2, ...),
    class_id that of its label, data["class_name"] the label. Confidences are there if all are.

    frame: index of the frame, counted from 0.

    Raises ValueError if the package supervision is missing.
    """
    if importlib.util.find_spec("supervision") is None:
        raise ValueError("to_supervision needs the package supervision: pip install supervision")
    from supervision import Detections

    tracks = check(tracks)
    classes = list(dict.fromkeys(track.category for track in tracks.objects))
    shown = [
        (id, track, frame - track.start)
        for id, track in zip(ids_of(tracks), tracks.objects, strict=True)
        if track.start <= frame < track.end and track.visible[frame - track.start]
    ]
    corners = np.array([t.boxes[row] for _, t, row in shown], np.float32).reshape(-1, 4)
    corners[:, 2:] += corners[:, :2]
    confidence = np.array([t.confidence[row] for _, t, row in shown], np.float32)
    labels = [t.category for _, t, _ in shown]
    data: dict[str, Any] = {"class_name": np.array(labels, dtype=str)}
    return Detections(
        xyxy=corners,
        confidence=None if np.isnan(confidence).any() else confidence,
        class_id=np.array([classes.index(label) for label in labels], int),
        tracker_id=np.array([id for id, _, _ in shown], int),
        data=data,
    )
