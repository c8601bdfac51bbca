"""Where a person should look: the frames in which the boxes are probably wrong."""

import numpy as np
from numpy.typing import NDArray

from dcs_jax.annotate.project import ObjectLane

# Confidence below which a box is in doubt.
LIMIT = 0.5


def doubt(lane: ObjectLane) -> NDArray[np.float32]:
    """How doubtful each frame's box is, [T] in [0, 1]; 0 where there is none.

    The confidence of a joined track already says where forward and backward disagree.
    """
    return np.nan_to_num(1 - lane.confidence)


def doubtful(lane: ObjectLane) -> list[int]:
    """Of each stretch of frames in a row that are doubtful, the most doubtful frame."""
    values = doubt(lane)
    edges = np.flatnonzero(np.diff(np.r_[False, values > 1 - LIMIT, False].astype(np.int8)))
    return [
        int(start + values[start:end].argmax())
        for start, end in zip(edges[::2], edges[1::2], strict=True)
    ]
