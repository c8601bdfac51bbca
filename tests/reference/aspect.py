"""The aspect ratio of an object that gets narrower or flatter, by its initial template."""

import math
from collections.abc import Callable

import numpy as np

from .records import AspectRatio, Floats
from .search import parabola_peak

STEP = 1.06  # from one ratio to the next
FROM_FIRST = (-4, -2, 2, 4)  # compared with the first one, steps
MOST = 18  # steps from the first one: less than a factor of 3
NEAR = 0.5  # steps from the first one that are none


def follow(
    box: Floats,
    initial_size: Floats,
    similarity: Callable[[float], float],
    settings: AspectRatio,
    *,
    rested: bool = False,
) -> Floats:
    """The box [4] with the ratio that it is to have, of the same area around the same centre.

    initial_size: [2], w and h of the first box. similarity: to the initial template, of the object
    in a box so many steps taller than this one. rested: whether the frame before was not learned
    from.
    """
    x, y, width, height = box
    first = math.log(initial_size[1] / initial_size[0])
    taken = (math.log(height / width) - first) / math.log(STEP)
    if abs(taken) < NEAR:
        taken = 0.0

    def score(steps: float) -> float:
        return similarity(steps) - settings.cost * abs(taken + steps) * math.log(STEP)

    steps: float
    if taken == 0 and rested:
        steps = 0
    elif taken == 0:
        steps = max(FROM_FIRST, key=score)
        gain = similarity(steps) - similarity(0)
        if not (similarity(steps) > settings.similar_above and gain > settings.gain_above):
            steps = 0
    elif similarity(-taken) > similarity(0):
        steps = -taken
    else:
        less, here, more = (
            score(one) if abs(taken + one) <= MOST or one == 0 else -math.inf for one in (-1, 0, 1)
        )
        if here == max(less, here, more):
            steps = parabola_peak(less, here, more)
        else:
            steps = -1 if less > more else 1
        if abs(taken + steps) < NEAR:
            steps = -taken
    taller = STEP**steps
    new_width, new_height = width / math.sqrt(taller), height * math.sqrt(taller)
    left, top = x + (width - new_width) / 2, y + (height - new_height) / 2
    return np.array([left, top, new_width, new_height])
