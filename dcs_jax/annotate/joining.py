"""Two tracks of one object, from the keyframes at both ends of a stretch, made one."""

import numpy as np
from numpy.typing import NDArray

from dcs_jax.annotate.stretches import StretchTrack


def join(forward: StretchTrack, backward: StretchTrack) -> StretchTrack:
    """The track that passes through the first box of one and the last box of the other.

    forward, backward: of the same n frames, in the same order: the first row of `forward` and the
        last one of `backward` are the keyframes.
    """
    n = len(forward.lost)
    agreement = overlaps(forward.boxes, backward.boxes)
    late = np.linspace(0, 1, n, dtype=np.float32)
    boxes = (1 - late[:, None]) * forward.boxes + late[:, None] * backward.boxes
    confidence = np.where(late < 0.5, forward.confidence, backward.confidence)
    return StretchTrack(boxes, confidence, forward.lost & backward.lost, 1 - agreement)


def overlaps(one: NDArray[np.float32], other: NDArray[np.float32]) -> NDArray[np.float32]:
    """Intersection over union of boxes [n, 4] and [n, 4]: [n] in [0, 1]."""
    top_left = np.maximum(one[:, :2], other[:, :2])
    bottom_right = np.minimum(one[:, :2] + one[:, 2:], other[:, :2] + other[:, 2:])
    intersection = np.prod(np.maximum(bottom_right - top_left, 0), axis=1)
    return intersection / (one[:, 2:].prod(1) + other[:, 2:].prod(1) - intersection)
