"""The scale filter: a one-dimensional correlation filter over scales (DSST).

Danelljan et al., "Accurate scale estimation for robust visual tracking", BMVC 2014.
"""

import numpy as np

from . import filters
from .filters import Filter
from .records import Floats, ScaleFilter
from .search import parabola_peak

SIGMA = 0.25  # of the desired output, in roots of the number of scales
RIDGE = 0.01
LEAST_SIDE = 8.0  # pixels


def factors(settings: ScaleFilter | None) -> list[float]:
    """The S scales to compare, the present one, 1, in the middle; only that without the filter."""
    if settings is None:
        return [1.0]
    half = settings.num_scales // 2
    return [settings.step**power for power in range(-half, half + 1)]


def init(descriptions: Floats) -> Filter:
    """The filter [D, S] that responds with a Gaussian around the middle one of the scales.

    descriptions: [S, D], of the patch at every scale.
    """
    count = len(descriptions)
    desired = np.zeros(count)
    for number in range(count):
        steps = number - count // 2
        desired[number] = np.exp(-((steps / (SIGMA * np.sqrt(count))) ** 2) / 2)
    return filters.train(faded(descriptions), desired)


def estimate(state: Filter, descriptions: Floats) -> float:
    """By how many steps the object has grown: the response's peak, not at the first or last."""
    count = len(descriptions)
    response = np.fft.ifft(filters.response(state, faded(descriptions), RIDGE)).real
    best = 1 + int(np.argmax(response[1:-1]))
    offset = parabola_peak(response[best - 1], response[best], response[best + 1])
    return best - count // 2 + offset


def update(state: Filter, descriptions: Floats, settings: ScaleFilter) -> Filter:
    """The filter after one more frame."""
    return filters.interpolate(state, init(descriptions), settings.learning_rate)


def pull(box: Floats, initial_size: Floats, similarity: float, settings: ScaleFilter) -> float:
    """Steps back to the initial scale: a share of those grown since, the larger the less similar.

    The size is the geometric mean of the sides. box: [4]. initial_size: [2], w, h, pixels.
    """
    grown = np.sqrt(box[2] * box[3] / (initial_size[0] * initial_size[1]))
    steps = np.log(grown) / np.log(settings.step)
    return float(settings.initial_pull * (1 - similarity) * steps)


def resize(
    box: Floats, steps: float, frame_shape: tuple[int, ...], settings: ScaleFilter
) -> Floats:
    """The box [4] so many steps larger around its centre.

    Its shorter side does not shrink below 8 pixels, and none of its sides grows beyond the frame.
    """
    x, y, width, height = box
    factor = settings.step**steps
    least = LEAST_SIDE / min(width, height)
    most = min(frame_shape[1] / width, frame_shape[0] / height)
    factor = min(max(factor, min(least, 1.0)), max(most, 1.0))
    return np.array(
        [
            x + width / 2 - factor * width / 2,
            y + height / 2 - factor * height / 2,
            factor * width,
            factor * height,
        ]
    )


def faded(descriptions: Floats) -> Floats:
    """The features [D, S] of the filter: the descriptions [S, D] faded out to the end scales."""
    return (descriptions * filters.hann(len(descriptions))[:, None]).T
