"""The rotation filter: DSST's filter over scales, over angles; and the canvas that turns with it.

An angle is in radians, clockwise for who looks at the frame.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from . import filters
from .descriptors import SIDE, describe_patch
from .filters import Filter
from .records import Floats, Grid, RotationFilter
from .search import parabola_peak
from .window import turned

ANGLES, MOST = 64, 3  # compared, and those one way that the object may turn in a frame
RINGS, INNERMOST, OUTERMOST = 10, 0.2, 1.0  # radii, in half sides of a square of the object's area
POINT = 0.1  # side of the square that a point of the grid is the mean of, in sides of the object
SIGMA = 1.0  # of the desired output, in angles
RIDGE = 0.01
LEAST = math.radians(8)  # rotation that makes a difference
RATE = 0.2  # of the mean of the gain
LEAST_SQUARE = 1e-6


class RotationState(NamedTuple):
    """By how much the object has turned since the first frame, and the filter of that.

    gain: mean of how much more it is like its initial template turned back.
    """

    angle: float
    gain: float
    first_frame: Filter


def init(features: Floats) -> RotationState:
    """Not turned; the filter responds with a Gaussian around no rotation. features: [D, A]."""
    away = np.minimum(np.arange(ANGLES), ANGLES - np.arange(ANGLES))
    return RotationState(0.0, 0.0, filters.train(features, np.exp(-((away / SIGMA) ** 2) / 2)))


def estimate(trained: Filter, features: Floats, most: int) -> float:
    """By how much more the object has turned: the response's peak within so many angles."""
    response = np.fft.ifft(filters.response(trained, features, RIDGE)).real
    best = max(range(-most, min(most + 1, ANGLES - most)), key=lambda step: response[step])
    offset = parabola_peak(*(response[(best + step) % ANGLES] for step in (-1, 0, 1)))
    return (best + offset) * 2 * np.pi / ANGLES


def follow(
    state: RotationState,
    features: Floats,
    similarity: Callable[[float], float],
    confidence: float,
    settings: RotationFilter,
) -> RotationState:
    """The state after a frame.

    similarity: to the initial template, of the object turned by an angle on the canvas.
    """
    if state.angle == 0:
        if 1 - similarity(0.0) <= settings.gain_above:
            return state
        angle = estimate(state.first_frame, features, ANGLES // 2)
        turned_back = similarity(angle) if abs(angle) >= LEAST else similarity(0.0)
        gain = turned_back - similarity(0.0)
        if gain <= settings.gain_above or turned_back <= settings.similar_above:
            angle = 0.0
    else:
        angle = state.angle
        upright = similarity(-angle) if abs(angle) >= LEAST else similarity(0.0)
        gain = (1 - RATE) * state.gain + RATE * (similarity(0.0) - upright)
        if gain <= settings.gain_below:
            angle = 0.0
        elif confidence > settings.follow_above:
            angle += estimate(state.first_frame, features, MOST)
    return state._replace(angle=(angle + np.pi) % (2 * np.pi) - np.pi, gain=gain)


def turned_cells(cells: Floats, angle: float, aspect: float) -> Floats:
    """The window [Gy, Gx] of a canvas that is turned; beyond it the cells at its edge."""
    middle = (np.array(cells.shape) - 1) / 2
    places = np.zeros((2, *cells.shape))
    for i, j in np.ndindex(cells.shape):
        places[:, i, j] = middle + turned(np.array([i, j]) - middle, angle, aspect)
    return ndimage.map_coordinates(cells, places, order=1, mode="nearest")


def polar(cells: Floats, displacement: Floats, aspect: float, grid: Grid) -> Floats:
    """Gradients along the radius and across it at a displacement [2] of the window: [D, A].

    cells: [Gy, Gx], of the window, beyond which there is what is at its edge.
    """
    radii = np.linspace(INNERMOST, OUTERMOST, RINGS)
    half = np.sqrt(grid.rows * aspect * grid.columns) / 2  # of the square's side, cell widths
    point = max(1, round(POINT * min(grid.rows, grid.columns)))
    farthest = (np.array(cells.shape) - point) / 2
    means = np.zeros((RINGS, ANGLES))
    for ring, number in np.ndindex(means.shape):
        angle = number * 2 * np.pi / ANGLES
        down = radii[ring] * half * np.sin(angle) / aspect
        across = radii[ring] * half * np.cos(angle)
        place = np.clip(displacement + np.array([down, across]), -farthest, farthest)
        means[ring, number] = mean_of(cells, place, (point, point))
    channels: list[list[Floats]] = [[], [], [], []]
    for ring in range(RINGS - 1):
        along = means[ring + 1] - means[ring]
        between = (np.roll(means[ring], -1) - np.roll(means[ring], 1)) / 2
        across = between * (radii[1] - radii[0]) / (radii[ring] * 2 * np.pi / ANGLES)
        for channel, part in zip(channels, (along, across, -along, -across), strict=True):
            root = np.sqrt(np.maximum(part, 0) * radii[ring])
            channel.append(root - root.mean())
    features = np.array([ring for channel in channels for ring in channel])
    return features / np.sqrt((features**2).sum() + LEAST_SQUARE)


def describe_turned(
    cells: Floats, displacement: Floats, angle: float, aspect: float, grid: Grid
) -> Floats:
    """`descriptors.describe` at the present scale of the patch turned by an angle: [D]."""
    patch = np.zeros((SIDE, SIDE))
    sides = grid.rows / SIDE, grid.columns / SIDE
    for i, j in np.ndindex(patch.shape):
        upright = [(i + 0.5 - SIDE / 2) * sides[0], (j + 0.5 - SIDE / 2) * sides[1]]
        place = displacement + turned(np.array(upright), angle, aspect)
        patch[i, j] = mean_of(cells, place, sides)
    return describe_patch(patch)


def hull(box: Floats, angle: float) -> Floats:
    """The box [4] around the ellipse in a box that is turned, from points on it."""
    x, y, width, height = box
    around = np.linspace(0, 2 * np.pi, 10001)
    across, down = np.cos(around) * width / 2, np.sin(around) * height / 2
    ys, xs = (
        np.cos(angle) * down + np.sin(angle) * across,
        np.cos(angle) * across - np.sin(angle) * down,
    )
    centre = np.array([x + width / 2, y + height / 2])
    half = np.array([xs.max(), ys.max()])
    return np.concatenate([centre - half, 2 * half])


def mean_of(cells: Floats, place: Floats, sides: tuple[float, float]) -> float:
    """Mean of a rectangle around a place [2] in the window [Gy, Gx], beyond which there is 0.

    place: down and across from the window's middle, cells. sides: height and width, cells.
    """
    shares = []
    for length, middle, side in zip(cells.shape, place, sides, strict=True):
        low = length / 2 + middle - side / 2
        first = np.arange(length)
        shared = np.minimum(low + side, first + 1) - np.maximum(low, first)
        shares.append(np.maximum(shared, 0) / side)
    return float(shares[0] @ cells @ shares[1])
