"""Where a person should look: the frames in which the boxes are probably wrong.

One frame of little confidence is mostly a blurred one: it is the mean over a window that counts.
Measured on the tracks from and between keyframes at random of thirteen sequences: of the frames
that `doubtful` names, 0.64 overlap the object by less than half (0.82 by less than 0.7); 0.34 if a
confidence below 0.5 is enough.
"""

import numpy as np
from numpy.typing import NDArray

from dcs_jax.annotate.project import ObjectLane

# Frames of a window, and the mean confidence below which the box in its middle is in doubt: short
# losses must be clear, long ones need not.
WINDOWS = ((7, 0.15), (25, 0.4))


def doubt(lane: ObjectLane) -> NDArray[np.float64]:
    """How doubtful each frame's box is, [T]: not negative, above 1 where it is in doubt.

    The mean of 1 minus the confidence over a window, over that at the limit; 0 without a box. The
    confidence of a joined track says, too, where forward and backward disagree.
    """
    known = ~np.isnan(lane.confidence)
    lacking = np.where(known, 1 - lane.confidence.astype(np.float64), 0)
    worst = np.zeros(len(known))
    for width, limit in WINDOWS:
        mean = _window_sum(lacking, width) / np.maximum(_window_sum(known, width), 1)
        worst = np.maximum(worst, mean / (1 - limit))
    return np.where(known, worst, 0)


def doubtful(lane: ObjectLane) -> list[int]:
    """Of each stretch of frames in a row that are in doubt, the most doubtful frame."""
    values = doubt(lane)
    edges = np.flatnonzero(np.diff(np.r_[False, values > 1, False].astype(np.int8)))
    return [
        int(start + values[start:end].argmax())
        for start, end in zip(edges[::2], edges[1::2], strict=True)
    ]


def _window_sum(values: NDArray[np.generic], width: int) -> NDArray[np.float64]:
    """The sum over the window around each of the values, as far as there are any."""
    # The window may be longer than the clip.
    sums = np.convolve(values.astype(np.float64), np.ones(width))
    return sums[width // 2 :][: len(values)]
