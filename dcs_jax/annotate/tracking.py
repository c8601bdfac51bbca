"""The tracks of stretches: forward from the keyframe at the left, backward from that at the right.

Many stretches, of several objects, are tracked in one batch, each direction in one pass over the
frames. The only file of `annotate` that runs the tracker.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from dcs_jax.annotate.project import Box
from dcs_jax.annotate.stretches import Stretch, StretchTrack
from dcs_jax.config import Config
from dcs_jax.io.source import Image

# The frames `start` (inclusive) to `end` (exclusive) of the clip, [H, W, 3] or [H, W] uint8.
OpenFrames = Callable[[int, int], Iterable[Image]]
# Takes the track of a stretch as far as it is made, and whether it is complete.
OnProgress = Callable[[Stretch, StretchTrack, bool], None]


class Runs(dict[tuple[int, Box, bool], StretchTrack]):
    """What was tracked from each keyframe in each direction, kept from call to call.

    By frame, box and whether it is forward. Where a keyframe is set in the middle of a stretch, the
    tracks from its ends are known, and only those from the new keyframe are made.
    """


def track_stretches(
    open_frames: OpenFrames,
    stretches: Sequence[Stretch],
    config: Config = Config(),
    seed: int = 0,
    on_progress: OnProgress = lambda stretch, track, complete: None,
    stopped: Callable[[], bool] = lambda: False,
    runs: Runs | None = None,
) -> dict[Stretch, StretchTrack]:
    """Track stretches, all in one batch: those that are complete.

    open_frames: called with a start and an end, gives those frames; at most a few times.
    config, seed: as for `track_sequence`.
    on_progress: called after every chunk of frames with each stretch that has grown.
    stopped: asked after every chunk; where it is true, the rest is left.
    runs: what earlier calls of the same clip, config and seed have tracked, and this one adds to.

    Raises ValueError where a box is not one that can be tracked; what `open_frames` raises, after
    what came before has been tracked.
    """
    raise NotImplementedError


def prepare(shape: tuple[int, ...], config: Config = Config(), seed: int = 0) -> None:
    """Compile what `track_stretches` runs on frames of this shape, so that it starts at once."""
    raise NotImplementedError


def track_between(
    frames: NDArray[np.uint8],
    keyframes: Mapping[int, Box | None],
    config: Config = Config(),
    seed: int = 0,
) -> StretchTrack:
    """One object through keyframes, both ways, joined.

        track_between(frames, {0: (99, 146, 48, 64), 180: (131, 120, 52, 68)}).boxes  # [T, 4]

    frames: [T, H, W] or [T, H, W, 3] uint8.
    keyframes: the box in some frames, x, y, w, h in pixels; None: not there, up to the next one.

    Raises ValueError, before any compilation, where an argument is not as stated.
    """
    raise NotImplementedError
