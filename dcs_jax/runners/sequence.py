"""Whole sequences: one track through one video."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int32

from dcs_jax import tracker
from dcs_jax.checks import check_box, check_frames, check_key
from dcs_jax.config import Config, check_config, single_precision
from dcs_jax.core.window import VideoFrame
from dcs_jax.runners.batch import track_batch
from dcs_jax.tracker import check_state
from dcs_jax.types import BoxLike, Frame, Frames, ImageLike, State, StepInfo, Track


def track_sequence(
    frames: ImageLike,
    box: BoxLike,
    key: jax.Array | None = None,
    config: Config = Config(),
) -> Track:
    """Track a box through a video.

    frames: [T, H, W] grey or [T, H, W, 3] RGB, uint8, NumPy or JAX.
    box: [4], x, y, w, h in pixels in the first frame, (x, y) the top-left corner; 4 to 1e6 pixels a
        side, and at least partly in the frame.
    key: random key that decides the features; by default `jax.random.key(0)`. The same key gives
        the same boxes, bit for bit.
    config: settings. On a canvas (the default) only another size of the frames or another static
        field is compiled; with canvas="native" another size of box is, too.

    Runs by chunks of one length, so that another length T compiles nothing. Inside a transformation
    such as jit or vmap it is one `lax.scan` over the frames.

    Raises ValueError, before any compilation, where an argument is not as stated.
    """
    check_frames(frames)
    check_box(box, frames.shape[1:])
    if key is None:
        key = jax.random.key(0)
    check_key(key)
    check_config(config)
    if any(
        isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves((frames, box, key, config))
    ):
        return _track(jnp.asarray(frames), jnp.asarray(box, jnp.float32), key, config)
    tracks = track_batch(frames, np.asarray(box, np.float32)[None], key, config)
    return Track(*(leaf[0] for leaf in tracks))


def _track(frames: Frames, box: Float[Array, "4"], key: jax.Array, config: Config) -> Track:
    state, first = init_track(frames[0], box, key, config)
    if len(frames) == 1:
        return Track(*(leaf[None] for leaf in first))
    _, rest = track_chunk(state, frames[1:], config)
    infos = jax.tree.map(lambda one, more: jnp.concatenate([one[None], more]), first, rest)
    return Track(*infos)


@jax.jit
def init_track(
    frame: Frame, box: Float[Array, "4"], key: jax.Array, config: Config
) -> tuple[State, StepInfo]:
    """The state after the first frame and that frame's record, `start`, compiled."""
    return tracker.start(frame, box, key, config)


def track_chunk(state: State, frames: ImageLike, config: Config) -> tuple[State, StepInfo]:
    """Track on through the next frames of a video: `step` in one `lax.scan`.

    frames: [T, H, W] or [T, H, W, 3], uint8, at least one. Returns the state after them, and the
    infos stacked over T. Chunks of any lengths give the same boxes as the whole; each length is
    compiled once.

    Raises ValueError, before any compilation, where types, shapes or the components of state and
    config are not as stated.
    """
    check_frames(frames)
    config = single_precision(config)
    check_state(state, config)
    return _track_chunk(state, frames, config)


@jax.jit
def _track_chunk(state: State, frames: Frames, config: Config) -> tuple[State, StepInfo]:

    def step(state: State, index: Int32[Array, ""]) -> tuple[State, StepInfo]:
        # Not the frames scanned over: each would be copied whole.
        return tracker.step(state, VideoFrame(frames, index), config)

    return jax.lax.scan(step, state, jnp.arange(len(frames), dtype=jnp.int32))
