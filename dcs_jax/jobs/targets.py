"""Several targets that start in the same frame, tracked together as the frames are read."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray

from dcs_jax.config import Config
from dcs_jax.io.frames import Frame
from dcs_jax.runners.stream import track_stream


class Chunk(NamedTuple):
    """Some consecutive frames of B targets.

    boxes: [B, n, 4] float32, x, y, w, h in pixels. confidence: [B, n] float32 in [0, 1].
    """

    boxes: NDArray[np.float32]
    confidence: NDArray[np.float32]


def track_targets(
    frames: Iterable[Frame], boxes: NDArray[np.float32], key: jax.Array, config: Config
) -> Iterator[Chunk]:
    """Track the boxes [B, 4] of the first frame, chunk of frames by chunk: `track_stream`.

    frames: at least one. config: resolved, and the same for all boxes. The first chunk is the first
    frame alone.
    """
    count = len(boxes)
    for chunk in track_stream(frames, boxes, key, config, slots=slots_for(count)):
        track = chunk.track
        yield Chunk(np.asarray(track.boxes)[:count], np.asarray(track.confidence)[:count])


def slots_for(count: int) -> int:
    """The slots for so many targets: a power of two, so that few programs serve videos of any
    number. An empty slot takes no time.
    """
    return 1 << (count - 1).bit_length()
