"""The aspect ratio: an object that turns away, or tilts, gets narrower or flatter in the picture.

The box keeps the ratio of its first one until the object is surely more like its initial template
at another one. From then on the ratio is followed, by a step a frame at most, and the first one
taken again as soon as the object is more like the template there. The canvas keeps its proportion
to the box (`core.window.place`), so what all else sees of the object is as wide as it was.
"""

import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from dcs_jax.config import AspectRatio, Grid
from dcs_jax.core.search import parabola_peak
from dcs_jax.extensions.descriptors import describe

# From one ratio to the next. The area stays the same: half of a step is of the height, half of the
# width. The size is the scale filter's.
_STEP = 1.06
# The ratios compared with the first one, steps: on either side a near one and a far one.
_FROM_FIRST = (-4.0, -2.0, 2.0, 4.0)
# A ratio nearer to the first one than this is that, steps.
_NEAR = 0.5
# The ratio is followed up to so many steps from the first one: to three times that, or a third.
_MOST = math.floor(math.log(3) / math.log(_STEP))


@jax.named_scope("aspect")
def follow(
    box: Float[Array, "4"],
    initial_size: Float[Array, "2"],
    initial: Float[Array, " D"],
    similarity: Float[Array, ""],
    window: Float[Array, "lines_y lines_x"],
    displacement: Float[Array, "2"],
    settings: AspectRatio,
    grid: Grid,
) -> Float[Array, "4"]:
    """The box with the aspect ratio that the object has: [4], around the same centre.

    initial_size: [2], w and h of the first box. initial: [D], the template; similarity: to that, of
    the object in the ratio of the box. window: [G_y + 1, G_x + 1], integral image. displacement:
    [2] of the object, down and right from the middle of the window, cells.
    """
    x, y, w, h = box
    taller = jnp.log(h / w * initial_size[0] / initial_size[1]) / math.log(_STEP)
    at_first = jnp.abs(taller) < _NEAR
    taken = jnp.where(at_first, 0, taller)
    # Beside the first one: one step less, one more, and back to the first.
    step = jnp.array(1, jnp.float32)
    nearby = jnp.stack([-step, step, -taken, jnp.zeros_like(taken)])
    steps = jnp.where(at_first, jnp.array(_FROM_FIRST, jnp.float32), nearby)
    # A ratio may be half a step beyond the most: by the parabola.
    most = _STEP ** ((_MOST + 1) / 2)
    descriptions = describe(window, displacement, _factors(steps), grid, most)
    similarities = descriptions @ initial
    cost = settings.cost * math.log(_STEP)
    away = jnp.abs(taken + steps)
    scores = jnp.where(away <= _MOST, similarities - cost * away, -jnp.inf)
    best = jnp.argmax(scores)
    begins = similarities[best] > settings.similar_above
    begins &= similarities[best] - similarity > settings.gain_above
    begun = jnp.where(begins, steps[best], 0)
    less, here, more = scores[0], similarity - cost * jnp.abs(taken), scores[1]
    followed = jnp.where(less > more, -step, step)
    followed = jnp.where(here >= jnp.maximum(less, more), parabola_peak(less, here, more), followed)
    returns = (similarities[2] > similarity) | (jnp.abs(taken + followed) < _NEAR)
    followed = jnp.where(returns, -taken, followed)
    factors = _factors(jnp.where(at_first, begun, followed)[None])
    down, across = factors[0]
    return jnp.stack([x + w * (1 - across) / 2, y + h * (1 - down) / 2, w * across, h * down])


def _factors(steps: Float[Array, " S"]) -> Float[Array, "S 2"]:
    """Height and width of so many steps to a taller box."""
    down = _STEP ** (steps / 2)
    return jnp.stack([down, 1 / down], axis=1)
