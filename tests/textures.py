"""Windows of random texture, and frames that turn, which tests share."""

import cv2
import jax
import jax.numpy as jnp
import numpy as np
import reference
from scipy import ndimage

from dcs_jax.config import Grid


def texture(
    grid: Grid,
    seed: int,
    zoom: float | tuple[float, float] = 1.0,
    shift: tuple[int, int] = (0, 0),
) -> np.ndarray:
    """Soft random cells of a window [Gy, Gx], enlarged around the middle or moved.

    zoom: of both sides, or of height and width.
    """
    cells = ndimage.gaussian_filter(np.random.default_rng(seed).normal(size=(200, 200)), 1.5) * 200
    rows, columns = grid.window
    of_height, of_width = zoom if isinstance(zoom, tuple) else (zoom, zoom)
    down = (np.arange(rows) - (rows - 1) / 2) / of_height + 100 - shift[0]
    across = (np.arange(columns) - (columns - 1) / 2) / of_width + 100 - shift[1]
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


def enlarged(frame: np.ndarray, box: np.ndarray, factor: float) -> np.ndarray:
    """The frame, enlarged around the middle of a box."""
    x, y, w, h = (float(number) for number in box)
    middle = x + (w - 1) / 2, y + (h - 1) / 2
    around = cv2.getRotationMatrix2D(middle, 0.0, factor)
    return cv2.warpAffine(frame, around, frame.shape[1::-1], borderMode=cv2.BORDER_REPLICATE)


def narrowed_frames(frame: np.ndarray, box: np.ndarray, widths: np.ndarray) -> np.ndarray:
    """The frame as narrow as each of the widths says, relative to its own, and as much higher.

    Around the middle of the box. widths: [T]. Returns [T, H, W, ...].
    """
    x, y, w, h = (float(number) for number in box)
    x, y = x + (w - 1) / 2, y + (h - 1) / 2
    return np.stack(
        [
            cv2.warpAffine(
                frame,
                np.array([[width, 0, x * (1 - width)], [0, 1 / width, y * (1 - 1 / width)]]),
                frame.shape[1::-1],
                borderMode=cv2.BORDER_REPLICATE,
            )
            for width in widths
        ]
    )


def integral(cells: np.ndarray) -> jax.Array:
    return jnp.asarray(reference.integral(cells), jnp.float32)
