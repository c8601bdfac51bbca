"""Colour: one more cue of where in the search window the object is.

Two histograms, of the object's colours and of those around it, say of each pixel how likely it is
object (Possegger et al., "In Defense of Color-Based Model-Free Tracking", CVPR 2015). The mean over
the box, at every displacement, is added to the score (Bertinetto et al., "Staple: Complementary
Learners for Real-Time Tracking", CVPR 2016): an object that deforms loses its edges, which the
classifiers and the translation filter know it by, and keeps its colours.
"""

import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int32, UInt8

from dcs_jax.config import ColourHistograms, Config, Grid
from dcs_jax.core.window import ColumnSums, Placed, VideoFrame, window_colours
from dcs_jax.extensions import filters
from dcs_jax.types import ColourState, Scalar

# Bins for the brightness, and for each of two differences of channels. Differences are taken up to
# this, as few pixels of a video have larger ones: the bins are then finer than those of a channel.
_BINS = 16
_LARGEST_DIFFERENCE = 64
# Added to both frequencies: a colour that neither has is as likely object as background.
_UNSEEN = 1e-4
# Sides of what counts as object and of what does not as background, in sides of the box: few
# objects fill theirs. Background is what surrounds the box up to so many sides of the canvas.
_OBJECT, _NEAR, _AROUND = 0.8, 1.1, 2.5
# The cue counts in full from this mean difference of the largest and the smallest channel, grey
# values. In a grey video it would be one more of the brightness, which earned nothing.
_COLOURFUL = 8.0


def init(colours: UInt8[Array, "Y X 3"] | None, placed: Placed, config: Config) -> ColourState:
    """The histograms of the first frame; colours: of the window around the box, or None."""
    if colours is None:
        nothing = jnp.zeros(_BINS**3, jnp.float32)
        return ColourState(nothing, nothing, jnp.zeros((), jnp.float32))
    difference = (colours.max(2) - colours.min(2)).astype(jnp.float32).mean()
    inside, outside = _histograms(colours, placed, config)
    return ColourState(inside, outside, jnp.minimum(difference / _COLOURFUL, 1))


def look(
    frame: VideoFrame | ColumnSums,
    box: Float[Array, "4"],
    grid: Grid,
    turn: Float[Array, "2 2"] | None = None,
) -> UInt8[Array, "Y X 3"] | None:
    """What the cue sees around a box as the canvas shows it, or None in a video without colour.

    turn: [2, 2], how the canvas is turned (`extensions.rotation`).
    """
    return window_colours(frame, box, grid, _side(grid), turn)


@jax.named_scope("colour")
def respond(
    state: ColourState, colours: UInt8[Array, "Y X 3"], settings: ColourHistograms
) -> Float[Array, "Y X"]:
    """How likely each pixel of a window is one of the object, by its colour alone, weighted."""
    inside, outside = state.inside + _UNSEEN, state.outside + _UNSEEN
    weight = settings.weight * state.colourful
    return (weight * inside / (inside + outside))[_bins(colours)]


@jax.named_scope("colour")
def score(
    response: Float[Array, "Y X"],
    placed: Placed,
    config: Config,
    down: Float[Array, " rows"],
    right: Float[Array, " columns"],
) -> Float[Array, "rows columns"]:
    """What the cue adds to the score: the mean response over the inner part of the box.

    response: as of `respond`, in the window around the box. down, right: displacements, cells.
    """
    height, width = _half_sides(placed, config.grid)
    rows, columns = response.shape
    over_rows = _cover(rows, _OBJECT * height, down / _side(config.grid))
    over_columns = _cover(columns, _OBJECT * width, right / _side(config.grid))
    area = over_rows.sum(1)[:, None] * over_columns.sum(1)[None]
    # Without a transposition: XLA would fuse it in some programs only, and round otherwise there.
    sums = jnp.einsum("ny,yx->nx", over_rows, response)
    return jnp.einsum("nx,mx->nm", sums, over_columns) / area


@jax.named_scope("colour")
def update(
    state: ColourState,
    colours: UInt8[Array, "Y X 3"],
    settings: ColourHistograms,
    placed: Placed,
    config: Config,
) -> ColourState:
    """The running means after one more frame; colours: of the window around the new box."""
    inside, outside = _histograms(colours, placed, config)
    seen = ColourState(inside, outside, state.colourful)
    return filters.interpolate(state, seen, settings.learning_rate)


def _histograms(
    colours: UInt8[Array, "Y X 3"], placed: Placed, config: Config
) -> Float[Array, "2 bins"]:
    """How frequent each colour is in the object and around it: [2, bins], each with the sum 1."""
    # Nothing further away counts in either.
    grid = config.grid
    far = [_AROUND * cells / _side(grid) / 2 for cells in (grid.rows, grid.columns)]
    rows, columns = (
        min(count, count % 2 + 2 * math.ceil(half))
        for count, half in zip(colours.shape[:2], far, strict=True)
    )
    top, left = (colours.shape[0] - rows) // 2, (colours.shape[1] - columns) // 2
    colours = colours[top : top + rows, left : left + columns]

    def cover(height: Scalar, width: Scalar) -> Float[Array, "rows columns"]:
        here = jnp.zeros(1, jnp.float32)
        over_rows, over_columns = _cover(rows, height, here), _cover(columns, width, here)
        return over_rows.T * over_columns

    height, width = _half_sides(placed, config.grid)
    inside = cover(_OBJECT * height, _OBJECT * width)
    near = jnp.minimum(_NEAR * height, far[0]), jnp.minimum(_NEAR * width, far[1])
    weights = jnp.stack([inside, cover(*far) - cover(*near)]).reshape(2, -1)
    # Both at once: a pixel counts in the same bin of the two, and its place is computed once.
    sums = jnp.zeros((_BINS**3, 2), jnp.float32).at[_bins(colours).reshape(-1)].add(weights.T)
    return sums.T / jnp.maximum(weights.sum(1, keepdims=True), 1)


def _bins(colours: UInt8[Array, "Y X 3"]) -> Int32[Array, "Y X"]:
    """The number of the bin of each colour: brightness, red - green and yellow - blue."""
    red, green, blue = jnp.moveaxis(colours.astype(jnp.int32), -1, 0)
    width = 2 * _LARGEST_DIFFERENCE // _BINS
    number = (red + green + blue) * _BINS // (3 * 256)
    for difference in (red - green, (red + green - 2 * blue) // 2):
        number = number * _BINS + jnp.clip(difference // width + _BINS // 2, 0, _BINS - 1)
    return number


def _side(grid: Grid) -> int:
    """Cells on a side of the blocks of which one pixel is read."""
    return 2 if grid.rows % 2 == 0 and grid.columns % 2 == 0 else 1


def _half_sides(placed: Placed, grid: Grid) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Half the height and half the width of the box, in pixels that are read."""
    box, shown = placed
    height, width = box[3] / shown[3] * grid.rows, box[2] / shown[2] * grid.columns
    return height / (2 * _side(grid)), width / (2 * _side(grid))


def _cover(count: int, half: Scalar, displacement: Float[Array, " n"]) -> Float[Array, "n count"]:
    """How much of each pixel on a line a side covers that is displaced from the middle: [0, 1].

    At least as much as one pixel is covered.
    """
    place = jnp.asarray(np.arange(count) - (count - 1) / 2, jnp.float32)
    away = jnp.abs(place[None] - displacement[:, None])
    return jnp.clip(jnp.maximum(half, 0.5) + 0.5 - away, 0, 1)
