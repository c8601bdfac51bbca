"""Where a person should look: the frames in which the boxes are probably wrong.

One frame of little confidence is mostly a blurred one. Measured on the tracks from and between
keyframes of thirteen sequences: of the frames that `doubtful` names, 0.71 overlap the object by
less than half; 0.57 if each frame is taken by itself.
"""

import numpy as np
from numpy.typing import NDArray

from dcs_jax.annotate.project import ObjectLane

WINDOW = 15  # frames
# Mean confidence over a window, below which the box in its middle is in doubt.
LIMIT = 0.5


def doubt(lane: ObjectLane) -> NDArray[np.float64]:
    """How doubtful each frame's box is, [T] in [0, 1]: over the window around; 0 without a box.

    The confidence of a joined track says, too, where forward and backward disagree.
    """
    known = ~np.isnan(lane.confidence)
    window = np.ones(WINDOW)
    # The window may be longer than the clip.
    sums, counts = (
        np.convolve(values, window)[WINDOW // 2 :][: len(known)]
        for values in (np.where(known, 1 - lane.confidence.astype(np.float64), 0), known)
    )
    return np.where(known, sums / np.maximum(counts, 1), 0)


def doubtful(lane: ObjectLane) -> list[int]:
    """Of each stretch of frames in a row that are doubtful, the most doubtful frame."""
    values = doubt(lane)
    edges = np.flatnonzero(np.diff(np.r_[False, values > 1 - LIMIT, False].astype(np.int8)))
    return [
        int(start + values[start:end].argmax())
        for start, end in zip(edges[::2], edges[1::2], strict=True)
    ]
