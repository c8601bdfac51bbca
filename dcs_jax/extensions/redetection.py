"""Re-detection: an object that was missed is looked for in search windows all over the frame."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int32

from dcs_jax.config import Config
from dcs_jax.types import Candidate

# From a box to the candidate in the search window around it; a pytree of what that takes.
Localise = jax.tree_util.Partial


def search(
    localise: Localise,
    box: Float[Array, "4"],
    num_missed: Int32[Array, ""],
    frame_shape: tuple[int, ...],
    config: Config,
) -> Candidate:
    """The candidate around the box, or a better one elsewhere if the object was missed before.

    In each frame a few of the search windows that cover the frame are searched, in turn: a loop of
    one turn, or of one and these, so that what it takes to localise is compiled once.
    """
    settings = config.redetection
    assert settings is not None
    windows = settings.windows

    # Under vmap the tracks take turns, so that those which hold their object do not search.
    @jax.custom_batching.sequential_vmap
    def search_all(
        localise: Localise,
        box: Float[Array, "4"],
        num_missed: Int32[Array, ""],
        accept_above: Float[Array, ""],
    ) -> Candidate:
        def search_next(turn: Int32[Array, ""], best: Candidate) -> Candidate:
            number = windows * num_missed + turn - 1
            elsewhere = search_window(box, number, frame_shape, config.window_factor)
            other = localise(jnp.where(turn == 0, box, elsewhere))
            better = other.confidence > jnp.maximum(best.confidence, accept_above)
            better |= turn == 0
            return jax.tree.map(lambda new, old: jnp.where(better, new, old), other, best)

        shapes = jax.eval_shape(localise, box)
        nothing = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
        turns = jnp.where(num_missed > 0, 1 + windows, 1)
        return jax.lax.fori_loop(0, turns, search_next, nothing)

    return search_all(
        *jax.tree.map(jnp.asarray, (localise, box, num_missed, settings.accept_above))
    )


def search_window(
    box: Float[Array, "4"],
    number: Int32[Array, ""],
    frame_shape: tuple[int, ...],
    window_factor: float,
) -> Float[Array, "4"]:
    """The box in the middle of one of the search windows that tile the frame, row by row."""
    sides = jnp.array([frame_shape[1], frame_shape[0]], jnp.float32)
    counts = jnp.ceil(sides / (box[2:] * (window_factor - 1))).astype(jnp.int32)
    row, column = jnp.divmod(number % (counts[0] * counts[1]), counts[0])
    middle = (
        (jnp.stack([column, row]).astype(jnp.float32) + 0.5) * sides / counts.astype(jnp.float32)
    )
    return jnp.concatenate([middle - box[2:] / 2, box[2:]])
