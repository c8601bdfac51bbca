"""How else, and where else, an object that is not recognised is looked for."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32

from dcs_jax.config import Config
from dcs_jax.core.window import place
from dcs_jax.types import Candidate, Scalar, VerificationState

# Turn of the search, that after its last one, the best candidate and what is seen in this turn.
_Done = tuple[Int32[Array, ""], Int32[Array, ""], Candidate, Any]


def search(
    look: jax.tree_util.Partial,
    localise: jax.tree_util.Partial,
    rests: jax.tree_util.Partial,
    box: Float[Array, "4"],
    initial_size: Float[Array, "2"],
    angle: Float[Array, ""] | None,
    known: VerificationState | None,
    frame_shape: tuple[int, ...],
    config: Config,
) -> tuple[Candidate, Any]:
    """The candidate around the box, or a better one if the object is not recognised there.

    Then this window is searched once more, by what the translation filter learned of the first
    frame alone: what it learned since may be beside the object. If the object was missed before,
    so are, in each frame, a few of the search windows that cover the frame, in turn, and that
    around the box that was verified last: the present one may have followed something else, or what
    is in front of the object. A loop, whose last turn looks at the candidate, if that is to be
    learned from: what it takes to look and to localise is compiled once.

    initial_size: [2], w and h of the first box. known: the state of the verification, None without.
    angle: of the canvas, None without a rotation filter.
    look: from a box and an angle to what is seen of the frame around it. localise: from a box, what
        is seen there and whether by the first frame alone to the candidate. rests: from the
        candidate to whether it is not learned from. Pytrees of what they need.
    Returns the candidate and what is seen around it, or, if it is not learned from, elsewhere.
    """
    settings = config.redetection
    windows = 0 if settings is None else settings.windows
    accept_above = 1.0 if settings is None else settings.accept_above
    verified, num_missed = (known.box, known.num_missed) if known else (box, jnp.int32(0))
    verification = config.verification
    sure_above = 1.0 if verification is None else verification.sure_above
    # What has no filter looks the same by the first frame alone.
    lost_below: Scalar = 0.0
    if verification is not None and config.translation is not None:
        lost_below = verification.lost_below

    # Under vmap the tracks take turns, so that those which hold their object do not search.
    @jax.custom_batching.sequential_vmap
    def search_all(
        look: jax.tree_util.Partial,
        localise: jax.tree_util.Partial,
        rests: jax.tree_util.Partial,
        box: Float[Array, "4"],
        angle: Float[Array, ""] | None,
        verified: Float[Array, "4"],
        reached: Float[Array, "2"],
        num_missed: Int32[Array, ""],
        lost_below: Float[Array, ""],
        sure_above: Float[Array, ""],
        accept_above: Float[Array, ""],
    ) -> tuple[Candidate, Any]:
        def turns(first: Candidate) -> Int32[Array, ""]:
            """Of the search: the window around the box, the same by the first frame, others."""
            around_the_box = jnp.where(first.confidence <= lost_below, 2, 1)
            return jnp.where(num_missed > 0, 3 + windows, around_the_box)

        def goes_on(done: _Done) -> Bool[Array, ""]:
            number, last, best, _ = done
            return (number < last) | ((number == last) & ~rests(best))

        def turn(done: _Done) -> _Done:
            number, last, best, _ = done
            tile = windows * num_missed + number - 3
            others = search_window(verified, tile, frame_shape, reached)
            places = jnp.stack([box, box, verified, others, best.box])
            place = places[jnp.where(number == last, 4, jnp.minimum(number, 3))]
            least = jnp.where(number < 3, sure_above, accept_above)

            def of_last(new: Float[Array, ""], old: Float[Array, ""]) -> Float[Array, ""]:
                return jnp.where(number == last, new, old)

            seen = look(place, jax.tree.map(of_last, best.rotation and best.rotation.angle, angle))

            def search_there() -> Candidate:
                other = localise(place, seen, number == 1)
                better = other.confidence > jnp.maximum(best.confidence, least)
                better |= number == 0
                return jax.tree.map(lambda new, old: jnp.where(better, new, old), other, best)

            best = jax.lax.cond(number == last, lambda: best, search_there)
            return number + 1, jnp.where(number == 0, turns(best), last), best, seen

        seen = jax.eval_shape(look, box, angle)
        shapes = jax.eval_shape(localise, box, seen, num_missed > 0), seen
        nothing = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
        return jax.lax.while_loop(goes_on, turn, (jnp.int32(0), jnp.int32(1), *nothing))[2:]

    reached = place(verified, config, initial_size).shown[2:] * (config.window_factor - 1)
    limits = jnp.float32(lost_below), jnp.float32(sure_above), jnp.float32(accept_above)
    given = look, localise, rests, box, angle, verified, reached, num_missed, *limits
    return search_all(*jax.tree.map(jnp.asarray, given))


def search_window(
    box: Float[Array, "4"],
    number: Int32[Array, ""],
    frame_shape: tuple[int, ...],
    reached: Float[Array, "2"],
) -> Float[Array, "4"]:
    """The box in the middle of one of the search windows that tile the frame, row by row.

    reached: [2], sides of the area that the middle of a box can be in, pixels.
    """
    sides = jnp.array([frame_shape[1], frame_shape[0]], jnp.float32)
    # Of a window factor just above 1 a window a pixel, or their number leaves int32.
    counts = jnp.minimum(jnp.ceil(sides / reached), sides).astype(jnp.int32)
    row, column = jnp.divmod(number % (counts[0] * counts[1]), counts[0])
    middle = (
        (jnp.stack([column, row]).astype(jnp.float32) + 0.5) * sides / counts.astype(jnp.float32)
    )
    return jnp.concatenate([middle - box[2:] / 2, box[2:]])
