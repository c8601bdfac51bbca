"""Several targets that start in the same frame, tracked together as the frames are read."""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from dcs_jax.config import Config
from dcs_jax.io.frames import Frame, chunks
from dcs_jax.sequence import start_track, track_chunk
from dcs_jax.slots import CHUNK_BYTES, CHUNK_FRAMES
from dcs_jax.types import StepInfo


class Chunk(NamedTuple):
    """Some consecutive frames of B targets.

    boxes: [B, n, 4] float32, x, y, w, h in pixels. confidence: [B, n] float32 in [0, 1].
    """

    boxes: NDArray[np.float32]
    confidence: NDArray[np.float32]


def track_targets(
    frames: Iterable[Frame], boxes: NDArray[np.float32], keys: Sequence[jax.Array], config: Config
) -> Iterator[Chunk]:
    """Track the boxes [B, 4] of the first frame, each with its key, chunk of frames by chunk.

    frames: at least one. config: resolved, and the same for all boxes. The first chunk is the first
    frame alone.

    One target after the other through one compiled program: videos of any number of targets share
    it, the boxes are those of `dcs-jax track`, and what fills the cores is several videos at once.
    """
    rest = iter(frames)
    first = next(rest)
    size = max(1, min(CHUNK_FRAMES, CHUNK_BYTES // first.nbytes))
    started = [start_track(first, box, key, config) for box, key in zip(boxes, keys, strict=True)]
    states = [state for state, _ in started]
    yield _stack([jax.tree.map(lambda leaf: leaf[None], info) for _, info in started], 1)
    for chunk in chunks(rest, size):
        # Chunks of one length whatever the video's, so that one compiled program serves all.
        padding = np.repeat(chunk[-1:], size - len(chunk), axis=0)
        padded = jnp.asarray(np.concatenate([chunk, padding]))
        followed = [track_chunk(state, padded, config) for state in states]
        states = [state for state, _ in followed]
        yield _stack([infos for _, infos in followed], len(chunk))


def _stack(infos: list[StepInfo], length: int) -> Chunk:
    """The first `length` rows of each target's records; any others are of the padding."""
    return Chunk(
        np.stack([np.asarray(info.box)[:length] for info in infos]),
        np.stack([np.asarray(info.confidence)[:length] for info in infos]),
    )
