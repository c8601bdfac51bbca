"""What an annotation is: a clip, its objects, and the frames in which a person said where they are.

Frames are counted from 0. A box is x, y, w, h in pixels; (x, y) is the top-left corner. T is the
number of frames of the clip.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Box = tuple[float, float, float, float]

# Told apart on light and dark, also by people who do not see all colours (Okabe and Ito, 2008,
# without their black and yellow).
COLOURS = ("#0072b2", "#e69f00", "#009e73", "#d55e00", "#56b4e9", "#cc79a7")


@dataclass(frozen=True)
class Keyframe:
    """What a person said of one frame.

    box: where the object is; None where it is not: it is absent from this frame to the next
        keyframe, or to the end.
    """

    box: Box | None


@dataclass(frozen=True, eq=False)
class ObjectLane:
    """One object in all frames of the clip.

    id: number from 1 on, different for every object. name: different for every object.
    colour: "#rrggbb".
    keyframes: by frame.
    boxes: [T, 4] float32; NaN where the object is absent, and in frames not tracked yet.
    confidence: [T] float32 in [0, 1]; 1 in a keyframe, NaN where there is no box.
    disagreement: [T] float32 in [0, 1], 1 minus the overlap of the tracks from the keyframe before
        and the one after; 0 in a keyframe, NaN where there are not both.
    lost: [T] bool, whether the object is absent or the tracker has lost it; then the box is where
        it may be.
    """

    id: int
    name: str
    colour: str
    keyframes: Mapping[int, Keyframe]
    boxes: NDArray[np.float32]
    confidence: NDArray[np.float32]
    disagreement: NDArray[np.float32]
    lost: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Project:
    """The annotation of one clip.

    clip: name or path. fingerprint: what `store.fingerprint` says of its content.
    size: width and height of a frame in pixels. length: T. fps: frames per second.
    settings: of the tracker: its preset and seed.
    """

    clip: str
    fingerprint: Mapping[str, Any]
    size: tuple[int, int]
    length: int
    fps: float
    settings: Mapping[str, Any] = field(default_factory=lambda: {"preset": "default", "seed": 0})
    objects: tuple[ObjectLane, ...] = ()


def colour_of(id: int) -> str:
    """The colour that a new object of this id has."""
    return COLOURS[(id - 1) % len(COLOURS)]
