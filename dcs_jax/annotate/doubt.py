"""Where a person should look: the frames in which the boxes are probably wrong.

One frame of little confidence is mostly a blurred one: it is the mean over a window that counts.
And an object that turns is not recognised, but followed all the same: where it is recognised again,
and its box has not jumped meanwhile, it was never lost. Of the visits of an annotator who goes
where `doubtful` sends it (`benchmarks.annotator`, thirteen sequences, three seeds), 16 of 18 are to
boxes that overlap the object by less than half.
"""

import itertools

import numpy as np
from numpy.typing import NDArray

from dcs_jax.annotate.project import ObjectLane

# Frames of a window, and the mean confidence below which the box in its middle is in doubt.
WINDOW, DOUBTED = 25, 0.3
# Confidence from which on the object is recognised again.
RECOGNISED = 0.7
# The largest step of a box that has not jumped, in sides of it, and the mean disagreement of
# forward and backward up to which they follow the same.
JUMP, APART = 0.5, 0.8
# By how much less a frame may be in doubt and still be as doubtful as any.
AS_DOUBTFUL = 0.04


def doubt(lane: ObjectLane) -> NDArray[np.float64]:
    """How doubtful each frame's box is, [T]: not negative, above 1 where it is in doubt.

    The mean of 1 minus the confidence over a window, over that at the limit; 0 without a box. A
    frame counts nothing where the object was followed until it was recognised again.
    """
    known = ~np.isnan(lane.confidence)
    lacking = np.where(known & ~_followed(lane), 1 - lane.confidence.astype(np.float64), 0)
    mean = _window_sum(lacking) / np.maximum(_window_sum(known), 1)
    return np.where(known, mean / (1 - DOUBTED), 0)


def doubtful(lane: ObjectLane) -> list[int]:
    """Of each stretch of frames in a row that are in doubt, the most doubtful frame.

    Of several that are as doubtful the last: the longer an object has not been recognised, the
    farther its box is from it.
    """
    values = doubt(lane)
    edges = np.flatnonzero(np.diff(np.r_[False, values > 1, False].astype(np.int8)))
    found = []
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        stretch = values[start:end]
        found.append(int(start + np.flatnonzero(stretch >= stretch.max() - AS_DOUBTFUL)[-1]))
    return found


def _followed(lane: ObjectLane) -> NDArray[np.bool_]:
    """In which frames the object is not recognised, but was followed: [T].

    It is recognised before and after, the box has not jumped, and forward and backward agree.
    """
    recognised = np.nan_to_num(lane.confidence, nan=0) > RECOGNISED
    boxes = lane.boxes.astype(np.float64)
    sides = np.sqrt(boxes[:, 2:].prod(1))
    steps = np.linalg.norm(np.diff(boxes[:, :2] + boxes[:, 2:] / 2, axis=0), axis=1)
    steps = steps / np.minimum(sides[1:], sides[:-1])
    followed = np.zeros(len(boxes), np.bool_)
    edges = np.flatnonzero(np.diff(recognised.astype(np.int8)))
    for before, last in itertools.pairwise(edges):
        gap = slice(before + 1, last + 1)
        apart = lane.disagreement[gap]
        apart = apart[~np.isnan(apart)]
        followed[gap] = (
            recognised[before]
            # Of a frame without a box it is not known.
            and (steps[before : last + 1] <= JUMP).all()
            and (not apart.size or apart.mean() <= APART)
        )
    return followed


def _window_sum(values: NDArray[np.generic]) -> NDArray[np.float64]:
    """The sum over the window around each of the values, as far as there are any."""
    # The window may be longer than the clip.
    sums = np.convolve(values.astype(np.float64), np.ones(WINDOW))
    return sums[WINDOW // 2 :][: len(values)]
