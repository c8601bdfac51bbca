"""Settings and records of the reference, with the names of `dcs_jax.config` and `dcs_jax.types`.

Dimensions, used in every docstring of the reference:

    H, W    rows and columns of a frame, pixels
    Sy, Sx  rows and columns of the canvas, the cells of the object
    my, mx  rows and columns of the window's margin on each side of the object, cells
    Gy, Gx  = Sy + 2 my, Sx + 2 mx, rows and columns of the window, cells
    Cy, Cx  = 2 my + 1, 2 mx + 1, rows and columns of the map of candidate positions
    K       parts of the object
    N       selectors per part
    M       weak classifiers in a selector's pool
    F       = K N M, all features; feature f belongs to part f // (N M), selector (f // M) % N
    L       = 8, training samples of a frame
    S       scales of the object
    D       values of a description
"""

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

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


class Maps(NamedTuple):
    """What the search looks at, for every candidate position.

    probabilities: [K, Cy, Cx], of the parts, smoothed. score_map: [Cy, Cx], of their Noisy-OR.
    scores: [Cy, Cx], with all cues and less the motion prior, minus infinity where it cannot be.
    """

    probabilities: Floats
    score_map: Floats
    scores: Floats


class Candidate(NamedTuple):
    """Where in a frame the object may be: box [4], description [D], the rest as in `StepInfo`.

    confidence: by the similarity alone. responses: of the translation filter, NaN without.
    rotation: the state after it, None without.
    """

    box: Floats
    confidence: float
    noisy_or: float
    part_scores: Floats
    description: Floats
    responses: float
    rotation: Any  # `rotation.RotationState`, whose module needs this one


class StepInfo(NamedTuple):
    """What one frame yields.

    box: [4], x, y, w, h, pixels. confidence: in [0, 1], NaN without verification. noisy_or,
    part_scores: [] and [K], in [0, 1] to rounding. lost: False without verification. noise: [5], of
    the selection, 0 if it is not "l1" or the frame is not learned from.
    """

    box: Floats
    confidence: float
    noisy_or: float
    part_scores: Floats
    lost: bool
    noise: Floats


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
        """Cy, Cx: candidate positions per axis; the middle one is no motion."""
        return 2 * self.margin_rows + 1, 2 * self.margin_columns + 1


@dataclass(frozen=True, kw_only=True)
class TranslationFilter:
    """weight: of the response. first_frame: weight of that frame's filter in it.

    learned_factor: side of what is learned, in object sides.
    """

    weight: float
    learning_rate: float
    first_frame: float
    window_factor: float
    learned_factor: float


@dataclass(frozen=True, kw_only=True)
class ColourHistograms:
    """weight: of the mean probability of being object."""

    weight: float
    learning_rate: float


@dataclass(frozen=True, kw_only=True)
class ScaleFilter:
    """num_scales: S, odd. step: ratio of a scale to the next smaller one."""

    num_scales: int
    step: float
    learning_rate: float
    initial_pull: float


@dataclass(frozen=True, kw_only=True)
class Verification:
    """middle, slope: of the logistic function, also with the responses of the translation filter.

    The others are shares, the last two frames.
    """

    middle: float
    slope: float
    response_middle: float
    response_slope: float
    template_rate: float
    recent_rate: float
    template_penalty: float
    learn_above: float
    sure_above: float
    lost_below: float
    rest_above: float
    recover_above: float
    learn_every: int
    patience: int


@dataclass(frozen=True, kw_only=True)
class RotationFilter:
    """similar_above, gain_above: what an object that is upright needs to count as turned."""

    similar_above: float
    gain_above: float
    gain_below: float
    follow_above: float


@dataclass(frozen=True, kw_only=True)
class AspectRatio:
    """similar_above, gain_above: what another aspect ratio than the first one needs."""

    similar_above: float
    gain_above: float
    cost: float


@dataclass(frozen=True, kw_only=True)
class Redetection:
    """windows: further search windows in a frame."""

    windows: int
    accept_above: float


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What one run is set to: the fields of `dcs_jax.config.Config`, which says what they mean.

    canvas: cells per side of the object, or (rows, columns). translation, colour, scale,
    verification, redetection, rotation, aspect: None where the component is switched off.
    initial_size: w and h of the first box of a track, pixels; None: those of the box asked for.
    """

    canvas: int | tuple[int, int]
    window_factor: float
    parts: Literal[1, 5, 9]
    selectors: int
    pool_size: int
    selector: Literal["l1", "error", "first", "mil"]
    tie: Literal["first", "error"]
    weak: Literal["midpoint", "gaussian"]
    iterations: int
    first_updates: int
    squareness: float
    lam: float
    smoothing: float
    overhang: float
    prior: float
    output_size: Literal["estimated", "initial"]
    translation: TranslationFilter | None
    colour: ColourHistograms | None
    scale: ScaleFilter | None
    verification: Verification | None
    redetection: Redetection | None
    rotation: RotationFilter | None
    aspect: AspectRatio | None
    initial_size: tuple[float, float] | None = None

    @property
    def grid(self) -> Grid:
        """The cells of object and window: of what the translation filter sees if that is more."""
        if self.translation is None:
            return self.search_grid
        return self.with_window(max(self.window_factor, self.translation.window_factor))

    @property
    def search_grid(self) -> Grid:
        """The cells of object and search window, where the classifiers vote."""
        return self.with_window(self.window_factor)

    def with_window(self, window_factor: float) -> Grid:
        """The cells of the object and of a window of so many of its sides."""
        rows, columns = (self.canvas,) * 2 if isinstance(self.canvas, int) else self.canvas
        return Grid(
            rows,
            columns,
            margin_rows=round(rows * (window_factor - 1) / 2),
            margin_columns=round(columns * (window_factor - 1) / 2),
        )
