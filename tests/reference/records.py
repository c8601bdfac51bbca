"""Settings and records of the reference, with the names of `dcs_jax.config` and `dcs_jax.types`.

Dimensions, used in every docstring of the reference:

    H, W    rows and columns of a frame, pixels
    Sy, Sx  rows and columns of the canvas, the cells of the object
    my, mx  rows and columns of the window's margin on each side of the object, cells
    Gy, Gx  = Sy + 2 my, Sx + 2 mx, rows and columns of the window, cells
    Cy, Cx  = 2 my + 1, 2 mx + 1, rows and columns of the map of candidate places
    K       parts of the object
    N       selectors per part
    M       weak classifiers in a selector's pool
    F       = K N M, all features; feature f belongs to part f // (N M), selector (f // M) % N
    L       = 8, training rows of a frame
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class Pool(NamedTuple):
    """The Haar-like features, each a weighted sum of at most 9 corners of an integral image.

    corners: [F, 9], flat row-major index into the (Sy + 1) x (Sx + 1) integral image of a patch.
    weights: [F, 9], weight of each corner, 0 where it is unused.
    boxes: [F], number of boxes the feature compares.
    """

    corners: Integers
    weights: Floats
    boxes: Integers


@dataclass(frozen=True)
class Grid:
    """Cells of the object (rows x columns) and of the window's margin on each side of it."""

    rows: int
    columns: int
    margin_rows: int
    margin_columns: int

    @property
    def window(self) -> tuple[int, int]:
        """Gy, Gx: rows and columns of the window, cells."""
        return self.rows + 2 * self.margin_rows, self.columns + 2 * self.margin_columns

    @property
    def positions(self) -> tuple[int, int]:
        """Cy, Cx: candidate places per axis; the middle one is no motion."""
        return 2 * self.margin_rows + 1, 2 * self.margin_columns + 1


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What one run is set to. The fields mean what they mean in `dcs_jax.config.Config`.

    canvas: cells per side of the object, or (rows, columns).
    slack: fraction of the object's side that may leave the frame, 0: none.
    """

    canvas: int | tuple[int, int] = 40
    window_factor: float = 2.0
    parts: Literal[1, 5, 9] = 9
    selectors: int = 40
    pool_size: int = 50
    selector: Literal["l1", "error", "first", "mil"] = "l1"
    weak: Literal["midpoint", "gaussian"] = "midpoint"
    iterations: int = 10
    first_updates: int = 50
    lam: float = 0.01
    smoothing: float = 1.5
    prior: float = 0.6
    slack: float = 0.0

    @property
    def grid(self) -> Grid:
        """The cells of object and window."""
        rows, columns = (self.canvas,) * 2 if isinstance(self.canvas, int) else self.canvas
        return Grid(
            rows,
            columns,
            margin_rows=round(rows * (self.window_factor - 1) / 2),
            margin_columns=round(columns * (self.window_factor - 1) / 2),
        )
