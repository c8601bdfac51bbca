"""A patch of the window as a unit vector: what the scale filter and the verification compare."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from dcs_jax.config import Grid
from dcs_jax.extensions.gradients import gradient_cells

# A patch is resampled to 32 x 32 pixels, in cells of 4 x 4.
SIDE, _CELL = 32, 4
_ROUNDING = 1e-6


@jax.named_scope("descriptions")
def describe(
    integral: Float[Array, "lines_y lines_x"],
    displacement: Float[Array, "2"],
    factors: np.ndarray | Float[Array, "S 2"],
    grid: Grid,
    most: float | None = None,
) -> Float[Array, "S D"]:
    """Descriptions of the object's patch at a position, in S sizes: [S, D].

    The patch is resampled from the window's integral image by exact area means. Beyond the window
    it has the grey value of the pixel at the centre of the window's box.

    integral: [G_y + 1, G_x + 1], of a window. displacement: [2] down and right from the middle of
    the window, cells. factors: [S, 2], height and width relative to the object's. most: the largest
    one of them or more, which has to be said of traced ones.
    """
    sides = np.array([grid.rows, grid.columns])
    lines = np.array(integral.shape)
    if most is None:
        most = float(np.max(factors))
    # Only these lines of the integral image can be needed.
    near = np.minimum(np.ceil(sides * most).astype(int) + 2, lines)
    middle = displacement + jnp.asarray(lines - 1, jnp.float32) / 2
    first = jnp.floor(middle - jnp.asarray(near - 2, jnp.float32) / 2).astype(jnp.int32)
    first = jnp.clip(first, 0, jnp.asarray(lines - near, jnp.int32))
    part = jax.lax.dynamic_slice(integral, first, near)
    factors = jnp.asarray(factors, jnp.float32)
    along = jnp.asarray(np.arange(SIDE + 1) / SIDE - 0.5, jnp.float32)

    def between(axis: int) -> Float[Array, "S side near"]:
        """What each line counts for the difference between two lines of the patch."""
        line = middle[axis] + float(sides[axis]) * factors[:, axis, None] * along[None]
        line = jnp.clip(line, 0, float(lines[axis] - 1)) - first[axis].astype(jnp.float32)
        away = jnp.abs(line[..., None] - jnp.arange(near[axis], dtype=jnp.float32)[None, None])
        return jnp.diff(jnp.maximum(1 - away, 0), axis=1)

    sums = jnp.einsum("syg,gh->syh", between(0), part)
    means = jnp.einsum("syh,sxh->syx", sums, between(1))
    cells = float(sides.prod() / SIDE**2) * factors.prod(1)
    return jax.vmap(describe_patch)(means / cells[:, None, None])


def describe_patch(patch: Float[Array, "side side"]) -> Float[Array, " D"]:
    """The description of a patch that is resampled already, of 32 x 32 grey values: [D]."""
    cells = gradient_cells(patch, _CELL)
    # Of each orientation: where one prevails, as in a narrow box, all patches would look alike.
    cells -= cells.mean((1, 2), keepdims=True)
    cells = cells.reshape(-1)
    return cells / jnp.sqrt(jnp.square(cells).sum() + _ROUNDING)
