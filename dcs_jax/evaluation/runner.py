"""Many seeds of one sequence at once."""

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from dcs_jax.config import Config
from dcs_jax.runners.stream import track_stream


class Runs(NamedTuple):
    """The tracks of S seeds of one sequence.

    boxes: [S, T, 4] float32, x, y, w, h in pixels; the first row is the initial box.
    confidence: [S, T] float32 in [0, 1]; NaN for a tracker without confidence.
    seconds: time of tracking the S seeds, without compilation and without reading the frames.
    """

    boxes: NDArray[np.float32]
    confidence: NDArray[np.float32]
    seconds: float


def run_seeds(
    frames: Iterable[NDArray[np.uint8]],
    box: NDArray[np.float64],
    seeds: Sequence[int],
    config: Config,
    on_frames: Callable[[int], None] = lambda tracked: None,
) -> Runs:
    """Track a box with every seed: the tracks of `track_sequence` with `jax.random.key(seed)`.

    frames: [H, W, 3] uint8 RGB each, read as they are needed.
    box: [4], x, y, w, h in pixels, of the first frame.
    on_frames: called with the number of track-frames after each chunk.
    """
    keys = jax.vmap(jax.random.key)(jnp.asarray(seeds, jnp.uint32))
    stream = track_stream(frames, np.tile(box, (len(seeds), 1)), keys, config)
    tracks = []
    for chunk in stream:
        tracks.append(chunk.track)
        on_frames(len(seeds) * len(chunk.frames))
    boxes, confidence = (
        np.concatenate([getattr(track, field) for track in tracks], 1)
        for field in ("boxes", "confidence")
    )
    return Runs(boxes, confidence, stream.seconds)
