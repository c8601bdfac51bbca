"""Windows of random texture that tests of the extensions share."""

import jax
import jax.numpy as jnp
import numpy as np
import reference
from scipy import ndimage

from dcs_jax.config import Grid


def texture(
    grid: Grid, seed: int, zoom: float = 1.0, shift: tuple[int, int] = (0, 0)
) -> np.ndarray:
    """Soft random cells of a window [Gy, Gx], enlarged around the middle or moved."""
    cells = ndimage.gaussian_filter(np.random.default_rng(seed).normal(size=(200, 200)), 1.5) * 200
    rows, columns = grid.window
    down = (np.arange(rows) - (rows - 1) / 2) / zoom + 100 - shift[0]
    across = (np.arange(columns) - (columns - 1) / 2) / zoom + 100 - shift[1]
    return ndimage.map_coordinates(cells, np.meshgrid(down, across, indexing="ij"), order=3)


def integral(cells: np.ndarray) -> jax.Array:
    return jnp.asarray(reference.integral(cells), jnp.float32)
