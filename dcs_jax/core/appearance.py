"""What the object looks like, and whether that is what is seen now.

The votes of the weak classifiers say where in a window the object most likely is, not whether it is
there at all: the best place of any window has a Noisy-OR near 1. So the patch at the chosen place
is compared with the object's first appearance, and with its recent one.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from dcs_jax.config import Config
from dcs_jax.core.gradients import gradient_cells
from dcs_jax.types import Appearance

# A patch is resampled to 32 x 32 places, in cells of 4 x 4.
PLACES, _CELL = 32, 4
_ROUNDING = 1e-6


def size_factors(config: Config) -> Float[Array, " S"]:
    """The sizes that are looked at, in units of the last one: [S], the middle one is 1."""
    steps = jnp.arange(config.sizes, dtype=jnp.float32) - config.sizes // 2
    return jnp.exp(steps * jnp.log(jnp.asarray(config.size_step, jnp.float32)))


def describe_sizes(
    integral: Float[Array, "lines_y lines_x"], displacement: Float[Array, "2"], config: Config
) -> Float[Array, "S D"]:
    """Descriptions of the object's patch at a place, in S sizes: [S, D].

    integral: [G_y + 1, G_x + 1], of a window. displacement: [2] down and right from the middle of
    the window, cells. The patch is resampled from the window's integral image by exact area means.
    """
    grid = config.grid
    along = jnp.arange(PLACES + 1, dtype=jnp.float32) / PLACES - 0.5
    factors = size_factors(config)

    def lines(middle: Float[Array, ""], side: int, last: int) -> Float[Array, "S places last"]:
        """Weights of the integral image's lines at the patch's: [S, places + 1, lines]."""
        line = jnp.clip(middle + factors[:, None] * (side * along), 0, last - 1)
        return jnp.maximum(1 - jnp.abs(line[..., None] - jnp.arange(last, dtype=jnp.float32)), 0)

    middle = displacement + jnp.array(grid.window, jnp.float32) / 2
    rows = lines(middle[0], grid.rows, integral.shape[0])
    columns = lines(middle[1], grid.columns, integral.shape[1])
    sums = jnp.einsum("syg,gh,sxh->syx", rows, integral, columns)
    means = jnp.diff(jnp.diff(sums, axis=1), axis=2)
    means *= (PLACES**2 / (grid.rows * grid.columns)) / jnp.square(factors)[:, None, None]
    return jax.vmap(_describe)(means)


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
