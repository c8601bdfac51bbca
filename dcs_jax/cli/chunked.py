"""Tracking frames as they are read, in chunks of a fixed length."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray

import dcs_jax
from dcs_jax.io.frames import Frame, chunks
from dcs_jax.sequence import start_track

CHUNK_FRAMES = 32
CHUNK_BYTES = 2**28  # fewer frames a chunk where they are very large


class Chunk(NamedTuple):
    """Some consecutive frames and where the object is in them.

    frames: [n, H, W, 3] uint8 RGB.
    boxes: [n, 4] float32, x, y, w, h in pixels.
    confidence: [n] float32 in [0, 1].
    part_scores: [n, K] float32 in [0, 1].
    """

    frames: NDArray[np.uint8]
    boxes: NDArray[np.float32]
    confidence: NDArray[np.float32]
    part_scores: NDArray[np.float32]


def track_chunks(
    frames: Iterable[Frame],
    box: NDArray[np.float64],
    config: dcs_jax.Config,
    seed: int,
) -> Iterator[Chunk]:
    """Track the box [4] of the first frame through all frames, which are read as they are needed.

    The first chunk is the first frame alone.

    Raises:
        BrokenSource: passed on from the frames, after what was read before it has been tracked.
    """
    rest = iter(frames)
    first = next(rest)
    config = config.resolve(box)
    state, info = start_track(first, box.astype(np.float32), jax.random.key(seed), config)
    yield _to_numpy(first[None], jax.tree.map(lambda leaf: leaf[None], info))

    size = max(1, min(CHUNK_FRAMES, CHUNK_BYTES // first.nbytes))
    for chunk in chunks(rest, size):
        # Chunks of one length whatever the video's, so that one compiled program serves all videos
        # of a frame size, now and from the cache.
        padding = np.repeat(chunk[-1:], size - len(chunk), axis=0)
        state, infos = dcs_jax.track_chunk(state, np.concatenate([chunk, padding]), config)
        yield _to_numpy(chunk, infos)


def _to_numpy(frames: NDArray[np.uint8], infos: dcs_jax.StepInfo) -> Chunk:
    """The frames [n, H, W, 3] with the first n rows of `infos`; any others are of the padding."""
    return Chunk(frames, *(np.asarray(rows)[: len(frames)] for rows in infos))
