"""Two tracks of one object, from the keyframes at both ends of a stretch, made one.

Each track is right at its own keyframe, and less and less sure away from it. Where both have the
object they agree, and are averaged; where they do not, one of them is on something else. In the
order of `join`:

1. In every frame one of the tracks is believed: the sequence of them costs the least, where a track
   of little confidence costs much, and so does changing over where the two are apart. One that is
   sure of itself at the other keyframe, and elsewhere, is believed less in all frames.
2. A track that arrives at the other keyframe is corrected by what it has drifted there, in
   proportion to the frames since its own: the expected drift if it is a random walk.
3. Where they agree both count, by confidence and distance; elsewhere only the one believed.
4. Where there is a change between tracks that are apart, and neither is sure, the object was
   probably hidden: it goes straight from the last sure box to the next.
5. The size is smoothed.

The constants are the best of a few tried on stretches of thirteen sequences, of 7 to 1344 frames,
between all pairs of nine keyframes at random. In frames with an overlap of less than 0.5 (0.7) with
the truth, each sequence with the same weight, 1354 stretches: 7.6 % (24 %) of the forward track,
4.5 % (16 %) of the average by distance alone, 3.2 % (13 %) of this if a track is believed as sure
as it says, 2.4 % (13 %) of this. Of the better of the two in each frame it would be 1.4 %.
Straight lines as a third way, where both are unsure, change nothing.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from dcs_jax.annotate.stretches import StretchTrack

# Overlap of the two tracks from which on both count in full, and up to which only one does.
AGREE, DIFFER = 0.5, 0.1
# Overlap with the other keyframe from which on a track has arrived, and up to which it is lost.
ARRIVED, ASTRAY = 0.8, 0.3
# What is taken off the confidence of a track that is sure at the other keyframe, and not there.
BELIED = 0.6
# Of believing a track, besides -log of its confidence: at the far end.
DISTANCE_COST = 0.1
# Of changing over between tracks that do not overlap.
CHANGE_COST = 10.0
# Confidence below which a track next to a change over is not sure.
UNSURE = 0.75
# How much the size is that on the straight line between the keyframes, and over how many frames
# (the sigma of a Gaussian) what the tracks add to it is smoothed: their estimate of it is noisy.
STRAIGHT_SIZE = 0.3
SMOOTH_SIZE = 20.0
# Of the confidence where the tracks do not overlap at all.
APART = 0.8

_LEAST = 0.02  # a confidence of 0 is none of certainty

Numbers = NDArray[np.float64]


def join(forward: StretchTrack, backward: StretchTrack) -> StretchTrack:
    """The track that passes through the first box of one and the last box of the other.

    forward, backward: of the same n frames, in the same order: the first row of `forward` and the
        last one of `backward` are the keyframes. A confidence of NaN is unknown.

    It is lost where neither track has the object.
    """
    n = len(forward.lost)
    sure = [np.nan_to_num(t.confidence.astype(np.float64), nan=0.5) for t in (forward, backward)]
    agreement = overlaps(forward.boxes, backward.boxes)
    arrived = [_ramp(overlap, ASTRAY, ARRIVED) for overlap in (agreement[-1], agreement[0])]
    at_end = [sure[0][-1], sure[1][0]]  # how sure each is at the other's keyframe
    trusted = [sure[i] * (1 - BELIED * (1 - arrived[i]) * at_end[i]) for i in range(2)]
    believed = _believed(trusted[0], trusted[1], agreement)
    ways = [_centred(forward.boxes), _centred(backward.boxes)]
    late = np.linspace(0, 1, n)
    drift = [ways[1][-1] - ways[0][-1], ways[0][0] - ways[1][0]]
    since = [late, 1 - late]  # of each track, the share of the frames since its keyframe
    ways = [ways[i] + arrived[i] * since[i][:, None] * drift[i] for i in range(2)]
    weights = [(1 - since[i] + arrived[i]) * np.maximum(sure[i], _LEAST) for i in range(2)]
    both = _ramp(agreement, DIFFER, AGREE)
    share = both * weights[1] / (weights[0] + weights[1]) + (1 - both) * believed
    share[0], share[-1] = 0, 1
    way = (1 - share[:, None]) * ways[0] + share[:, None] * ways[1]
    _bridge(way, believed, sure[0], sure[1], agreement)
    straight = ways[0][0, 2:] + late[:, None] * (ways[1][-1, 2:] - ways[0][0, 2:])
    estimated = gaussian_filter1d(way[:, 2:] - straight, SMOOTH_SIZE, axis=0, mode="constant")
    way[:, 2:] = straight + (1 - STRAIGHT_SIZE) * estimated
    boxes = _boxes(way)
    boxes[0], boxes[-1] = forward.boxes[0], backward.boxes[-1]
    one = np.where(believed, sure[1], sure[0])
    confidence = both * np.maximum(sure[0], sure[1]) + (1 - both) * one
    confidence *= APART + (1 - APART) * agreement
    lost = forward.lost & backward.lost
    return StretchTrack(boxes, confidence.astype(np.float32), lost, 1 - agreement)


def overlaps(one: NDArray[np.float32], other: NDArray[np.float32]) -> NDArray[np.float32]:
    """Intersection over union of boxes [n, 4] and [n, 4]: [n] in [0, 1]."""
    top_left = np.maximum(one[:, :2], other[:, :2])
    bottom_right = np.minimum(one[:, :2] + one[:, 2:], other[:, :2] + other[:, 2:])
    intersection = np.prod(np.maximum(bottom_right - top_left, 0), axis=1)
    union = one[:, 2:].prod(1) + other[:, 2:].prod(1) - intersection
    return np.clip(intersection / union, 0, 1)


def _believed(forward: Numbers, backward: Numbers, agreement: NDArray[np.float32]) -> Numbers:
    """Which track is believed in each frame, [n]: 0 forward, the first, 1 backward, the last.

    forward, backward: the confidences. Dynamic programming over the frames.
    """
    n = len(agreement)
    late = np.linspace(0, 1, n)
    costs = -np.log(np.maximum([forward, backward], _LEAST))
    costs += DISTANCE_COST * np.array([late, 1 - late])
    of_frames = [*zip(*costs.tolist(), (CHANGE_COST * (1 - agreement)).tolist(), strict=True)]
    stay, change = 0.0, np.inf  # the least costs up to here, of believing forward and backward
    changed = []  # of each frame, whether forward and whether backward is believed since then only
    for of_forward, of_backward, across in of_frames[1:]:
        changed.append((change + across < stay, stay + across < change))
        stay, change = (
            min(stay, change + across) + of_forward,
            min(change, stay + across) + of_backward,
        )
    believed = np.ones(n)
    which = 1
    for frame in range(n - 1, 0, -1):
        believed[frame] = which
        which ^= changed[frame - 1][which]
    believed[0] = 0
    return believed


def _bridge(
    way: Numbers,
    believed: Numbers,
    forward: Numbers,
    backward: Numbers,
    agreement: NDArray[np.float32],
) -> None:
    """Go straight where one unsure track follows another that is elsewhere, in place."""
    sure = np.where(believed, backward, forward) >= UNSURE
    for change in np.flatnonzero(np.diff(believed)):
        if agreement[change : change + 2].max() > DIFFER:
            continue
        start, end = change, change + 1
        while start > 0 and not sure[start] and believed[start - 1] == believed[change]:
            start -= 1
        while end < len(way) - 1 and not sure[end] and believed[end + 1] == believed[change + 1]:
            end += 1
        way[start : end + 1] = np.linspace(way[start], way[end], end - start + 1)


def _ramp(values: NDArray[np.float32], low: float, high: float) -> Numbers:
    """0 up to `low`, 1 from `high` on, straight between."""
    return np.clip((values.astype(np.float64) - low) / (high - low), 0, 1)


def _centred(boxes: NDArray[np.float32]) -> Numbers:
    """Centre and logarithm of the size: [n, 4]."""
    exact = boxes.astype(np.float64)
    return np.hstack([exact[:, :2] + exact[:, 2:] / 2, np.log(exact[:, 2:])])


def _boxes(centred: Numbers) -> NDArray[np.float32]:
    size = np.exp(centred[:, 2:])
    return np.hstack([centred[:, :2] - size / 2, size]).astype(np.float32)
