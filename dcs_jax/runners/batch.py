"""Many tracks in one call."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh

from dcs_jax.checks import check_boxes, check_keys, check_videos
from dcs_jax.config import Config, resolve_all
from dcs_jax.runners.slots import Slots
from dcs_jax.types import BoxLike, ImageLike, Track


def track_batch(
    frames: ImageLike,
    boxes: BoxLike | Sequence[BoxLike],
    keys: jax.Array | None = None,
    config: Config = Config(),
    mesh: Mesh | None = None,
) -> Track:
    """Track B boxes through one video, or one box through each of B videos.

    The same boxes as B calls of `track_sequence`, bit for bit with `scale=None`, else up to the
    rounding of the boxes' sizes, which differs between compiled programs. In less time: on a CPU
    one thread a core, and the column sums of a frame once a core, not once a target. Memory: the
    frames, the states and a chunk of them (32 MiB, or 32 frames).

    frames: uint8, NumPy or JAX. One video for all boxes, [T, H, W] grey or [T, H, W, 3] RGB, or a
        video for each, [B, T, H, W] or [B, T, H, W, 3]. Four axes with 3 at the end are always one
        RGB video: no grey video is 3 pixels wide.
    boxes: [B, 4], x, y, w, h in pixels in the first frame, as for `track_sequence`; of any sizes on
        a canvas (the default), of one size with canvas="native" or a window_minimum that one of
        them does not reach.
    keys: [], one key for all, by default `jax.random.key(0)`: then one pool of features is drawn
        and stored for all tracks; or [B], one key each, for example
        `jax.vmap(jax.random.key)(jnp.arange(B))` for the seeds 0 to B - 1.
    config: settings; each of its numbers may be an array [B], one for each track. Values of `block`
        that differ give each track a pool of its own, also with one key.
    mesh: with an axis "batch", over whose devices the tracks are sharded, without communication
        until the end; jax.make_mesh((n,), ("batch",)). Of several processes joined by
        `jax.distributed.initialize`, each makes the same call with the same arguments.

    Returns a Track with a leading axis B on every array, whole in every process.

    Another number of boxes, shape of a frame or static field of the config is compiled; other
    boxes, keys, numbers and lengths T do not.

    Raises ValueError, before any compilation, where an argument is not as stated.
    """
    videos = check_videos(frames)
    frame_shape = frames.shape[2:] if videos else frames.shape[1:]
    boxes = check_boxes(boxes, frame_shape)
    B, T = len(boxes), frames.shape[1 if videos else 0]
    if videos and len(frames) != B:
        raise ValueError(
            f"frames {frames.shape} are {len(frames)} videos, but there are {B} boxes: expected a "
            "video for each, or one video for all, [T, H, W] or [T, H, W, 3]"
        )
    keys = check_keys(keys, B)
    slots = Slots(B, frame_shape, keys, resolve_all(config, boxes), mesh, videos)

    first = frames[:, 0] if videos else frames[0]
    parts = [slots.init(first, boxes, np.ones(B, bool))]
    for start in range(1, T, slots.length):
        chunk = slice(start, start + slots.length)
        parts.append(slots.scan(frames[:, chunk] if videos else frames[chunk]))
    rows = map(slots.rows, parts)
    # The fields of a track are those of a record, in the same order.
    return Track(*jax.tree.map(lambda *leaves: jnp.asarray(np.concatenate(leaves, 1)), *rows))
