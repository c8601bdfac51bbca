"""Whole sequences: `step` scanned over the frames of a video, compiled once per shape."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt8

from dcs_jax import tracker
from dcs_jax.checks import check_box, check_frames, check_key
from dcs_jax.config import Config
from dcs_jax.types import BoxLike, Frame, ImageLike, State, StepInfo, Track

Frames = UInt8[Array, "T H W *channels"]


def track_sequence(
    frames: ImageLike,
    box: BoxLike,
    key: jax.Array | None = None,
    config: Config = Config(),
) -> Track:
    """Track a box through a video.

    frames: [T, H, W] grey or [T, H, W, 3] RGB, uint8, NumPy or JAX.
    box: [4], x, y, w, h in pixels in the first frame, (x, y) the top-left corner; at least 4 pixels
        a side, and at least partly in the frame.
    key: random key that decides the features; by default `jax.random.key(0)`. The same key gives
        the same boxes, bit for bit.
    config: settings. On a canvas (the default) only another shape of `frames` or another static
        field is compiled; with canvas="native" another size of box is, too.

    Raises ValueError, before any compilation, where an argument is not as stated.
    """
    check_frames(frames)
    check_box(box, frames.shape[1:])
    if key is None:
        key = jax.random.key(0)
    check_key(key)
    if not isinstance(config, Config):
        raise ValueError(f"config must be a dcs_jax.Config, but is {config!r}")
    box = np.asarray(box, np.float32)
    return _track(frames, box, key, config.resolve(box))


@jax.jit
def _track(frames: Frames, box: Float[Array, "4"], key: jax.Array, config: Config) -> Track:
    state, first = init_track(frames[0], box, key, config)
    _, rest = track_chunk(state, frames[1:], config)
    infos = jax.tree.map(lambda one, more: jnp.concatenate([one[None], more]), first, rest)
    return Track(*infos)


@jax.jit
def init_track(
    frame: Frame, box: Float[Array, "4"], key: jax.Array, config: Config
) -> tuple[State, StepInfo]:
    """The state after the first frame, `init`, and that frame's record, `score`, compiled."""
    state = tracker.init(frame, box, key, config)
    return state, tracker.score(state, frame, config)


@jax.jit
def track_chunk(state: State, frames: Frames, config: Config) -> tuple[State, StepInfo]:
    """Track on through the next frames of a video: `step` in one `lax.scan`.

    frames: [T, H, W] or [T, H, W, 3], uint8. Returns the state after them, and the infos stacked
    over T. Chunks of any lengths give the same boxes as the whole; each length is compiled once.
    """
    return jax.lax.scan(lambda state, frame: tracker.step(state, frame, config), state, frames)
