"""What the object looks like, and whether that is what is seen now.

The votes of the weak classifiers say where in a window the object most likely is, not whether it is
there at all: the best place of any window has a Noisy-OR near 1. So the patch at the chosen place
is compared with the object's first appearance, and with its recent one.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from dcs_jax.config import Config
from dcs_jax.extensions.gradients import gradient_cells
from dcs_jax.types import Appearance

# A patch is resampled to 32 x 32 places, in cells of 4 x 4.
PLACES, _CELL = 32, 4
_ROUNDING = 1e-6


def describe(
    integral: Float[Array, "lines_y lines_x"], displacement: Float[Array, "2"], config: Config
) -> Float[Array, "S D"]:
    """Descriptions of the object's patch at a place, in S sizes, the middle one its own: [S, D].

    integral: [G_y + 1, G_x + 1], of a window. displacement: [2] down and right from the middle of
    the window, cells. The patch is resampled from the window's integral image by exact area means.
    """
    grid = config.grid
    factors = config.size_step ** (np.arange(config.sizes) - config.sizes // 2.0)
    sides = np.array([grid.rows, grid.columns])
    lines = np.array(integral.shape)
    # Only these lines of the integral image can be needed.
    near = np.minimum(np.ceil(sides * factors.max()).astype(int) + 2, lines)
    middle = displacement + jnp.asarray(lines - 1, jnp.float32) / 2
    first = jnp.floor(middle - jnp.asarray(near - 2, jnp.float32) / 2).astype(jnp.int32)
    first = jnp.clip(first, 0, jnp.asarray(lines - near, jnp.int32))
    part = jax.lax.dynamic_slice(integral, first, near)
    along = factors[:, None] * (np.arange(PLACES + 1) / PLACES - 0.5)

    def between(axis: int) -> Float[Array, "S places near"]:
        """What each line counts for the difference between two lines of the patch."""
        line = middle[axis] + jnp.asarray(sides[axis] * along, jnp.float32)
        line = jnp.clip(line, 0, float(lines[axis] - 1)) - first[axis].astype(jnp.float32)
        away = jnp.abs(line[..., None] - jnp.arange(near[axis], dtype=jnp.float32))
        return jnp.diff(jnp.maximum(1 - away, 0), axis=1)

    sums = jnp.einsum("syg,gh->syh", between(0), part)
    means = jnp.einsum("syh,sxh->syx", sums, between(1))
    cells = sides.prod() * np.square(factors / PLACES)
    return jax.vmap(_describe)(means / jnp.asarray(cells, jnp.float32)[:, None, None])


def _describe(patch: Float[Array, "places places"]) -> Float[Array, " D"]:
    cells = gradient_cells(patch, _CELL).reshape(-1)
    cells -= cells.mean()
    return cells / jnp.sqrt(jnp.square(cells).sum() + _ROUNDING)


def similarity(
    seen: Appearance, description: Float[Array, " D"], config: Config
) -> Float[Array, ""]:
    """How alike a patch is to the object as it was at first or is of late: [] in [-1, 1].

    The cosine to the first description, or that to the recent one less `recent_penalty`: the
    recent one may have drifted.
    """
    recent = seen.recent / jnp.sqrt(jnp.square(seen.recent).sum() + _ROUNDING)
    return jnp.maximum(
        (seen.first * description).sum(), (recent * description).sum() - config.recent_penalty
    )


def confidence(similarity: Float[Array, ""], config: Config) -> Float[Array, ""]:
    """The probability that the box overlaps the object by more than half: [] in [0, 1].

    A logistic function of the similarity, set from labelled tracks (see `Config`).
    """
    return jax.nn.sigmoid(config.confidence_slope * (similarity - config.confidence_middle))


def remember(seen: Appearance, description: Float[Array, " D"], config: Config) -> Appearance:
    """The appearance after one more frame in which the object was seen."""
    return seen._replace(recent=seen.recent + config.recent_rate * (description - seen.recent))
