"""Windows of random texture, and frames that turn, which tests share."""

import cv2
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


def turned_frames(frame: np.ndarray, box: np.ndarray, degrees: float, length: int) -> np.ndarray:
    """The frame, turned clockwise around a box by so many degrees a frame: [length, H, W, ...]."""
    x, y, w, h = (float(number) for number in box)
    middle = x + (w - 1) / 2, y + (h - 1) / 2
    return np.stack(
        [
            cv2.warpAffine(
                frame,
                cv2.getRotationMatrix2D(middle, -degrees * number, 1.0),
                frame.shape[1::-1],
                borderMode=cv2.BORDER_REPLICATE,
            )
            for number in range(length)
        ]
    )


def integral(cells: np.ndarray) -> jax.Array:
    return jnp.asarray(reference.integral(cells), jnp.float32)
