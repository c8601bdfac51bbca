"""The rotation filter: a circular correlation filter over the angles of the object's patch.

What the scale filter does over scales (`extensions.scale`), this one does over angles: around the
object's middle a rotation is a shift along the angles of a polar grid, and a filter compares all
of them at once. Where the object is recognised by that, the canvas turns with it, so that
classifiers, filters and templates see it as it was in the first frame.

An angle is in radians, by which the object has turned since that frame, positive from the frame's
right to its lower side: clockwise for who looks at the frame.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int32

from dcs_jax.config import Grid, RotationFilter
from dcs_jax.core.search import parabola_peak
from dcs_jax.core.window import sums_before, turned
from dcs_jax.extensions import filters
from dcs_jax.extensions.descriptors import SIDE, describe_patch
from dcs_jax.types import Filter, RotationState

# Angles that are compared, and by how many of them an object that turns may do so in a frame.
ANGLES, MOST = 64, 3
# Rings of the polar grid, in half sides of a square of the object's area.
_RADII = np.linspace(0.2, 1.0, 10)
# Side of the square whose mean is a point of the grid, as a share of the object's shorter side.
_POINT = 1 / 10
# Standard deviation of the desired output, in angles.
_SIGMA = 1.0
# Ridge, as it is, since features are unit vectors.
_RIDGE = 0.01
# A rotation by less makes no difference that could be seen, radians.
_LEAST = math.radians(8)
# Weight of the present frame in the running mean of the gain.
_RATE = 0.2
_ROUNDING = 1e-6


class _Seen(NamedTuple):
    """The object on a canvas that may be turned.

    window: [G_y + 1, G_x + 1], integral image. displacement: [2] of the object, down and right from
    the middle of the window, cells. aspect: height of a cell over its width. initial: [D], the
    initial template. similarity: of the object to it, as the canvas shows it. confidence: of that.
    """

    window: Float[Array, "lines_y lines_x"]
    displacement: Float[Array, "2"]
    aspect: Float[Array, ""]
    initial: Float[Array, " D"]
    similarity: Float[Array, ""]
    confidence: Float[Array, ""]


def init(features: Float[Array, "D angles"]) -> RotationState:
    """The state after the first frame; features: as of `polar`, of the initial box.

    The filter responds at the angle of these features, and is never updated: what it learned of a
    wrong angle would confirm it.
    """
    none = jnp.zeros((), jnp.float32)
    steps = (np.arange(ANGLES) + ANGLES // 2) % ANGLES - ANGLES // 2
    desired = np.fft.rfft(np.exp(-0.5 * np.square(steps / _SIGMA)))
    trained = filters.train(jnp.fft.rfft(features), jnp.asarray(desired, jnp.complex64))
    return RotationState(none, none, trained)


def estimate(
    first_frame: Filter, features: Float[Array, "D angles"], most: int | Int32[Array, ""]
) -> Float[Array, ""]:
    """By how much the object is turned on the canvas: [], radians, within so many of the angles."""
    response = filters.response(first_frame, jnp.fft.rfft(features), _RIDGE)
    response = jnp.fft.irfft(response, n=ANGLES)
    steps = (jnp.arange(ANGLES, dtype=jnp.int32) + ANGLES // 2) % ANGLES - ANGLES // 2
    best = jnp.argmax(jnp.where(jnp.abs(steps) <= most, response, -jnp.inf)).astype(jnp.int32)
    before, here, after = (response[(best + step) % ANGLES] for step in (-1, 0, 1))
    step = steps[best].astype(jnp.float32) + parabola_peak(before, here, after)
    return step * (2 * np.pi / ANGLES)


@jax.named_scope("rotation")
def follow(
    state: RotationState,
    description: Float[Array, " D"],
    initial: Float[Array, " D"],
    confidence: Float[Array, ""],
    window: Float[Array, "lines_y lines_x"],
    displacement: Float[Array, "2"],
    aspect: Float[Array, ""],
    settings: RotationFilter,
    grid: Grid,
) -> RotationState:
    """The state after a frame.

    What turns away from the camera seems to turn in the picture. An object that has turned in it is
    more like its initial template if it is turned back before they are compared: as long as there
    is such a gain, the canvas turns with it.

    description: [D], of the object as the canvas shows it. initial: [D], the template. confidence:
    of the object. window, displacement, aspect: as of `polar`, the canvas turned by the state.
    """

    # Under vmap the tracks take turns, so that for what is upright and known nothing is done.
    @jax.custom_batching.sequential_vmap
    def after(state: RotationState, seen: _Seen, settings: RotationFilter) -> RotationState:
        upright = state.angle == 0

        def compared() -> RotationState:
            most = jnp.where(upright, ANGLES // 2, MOST)
            features = polar(seen.window, seen.displacement, seen.aspect, grid)
            found = estimate(state.first_frame, features, most)
            similarity = _turned_back(seen, jnp.where(upright, found, -state.angle), grid)
            gain = similarity - seen.similarity
            begins = (gain > settings.gain_above) & (similarity > settings.similar_above)
            # One that was turned back already gains as much as it would lose.
            mean_gain = state.gain + _RATE * (-gain - state.gain)
            followed = jnp.where(seen.confidence > settings.follow_above, found, 0)
            turned = jnp.where(mean_gain > settings.gain_below, state.angle + followed, 0)
            angle = jnp.where(upright, jnp.where(begins, found, 0), turned)
            gain = jnp.where(upright, gain, mean_gain)
            return state._replace(angle=(angle + np.pi) % (2 * np.pi) - np.pi, gain=gain)

        # No similarity is above 1: there may be nothing to gain.
        known = upright & (1 - seen.similarity <= settings.gain_above)
        return jax.lax.cond(known, lambda: state, compared)

    similarity = (initial * description).sum()
    seen = _Seen(window, displacement, aspect, initial, similarity, confidence)
    return after(state, seen, settings)


def turn_by(angle: Float[Array, ""], aspect: Float[Array, ""]) -> Float[Array, "2 2"]:
    """What turns a displacement [2], down and right in cells, with the object.

    aspect: height of a cell over its width.
    """
    cosine, sine = jnp.cos(angle), jnp.sin(angle)
    return jnp.stack([jnp.stack([cosine, sine / aspect]), jnp.stack([-sine * aspect, cosine])])


@jax.named_scope("rotation")
def turn_window(
    window: Float[Array, "lines_y lines_x"], angle: Float[Array, ""], turn: Float[Array, "2 2"]
) -> Float[Array, "lines_y lines_x"]:
    """The integral image of a window whose canvas is turned by an angle around its middle.

    Between the middles of cells grey values are interpolated; beyond the window its outermost cells
    are repeated. window: [G_y + 1, G_x + 1], integral image of the window that is not turned. turn:
    [2, 2], as of `turn_by`.
    """

    # Under vmap the tracks take turns, so that those which have not turned are as they are.
    @jax.custom_batching.sequential_vmap
    def if_turned(
        window: Float[Array, "lines_y lines_x"], angle: Float[Array, ""], turn: Float[Array, "2 2"]
    ) -> Float[Array, "lines_y lines_x"]:
        return jax.lax.cond(angle == 0, lambda *_: window, _turned_window, window, turn)

    return if_turned(window, angle, turn)


@jax.named_scope("rotation")
def polar(
    window: Float[Array, "lines_y lines_x"],
    displacement: Float[Array, "2"],
    aspect: Float[Array, ""],
    grid: Grid,
) -> Float[Array, "D angles"]:
    """What the filter sees of the object: gradients on a polar grid around its middle, [D, A].

    Along the radius and across it, each as its positive and its negative part, in roots, less their
    mean over the angles: a unit vector. Beyond the window there is what is at its edge.

    window: [G_y + 1, G_x + 1], integral image. displacement: [2] of the object, down and right from
    the middle of the window, cells. aspect: height of a cell over its width.
    """
    angles = np.arange(ANGLES) * 2 * np.pi / ANGLES
    down, right = (
        jnp.asarray(np.multiply.outer(_RADII, part(angles)), jnp.float32)
        for part in (np.sin, np.cos)
    )
    half = jnp.sqrt(grid.rows * grid.columns / aspect) / 2  # of the square's side, rows
    point = max(1, round(_POINT * min(grid.rows, grid.columns)))
    points = _squares(window, point)
    middle = displacement + (jnp.asarray(points.shape, jnp.float32) - 1) / 2
    means = _between(points, middle[0] + half * down, middle[1] + half * aspect * right)
    step = 2 * np.pi / ANGLES * _RADII[:-1] / (_RADII[1] - _RADII[0])  # from point to point
    across = (jnp.roll(means, -1, axis=1) - jnp.roll(means, 1, axis=1))[:-1] / 2
    across /= jnp.asarray(step, jnp.float32)[:, None]
    along = jnp.diff(means, axis=0)
    parts = jnp.concatenate([along, across, -along, -across])
    roots = jnp.sqrt(jnp.maximum(parts, 0))
    # A ring counts as its circumference.
    roots *= jnp.asarray(np.sqrt(np.tile(_RADII[:-1], 4)), jnp.float32)[:, None]
    roots -= roots.mean(1, keepdims=True)
    return roots / jnp.sqrt(jnp.square(roots).sum() + _ROUNDING)


def hull(box: Float[Array, "4"], angle: Float[Array, ""]) -> Float[Array, "4"]:
    """The box around the ellipse in a box that has turned: [4] x, y, w, h in pixels."""
    x, y, w, h = box
    cosine, sine = jnp.cos(angle), jnp.sin(angle)
    width, height = jnp.hypot(w * cosine, h * sine), jnp.hypot(w * sine, h * cosine)
    return jnp.stack([x + (w - width) / 2, y + (h - height) / 2, width, height])


def _turned_window(
    window: Float[Array, "lines_y lines_x"], turn: Float[Array, "2 2"]
) -> Float[Array, "lines_y lines_x"]:
    cells = jnp.diff(jnp.diff(window, axis=0), axis=1)
    down, right = (jnp.arange(count, dtype=jnp.float32) - (count - 1) / 2 for count in cells.shape)
    down, right = turned(turn, down[:, None], right[None, :])
    rows, columns = cells.shape
    cells = _between(cells, down + (rows - 1) / 2, right + (columns - 1) / 2)
    for _ in range(2):
        cells = sums_before(jnp.pad(cells, ((0, 1), (0, 0)))).T
    return cells


def _turned_back(seen: _Seen, angle: Float[Array, ""], grid: Grid) -> Float[Array, ""]:
    """Similarity of the object turned back by an angle to its initial template: []."""

    def compared() -> Float[Array, ""]:
        description = _describe_turned(
            seen.window, seen.displacement, turn_by(angle, seen.aspect), grid
        )
        return (seen.initial * description).sum()

    return jax.lax.cond(jnp.abs(angle) < _LEAST, lambda: seen.similarity, compared)


def _describe_turned(
    window: Float[Array, "lines_y lines_x"],
    displacement: Float[Array, "2"],
    turn: Float[Array, "2 2"],
    grid: Grid,
) -> Float[Array, " D"]:
    """`descriptors.describe` at its own scale, of the patch turned; beyond the window it is 0."""
    along = jnp.asarray((np.arange(SIDE) + 0.5) / SIDE - 0.5, jnp.float32)
    down, right = turned(turn, grid.rows * along[:, None], grid.columns * along[None, :])
    middle = displacement + (jnp.asarray(window.shape, jnp.float32) - 1) / 2
    down, right = middle[0] + down, middle[1] + right
    height, width = grid.rows / SIDE, grid.columns / SIDE
    below, beside = (
        jnp.asarray(sign, jnp.float32)[:, None, None] for sign in ([1, 1, -1, -1], [1, -1, 1, -1])
    )
    corners = _between(window, down[None] + height / 2 * below, right[None] + width / 2 * beside)
    return describe_patch((below * beside * corners).sum(0) / (height * width))


def _squares(window: Float[Array, "lines_y lines_x"], side: int) -> Float[Array, "rows columns"]:
    """Mean of each square of so many cells on a side."""
    lines = window[side:] - window[:-side]
    return (lines[:, side:] - lines[:, :-side]) / side**2


def _between(
    values: Float[Array, "rows columns"],
    row: Float[Array, "*places"],
    column: Float[Array, "*places"],
) -> Float[Array, "*places"]:
    """Values between whole rows and columns, bilinear; beyond the last ones as there."""
    rows, columns = values.shape
    row, column = jnp.clip(row, 0, rows - 1), jnp.clip(column, 0, columns - 1)
    above = jnp.clip(jnp.floor(row).astype(jnp.int32), 0, rows - 2)
    left = jnp.clip(jnp.floor(column).astype(jnp.int32), 0, columns - 2)
    down, right = row - above.astype(row.dtype), column - left.astype(column.dtype)
    first = above * columns + left
    flat = values.reshape(-1)

    def at(place: Int32[Array, "*places"]) -> Float[Array, "*places"]:
        return flat.at[place].get(mode="promise_in_bounds")

    upper = (1 - right) * at(first) + right * at(first + 1)
    lower = (1 - right) * at(first + columns) + right * at(first + columns + 1)
    return (1 - down) * upper + down * lower
