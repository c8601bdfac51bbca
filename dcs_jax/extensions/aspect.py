"""The aspect ratio: an object that turns away, or tilts, gets narrower or flatter in the picture.

The box keeps the ratio of its first one until the object is surely more like its initial template
at another one. From then on the ratio is followed, by a step a frame at most, and the first one
taken again as soon as the object is more like the template there. The canvas keeps its proportion
to the box (`core.window.place`), so what all else sees of the object is as wide as it was.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from dcs_jax.config import AspectRatio, Grid
from dcs_jax.core.search import parabola_peak
from dcs_jax.extensions.descriptors import describe
from dcs_jax.types import VerificationState

# From one ratio to the next. The area stays the same: half of a step is of the height, half of the
# width. The size is the scale filter's.
_STEP = 1.06
# The ratios compared with the first one, steps: on either side a near one and a far one.
_FROM_FIRST = (-4.0, -2.0, 2.0, 4.0)
# A ratio nearer to the first one than this is that, steps.
_NEAR = 0.5
# The ratio is followed up to so many steps from the first one: to three times that, or a third.
_MOST = math.floor(math.log(3) / math.log(_STEP))


class _Seen(NamedTuple):
    """What is known of the object in a frame.

    window: [G_y + 1, G_x + 1], integral image. displacement: [2] of the object, down and right from
    the middle of the window, cells. initial: [D], the template. similarity: to that, in the ratio
    of the box.
    """

    window: Float[Array, "lines_y lines_x"]
    displacement: Float[Array, "2"]
    initial: Float[Array, " D"]
    similarity: Float[Array, ""]


@jax.named_scope("aspect")
def follow(
    box: Float[Array, "4"],
    initial_size: Float[Array, "2"],
    known: VerificationState,
    similarity: Float[Array, ""],
    resized: Bool[Array, ""],
    window: Float[Array, "lines_y lines_x"],
    displacement: Float[Array, "2"],
    settings: AspectRatio,
    grid: Grid,
) -> Float[Array, "4"]:
    """The box with the aspect ratio that the object has: [4], around the same centre.

    The first ratio is compared with others in the frames that are learned from, as neighbouring
    ones look the same; once it is left, the ratio is followed in all.

    initial_size: [2], w and h of the first box. known: the templates. similarity: to the initial
    one, of the object in the ratio of the box. resized: whether the size may change. window:
    [G_y + 1, G_x + 1], integral image. displacement: [2] of the object, down and right from the
    middle of the window, cells.
    """
    x, y, w, h = box
    taller = jnp.log(h / w * initial_size[0] / initial_size[1]) / math.log(_STEP)
    at_first = jnp.abs(taller) < _NEAR
    # No similarity is above 1: there may be nothing to gain.
    gains = (known.num_rested == 0) & (1 - similarity > settings.gain_above)
    compared = resized & (gains | ~at_first)
    seen = _Seen(window, displacement, known.initial, similarity)
    steps = _steps(jnp.where(at_first, 0, taller), compared, seen, settings, grid)
    down, across = _factors(steps[None])[0]
    return jnp.stack([x + w * (1 - across) / 2, y + h * (1 - down) / 2, w * across, h * down])


def _steps(
    taken: Float[Array, ""],
    compared: Bool[Array, ""],
    seen: _Seen,
    settings: AspectRatio,
    grid: Grid,
) -> Float[Array, ""]:
    """By how many steps the box is to be taller: [].

    taken: steps from the first ratio to that of the box, 0 if it is the first. compared: whether
    it is compared with others.
    """

    # Under vmap the tracks take turns, so that for those which are not compared nothing is done.
    @jax.custom_batching.sequential_vmap
    def steps(
        taken: Float[Array, ""], compared: Bool[Array, ""], seen: _Seen, settings: AspectRatio
    ) -> Float[Array, ""]:
        def found() -> Float[Array, ""]:
            at_first = taken == 0
            # Beside another ratio: one step less, one more, and back to the first.
            one = jnp.array(1, jnp.float32)
            nearby = jnp.stack([-one, one, -taken, jnp.zeros_like(taken)])
            others = jnp.where(at_first, jnp.array(_FROM_FIRST, jnp.float32), nearby)
            similarities = _similarities(others, seen, grid)
            cost = settings.cost * math.log(_STEP)
            away = jnp.abs(taken + others)
            scores = jnp.where(away <= _MOST, similarities - cost * away, -jnp.inf)
            here = seen.similarity - cost * jnp.abs(taken)
            beside = _beside(scores[0], here, scores[1])
            returns = similarities[2] > seen.similarity
            returns |= jnp.abs(taken + beside) < _NEAR
            best = jnp.argmax(scores)
            begins = similarities[best] > settings.similar_above
            begins &= similarities[best] - seen.similarity > settings.gain_above
            begun = jnp.where(begins, others[best], 0)
            return jnp.where(at_first, begun, jnp.where(returns, -taken, beside))

        return jax.lax.cond(compared, found, lambda: jnp.zeros_like(taken))

    return steps(taken, compared, seen, settings)


def _beside(
    less: Float[Array, ""], here: Float[Array, ""], more: Float[Array, ""]
) -> Float[Array, ""]:
    """Steps to the best of three neighbours by their scores: [], by a parabola in the middle."""
    nearer = jnp.where(less > more, jnp.array(-1, jnp.float32), jnp.array(1, jnp.float32))
    return jnp.where(here >= jnp.maximum(less, more), parabola_peak(less, here, more), nearer)


def _similarities(steps: Float[Array, " S"], seen: _Seen, grid: Grid) -> Float[Array, " S"]:
    """To the initial template, of the object in ratios so many steps taller than the box."""
    most = _STEP ** ((_MOST + 1) / 2)  # half a step beyond, by the parabola
    descriptions = describe(seen.window, seen.displacement, _factors(steps), grid, most)
    return descriptions @ seen.initial


def _factors(steps: Float[Array, " S"]) -> Float[Array, "S 2"]:
    """Height and width of so many steps to a taller box."""
    down = _STEP ** (steps / 2)
    return jnp.stack([down, 1 / down], axis=1)
