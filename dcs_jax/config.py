"""The settings of a track, checked when they are made."""

import dataclasses
import math
from typing import Any, Literal

import jax
import numpy as np

from dcs_jax.types import BoxLike

Selector = Literal["l1", "error", "mil", "first"]
TieRule = Literal["first", "error"]
WeakRule = Literal["midpoint", "gaussian"]


def _static(default: Any) -> Any:
    """A field that defines shapes or chooses code: part of what is compiled."""
    return dataclasses.field(default=default, metadata={"static": True})


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True, kw_only=True)
class Config:
    """Settings of the tracker. `Config()` is the recommended preset, `Config.paper()` the paper's.

    A pytree: the numbers are its leaves, so changing one compiles nothing and an array of them can
    be vmapped over; the other fields are static. `dataclasses.replace` changes fields.

    Static fields:
        canvas: cells per side of the object, whatever its size in pixels, or (rows, columns); or
            "native", one cell a pixel of the given box (the paper's setting, compiled anew for
            every size of box).
        window_factor: side of the search window in object sides, above 1.
        window_minimum: the least side of the search window in pixels (the paper: 100).
        parts: 1 (the whole object), 5 (and its halves, the paper's) or 9 (and its quadrants).
        selectors: N, the weak classifiers a strong part classifier adds up.
        pool_size: M, the weak classifiers each selector chooses from.
        selector: how it chooses: "l1" by non-negative l1 minimisation with label noise (the paper's
            "w/ l1"), "error" by the least accumulated error ("w/o l1"), "mil" by the bag likelihood
            (Babenko et al., CVPR 2009), "first" as the first without error in this frame.
        tie: which of several equally good classifiers "l1" takes: "first", the first one of the
            pool, or "error", the one of least accumulated error, with which the target is lost.
        weak: how a weak classifier decides: "midpoint" by the nearer class mean, "gaussian" by the
            likelier class (eq. 16).
        iterations: accelerated proximal gradient steps of the "l1" selector.
        first_updates: updates on the rows of the first frame.
        extras: what the paper does not have: a correlation filter as one more witness of the
            place, the object's size, recognition of the object, with which a track learns only
            where it is recognised, says when it is lost, and finds it again.
        scale: whether the box follows the size of the object, its aspect ratio kept. False: the box
            keeps its given size, around the object's middle (the search follows its size all the
            same). Without extras it has no effect.
        sizes: S, how many sizes are looked at in a frame, an odd number.
        size_step: ratio of one of them to the next, above 1.

    Numbers:
        block: the largest base block of a feature, in sides of its part, above 0 and at most 1 (the
            paper's code: 1/5, on some sequences 1).
        lam: weight lambda of the l1 penalty (eq. 14), not negative.
        smoothing: standard deviation of the 3x3 Gaussian that smooths the maps, in cells; 0: none.
        overhang: how far the box may move out of the frame, in sides of the object, not negative;
            0: not at all, as the paper's window, which is clipped to the frame.
        prior: what a displacement of d costs, prior * d^2 / (w h), on the scale of
            -log(1 - Noisy-OR); 0: every place in the window is as likely (the paper's setting).
        place_weight: what the place filter's answer, about 1 where it is sure, adds on that scale.
        place_rate, size_rate: share of the present frame in the filters, in [0, 1].
        anchor: share of the first frame's place filter in the answer, in [0, 1].
        size_pull: how strongly the size is drawn to that of the given box: the share of the
            distance, of logarithms, that is taken back in a frame in which the object is not alike
            at all; in [0, 1].
        recent_penalty: how much less the likeness to the recent appearance counts, a cosine.
        recent_rate: share of the present frame in the recent appearance, in [0, 1].
        confidence_middle, confidence_slope: confidence is
            1 / (1 + exp(-slope (similarity - middle))). Set from tracks of seven labelled sequences
            and variants of them: of the boxes that overlap the object by more than half nine in ten
            have a similarity to its first appearance above 0.2, of the others one in ten has one
            above 0.4.
        learn_above: the confidence above which a frame is learned from, and the size followed.
        lost_below, patience: the object is lost after so many frames below this confidence.
        found_above: the confidence above which a lost object is found at its own place, and one
            that was missed in the last frame elsewhere.

    Raises ValueError where a value is out of its range.
    """

    canvas: int | tuple[int, int] | Literal["native"] = _static(40)
    window_factor: float = _static(2.5)
    window_minimum: float = _static(0.0)
    parts: Literal[1, 5, 9] = _static(9)
    selectors: int = _static(40)
    pool_size: int = _static(50)
    selector: Selector = _static("l1")
    tie: TieRule = _static("first")
    weak: WeakRule = _static("midpoint")
    iterations: int = _static(10)
    first_updates: int = _static(50)
    extras: bool = _static(True)
    scale: bool = _static(True)
    sizes: int = _static(11)
    size_step: float = _static(1.04)

    block: float | jax.Array = 1 / 3
    lam: float | jax.Array = 0.01
    smoothing: float | jax.Array = 1.5
    overhang: float | jax.Array = 0.0
    prior: float | jax.Array = 0.6
    place_weight: float | jax.Array = 15.0
    place_rate: float | jax.Array = 0.02
    size_rate: float | jax.Array = 0.025
    anchor: float | jax.Array = 0.4
    size_pull: float | jax.Array = 0.04
    recent_penalty: float | jax.Array = 0.1
    recent_rate: float | jax.Array = 0.05
    confidence_middle: float | jax.Array = 0.3
    confidence_slope: float | jax.Array = 10.0
    learn_above: float | jax.Array = 0.7
    lost_below: float | jax.Array = 0.5
    patience: int | jax.Array = 5
    found_above: float | jax.Array = 0.9

    @classmethod
    def paper(cls, **changes: Any) -> "Config":
        """The paper's setting, with any fields changed by keyword."""
        preset: dict[str, Any] = {
            "canvas": "native",
            "window_factor": 2.0,
            "window_minimum": 100.0,
            "parts": 5,
            "selectors": 20,
            "pool_size": 200,
            "iterations": 30,
            "block": 0.2,
            "smoothing": 0.5,
            "prior": 0.0,
            "extras": False,
        }
        return cls(**(preset | changes))

    def __post_init__(self) -> None:
        for name, choices in _CHOICES.items():
            if getattr(self, name) not in choices:
                raise ValueError(
                    f"{name} must be one of {', '.join(map(repr, choices))}, "
                    f"but is {getattr(self, name)!r}"
                )
        for name, least in _LEAST_COUNT.items():
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < least:
                raise ValueError(f"{name} must be an integer of at least {least}, but is {value!r}")
        sides = self.canvas if isinstance(self.canvas, tuple) else (self.canvas, self.canvas)
        if self.canvas != "native" and not (
            len(sides) == 2 and all(isinstance(side, int) and side >= 4 for side in sides)
        ):
            raise ValueError(
                'canvas must be "native", an integer of at least 4 or two of them, '
                f"but is {self.canvas!r}"
            )
        if not 1 < self.window_factor < math.inf:
            raise ValueError(
                f"window_factor must be finite and above 1, but is {self.window_factor!r}"
            )
        if not 1 < self.size_step < 2:
            raise ValueError(f"size_step must be above 1 and below 2, but is {self.size_step!r}")
        for name in ("extras", "scale"):
            if not isinstance(getattr(self, name), bool):
                raise ValueError(f"{name} must be True or False, but is {getattr(self, name)!r}")
        if self.sizes % 2 == 0:
            raise ValueError(
                f"sizes must be odd, so that the last size is in the middle, but is {self.sizes}"
            )
        for name in _NOT_NEGATIVE:
            _check_range(name, getattr(self, name), "finite and not negative", 0, math.inf)
        for name in _SHARES:
            _check_range(name, getattr(self, name), "from 0 to 1", 0, 1 + 1e-6)
        _check_range("patience", self.patience, "at least 1", 1, math.inf)
        _check_range("confidence_middle", self.confidence_middle, "from -1 to 1", -1, 1 + 1e-6)
        _check_range("block", self.block, "above 0 and at most 1", 1e-6, 1 + 1e-6)

    @property
    def grid(self) -> "Grid":
        """The cells of object and window; ValueError while they depend on the box (`resolve`)."""
        if self.canvas == "native" or self.window_minimum > 0:
            raise ValueError(
                f"canvas={self.canvas!r} with window_minimum={self.window_minimum} takes its shape "
                "from the box: call config.resolve(box) first"
            )
        rows, columns = self.canvas if isinstance(self.canvas, tuple) else (self.canvas,) * 2
        return Grid(
            rows,
            columns,
            margin_rows=round(rows * (self.window_factor - 1) / 2),
            margin_columns=round(columns * (self.window_factor - 1) / 2),
        )

    def resolve(self, box: BoxLike) -> "Config":
        """The same settings with the shapes that depend on the box fixed: canvas and window.

        box: [4], x, y, w, h in pixels, concrete. Returns itself where nothing depends on it.
        """
        if self.canvas != "native" and self.window_minimum <= 0:
            return self
        _, _, width, height = (float(side) for side in np.asarray(box))
        canvas = (round(height), round(width)) if self.canvas == "native" else self.canvas
        factor = max(self.window_factor, *(self.window_minimum / side for side in (width, height)))
        return dataclasses.replace(self, canvas=canvas, window_factor=factor, window_minimum=0.0)


def resolve_all(config: Config, boxes: np.ndarray) -> Config:
    """The same settings with the shapes that depend on the boxes [B, 4] fixed.

    Raises ValueError where they are not the same for all boxes, as one program serves them all.
    """
    if not isinstance(config, Config):
        raise ValueError(f"config must be a dcs_jax.Config, but is {config!r}")
    one, *others = (config.resolve(box) for box in boxes)
    for number, other in enumerate(others, 1):
        if (other.canvas, other.window_factor) != (one.canvas, one.window_factor):
            sizes = [f"{box[2]:g} x {box[3]:g}" for box in (boxes[0], boxes[number])]
            raise ValueError(
                f"canvas={config.canvas!r} with window_minimum={config.window_minimum} takes its "
                f"shape from the box, but boxes[0] has {sizes[0]} pixels and boxes[{number}] "
                f"{sizes[1]}: expected boxes of one size, or a canvas of a number of cells"
            )
    return one


@dataclasses.dataclass(frozen=True)
class Grid:
    """Cells of the object (rows x columns) and of the window's margin on each side of it."""

    rows: int
    columns: int
    margin_rows: int
    margin_columns: int

    @property
    def window(self) -> tuple[int, int]:
        """Rows and columns of the window, cells."""
        return self.rows + 2 * self.margin_rows, self.columns + 2 * self.margin_columns

    @property
    def positions(self) -> tuple[int, int]:
        """Candidate places of the object in the window, per axis: the middle one is no motion."""
        return 2 * self.margin_rows + 1, 2 * self.margin_columns + 1


_CHOICES = {
    "parts": (1, 5, 9),
    "selector": ("l1", "error", "mil", "first"),
    "tie": ("first", "error"),
    "weak": ("midpoint", "gaussian"),
}
_LEAST_COUNT = {"selectors": 1, "pool_size": 1, "iterations": 1, "first_updates": 1, "sizes": 3}
_NOT_NEGATIVE = (
    "window_minimum",
    "lam",
    "smoothing",
    "overhang",
    "prior",
    "place_weight",
    "recent_penalty",
    "confidence_slope",
)
_SHARES = (
    "place_rate",
    "size_rate",
    "anchor",
    "size_pull",
    "recent_rate",
    "learn_above",
    "lost_below",
    "found_above",
)


def _check_range(name: str, value: Any, expected: str, least: float, limit: float) -> None:
    """ValueError unless value is a number, or an array of numbers, in [least, limit).

    Inside a transformation, JAX rebuilds the dataclass around tracers and placeholders, which have
    no value to look at, and in `track_batch` around arrays whose values lie in other processes:
    they pass.
    """
    if isinstance(value, (str, bytes, list, dict, tuple)):
        raise ValueError(f"{name} must be a number or an array of numbers, but is {value!r}")
    if isinstance(value, (bool, jax.core.Tracer)) or not isinstance(
        value, (int, float, np.number, np.ndarray, jax.Array)
    ):
        return
    if isinstance(value, jax.Array) and not value.is_fully_addressable:
        return
    numbers = np.asarray(value)
    if not ((numbers >= least) & (numbers < limit)).all():
        raise ValueError(f"{name} must be {expected}, but is {value}")
