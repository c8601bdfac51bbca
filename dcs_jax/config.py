"""The settings of a track: the paper's, and a group for each component beyond it."""

import dataclasses
import functools
import math
from collections.abc import Callable
from typing import Any, Literal, TypeVar

import jax
import numpy as np

from dcs_jax.checks import INT32, box_numbers, check_choice, check_count, shown
from dcs_jax.fields import (
    check_between,
    check_fields,
    choice,
    count,
    group,
    not_negative,
    number,
    pytree,
    share,
    static,
)
from dcs_jax.types import BoxLike

Selector = Literal["l1", "error", "mil", "first"]
TieRule = Literal["first", "error"]
WeakRule = Literal["midpoint", "gaussian"]
OutputSize = Literal["estimated", "initial"]
Number = float | jax.Array

# Cells on a side of the window. Its maps then have 64 MiB, of each part of the object.
_MOST_CELLS = 4096
# F = M * K * N, features of a track: its state then has some 300 MiB.
_MOST_FEATURES = 2**22
# Scales that are compared, and the ratio of the largest to the present one.
_MOST_SCALES, _LARGEST_SCALE = 999, 10.0


def _check_odd(name: str, value: Any) -> int:
    scales = check_count(name, value, 3, _MOST_SCALES)
    if scales % 2 == 0:
        raise ValueError(
            f"{name} must be odd, so that the last scale is in the middle, but is {value}"
        )
    return scales


def _check_canvas(name: str, value: Any) -> Any:
    if isinstance(value, str) and value == "native":
        return "native"
    pair = isinstance(value, tuple)
    sides = value if pair else (value,)
    try:
        if pair and len(sides) != 2:
            raise ValueError
        known = tuple(check_count(name, side, 4, _MOST_CELLS) for side in sides)
    except ValueError:
        raise ValueError(
            f'{name} must be "native", an integer of at least 4 and at most {_MOST_CELLS}, or two '
            f"of them, but is {shown(value)}"
        ) from None
    return known if pair else known[0]


def _check_parts(name: str, value: Any) -> int:
    count = int(value) if isinstance(value, np.integer) else value
    check_choice(name, count, (1, 5, 9))
    return count


@pytree
@dataclasses.dataclass(frozen=True, kw_only=True)
class TranslationFilter:
    """A correlation filter as one more cue of the position (`extensions.translation`)."""

    weight: Number = not_negative(15.0)
    """Weight of the response, about 1 where the filter is sure, in the score map."""
    learning_rate: Number = share(0.03)
    """Weight of the present frame in the running mean of the filter, in [0, 1]."""
    first_frame: Number = share(0.15)
    """Weight of the first frame's filter in the response, in [0, 1]: against slow drift."""
    window_factor: float = static(
        4.5, check_between, expected="finite and above 1", low=1, high=math.inf
    )
    """Side of the window that the filter sees, as `Config.window_factor`. Where it is larger than
    the search window, this is searched around the filter's peak, and the classifiers learn their
    background from the corners of the larger one. Static."""
    learned_factor: Number = number(2.25, "from 0.5 to 1e9", 0.5, 1e9 + 1e-6)
    """Side of the part of that window that the filter learns, in object sides, from 0.5: the object
    and what touches it, fading out to nothing (Hann). A filter that learns the whole window follows
    the background where the object moves against it."""

    def __post_init__(self) -> None:
        check_fields(self)


@pytree
@dataclasses.dataclass(frozen=True, kw_only=True)
class ColourHistograms:
    """The colours of the object and of what is around it, as a cue (`extensions.colour`).

    In a video without colour they count nothing.
    """

    weight: Number = not_negative(20.0)
    """Weight in the score map of the mean probability of being object, which is in [0, 1]."""
    learning_rate: Number = share(0.04)
    """Weight of the present frame in the running means of the histograms, in [0, 1] (Staple)."""

    def __post_init__(self) -> None:
        check_fields(self)


@pytree
@dataclasses.dataclass(frozen=True, kw_only=True)
class ScaleFilter:
    """A correlation filter over scales that estimates the object's (`extensions.scale`)."""

    num_scales: int = static(11, _check_odd)
    """S, scales compared in a frame, an odd number. Static."""
    step: float = static(1.04, check_between, expected="above 1 and below 2", low=1, high=2)
    """Ratio of a scale to the next smaller one, above 1 and below 2; of the largest scale to the
    present one at most 10. Static."""
    learning_rate: Number = share(0.0125)
    """Weight of the present frame in the running mean of the filter, in [0, 1]."""
    initial_pull: Number = share(0.02)
    """Pull of the estimated scale towards the initial one, in [0, 1]: each frame moves the log
    scale back by pull * (1 - similarity) of its distance. Without verification there is no pull."""

    def __post_init__(self) -> None:
        check_fields(self)
        steps = self.num_scales // 2
        if steps * math.log(self.step) > math.log(_LARGEST_SCALE):
            raise ValueError(
                f"num_scales={self.num_scales} with step={self.step} compares scales of "
                f"{self.step}^{steps}: expected at most {_LARGEST_SCALE:g} times the present one"
            )


@pytree
@dataclasses.dataclass(frozen=True, kw_only=True)
class AspectRatio:
    """Comparison of aspect ratios, by which the box gets narrower or flatter with the object.

    See `extensions.aspect`. Without verification, whose initial template says what the object looks
    like, the ratio is that of the first box.
    """

    similar_above: Number = share(0.8)
    """Similarity to the initial template, a cosine, above which another ratio than the first one is
    taken, if the gain says so, too."""
    gain_above: Number = share(0.1)
    """Gain of similarity by it above which this is so."""
    cost: Number = not_negative(0.1)
    """Reduction of the similarity, times the distance of the logarithm of a ratio from that of the
    first one, where ratios are compared."""

    def __post_init__(self) -> None:
        check_fields(self)


@pytree
@dataclasses.dataclass(frozen=True, kw_only=True)
class RotationFilter:
    """A correlation filter over angles, by which the canvas turns with the object.

    See `extensions.rotation`. Without verification, whose initial template says whether the object
    has turned, nothing turns.
    """

    similar_above: Number = share(0.6)
    """Similarity to the initial template, a cosine, above which an object that was upright counts
    as turned, if it is turned back before it is compared, and the gain says so, too."""
    gain_above: Number = share(0.2)
    """Gain of similarity by turning it back above which this is so."""
    gain_below: Number = share(0.1)
    """Gain, a running mean, up to which an object that has turned counts as upright again."""
    follow_above: Number = share(0.9)
    """Confidence above which the angle of an object that has turned is followed."""

    def __post_init__(self) -> None:
        check_fields(self)


@pytree
@dataclasses.dataclass(frozen=True, kw_only=True)
class Verification:
    """Comparison of the candidate with the object's templates (`extensions.verification`).

    A track then learns only where the object is verified, and says when it is lost.
    """

    middle: Number = number(0.3, "from -1 to 1", -1, 1 + 1e-6)
    """Similarity, a cosine, at which the confidence is 1/2."""
    slope: Number = not_negative(10.0)
    """Slope of confidence = 1 / (1 + exp(-slope * (similarity - middle))). Both were fitted to
    tracks of seven labelled sequences and variants of them: of the boxes that overlap the object by
    more than half nine in ten have a similarity to the initial template above 0.2, of the others
    one in ten has one above 0.4. The limits below are of this confidence."""
    response_middle: Number = number(0.5, "from -10 to 10", -10, 10 + 1e-6)
    """Sum of the responses of the translation filter, as it is and as of the first frame, at which
    they say nothing; about 1 each where the object looks as it was learned."""
    response_slope: Number = not_negative(4.0)
    """Slope of the confidence of a track (`StepInfo`), in which both count:
    1 / (1 + exp(-response_slope * (similarity - middle + responses - response_middle)))."""
    template_rate: Number = share(0.03)
    """Learning rate of the online template, in [0, 1]."""
    recent_rate: Number = share(0.07)
    """Learning rate of the recent template, in [0, 1], which follows changes that the online one
    does not: what was followed of late, if not what was recognised."""
    template_penalty: Number = not_negative(0.1)
    """Reduction of the similarity to these two, which may have drifted; a cosine."""
    learn_above: Number = share(0.25)
    """Confidence above which the classifiers, the filters and the recent template learn."""
    sure_above: Number = share(0.7)
    """Confidence above which the scale is followed and the online template learns, if the object
    is not missed; and, after half of `patience`, everything else, or what is in front of the object
    would be learned."""
    rest_above: Number = share(0.9)
    """Confidence above which there is little to learn: of the frames in which the object is
    recognised so surely, classifiers and filters learn from one in `learn_every`, the templates
    from all."""
    learn_every: int | jax.Array = number(2, "at least 1", 1, INT32 + 1, whole=True)
    """An integer below 2^31; 1: all frames are learned from."""
    lost_below: Number = share(0.5)
    """Confidence up to which the object counts as missed in a frame, and is looked for once more by
    the filter of the first frame alone."""
    recover_above: Number = share(0.85)
    """Confidence above which a lost object is held again, and learned from."""
    patience: int | jax.Array = number(5, "at least 1", 1, INT32 + 1, whole=True)
    """Frames in a row in which the object is missed before it is lost, an integer below 2^31."""

    def __post_init__(self) -> None:
        check_fields(self)


@pytree
@dataclasses.dataclass(frozen=True, kw_only=True)
class Redetection:
    """Search of the whole frame for an object that was missed (`extensions.redetection`)."""

    windows: int = count(2)
    """Search windows a frame, in addition to those around the last box and around that which was
    verified last. Static."""
    accept_above: Number = share(0.9)
    """Confidence above which the object is accepted in one of them."""

    def __post_init__(self) -> None:
        check_fields(self)


# Names of earlier versions, and what replaced them.
RENAMED = {
    "extras": "translation, scale, verification and redetection, each None to switch it off",
    "sizes": "scale.num_scales",
    "size_step": "scale.step",
    "size_rate": "scale.learning_rate",
    "size_pull": "scale.initial_pull",
    "place_weight": "translation.weight",
    "place_rate": "translation.learning_rate",
    "anchor": "translation.first_frame",
    "recent_penalty": "verification.template_penalty",
    "recent_rate": "verification.template_rate",
    "confidence_middle": "verification.middle",
    "confidence_slope": "verification.slope",
    "learn_above": "verification.learn_above",
    "lost_below": "verification.lost_below",
    "patience": "verification.patience",
    "found_above": "verification.recover_above and redetection.accept_above",
}


def check_not_renamed(name: str, value: Any) -> None:
    """ValueError where a field of Config had this name, or took this value, in earlier versions."""
    if name == "scale" and isinstance(value, bool):
        size = "estimated" if value else "initial"
        raise ValueError(f"scale={value} is now output_size={size!r}")
    if name in RENAMED:
        raise ValueError(f"{name} is now {RENAMED[name]}")


_Class = TypeVar("_Class")


def _refuse_old_names(config: type[_Class]) -> type[_Class]:
    # Not as attributes: mypy does not know that it is this class itself, and no subclass.
    make: Callable[..., None] = getattr(config, "__init__")  # noqa: B009

    @functools.wraps(make)
    def checked(self: Any, **fields: Any) -> None:
        for name, value in fields.items():
            check_not_renamed(name, value)
        make(self, **fields)

    setattr(config, "__init__", checked)  # noqa: B010
    return config


@_refuse_old_names
@pytree
@dataclasses.dataclass(frozen=True, kw_only=True)
class Config:
    """Settings of the tracker. `Config()` is the recommended preset, `Config.paper()` the paper's.

    A pytree: the numbers are its leaves, so another value compiles nothing, and an array of them
    can be vmapped over; the other fields are static. `dataclasses.replace` changes fields. The
    seven groups are what the default has beyond the paper: None switches one off.

    The tracker computes in float32 and int32, whatever the type of a number and JAX's settings;
    numbers of no stated limit are at most 1e9. Static numbers may be NumPy's, and are kept as
    Python's; an array is none.

    Raises ValueError where a value is of another type or out of its range, the features are more
    than 2^22, or a name is of an earlier version. JAX may put anything in the place of the numbers,
    as for `in_axes`: `jax.tree.map(lambda _: None, config)` is not checked.
    """

    canvas: int | tuple[int, int] | Literal["native"] = static(40, _check_canvas)
    """Cells per side of the object, whatever its size in pixels, or (rows, columns); or "native",
    as many as the initial box has pixels (the paper's setting, compiled for every size of box)."""
    window_factor: float = static(
        2.5, check_between, expected="finite and above 1", low=1, high=math.inf
    )
    """Side of the search window in sides of what the canvas shows of the object, above 1."""
    window_minimum: float = static(
        0.0, check_between, expected="finite and not negative", low=-math.ulp(0), high=math.inf
    )
    """Least side of the search window in pixels (the paper: 100)."""
    parts: Literal[1, 5, 9] = static(9, _check_parts)
    """K: 1 (the whole object), 5 (and its halves, the paper's) or 9 (and its quadrants)."""
    selectors: int = count(40)
    """N, weak classifiers that a strong part classifier adds up."""
    pool_size: int = count(50)
    """M, weak classifiers that each selector chooses from."""
    selector: Selector = choice("l1", "l1", "error", "mil", "first")
    """How a selector chooses: "l1" by non-negative l1 minimisation with label noise (the paper's
    "w/ l1"), "error" by the least accumulated error ("w/o l1"), "mil" by the bag likelihood
    (Babenko et al., CVPR 2009), "first" as the first without error in this frame."""
    tie: TieRule = choice("first", "first", "error")
    """Which of several equally good classifiers "l1" takes: "first", the first one of the pool, or
    "error", the one of least accumulated error, with which the target is lost."""
    weak: WeakRule = choice("midpoint", "midpoint", "gaussian")
    """How a weak classifier decides: "midpoint" by the nearer class mean, "gaussian" by the
    likelier class (eq. 16)."""
    iterations: int = count(10)
    """Accelerated proximal gradient steps of the "l1" selector."""
    first_updates: int = count(50)
    """Updates on the training samples of the first frame."""
    output_size: OutputSize = choice("estimated", "estimated", "initial")
    """Size of the boxes of a track: "estimated", that of the scale filter, or "initial", that of
    the initial box around the estimated centre. The search follows the estimate in both."""

    squareness: Number = share(0.5)
    """How square what the canvas shows of the object is, in [0, 1]: its box at 0 (the paper's
    setting), a square of the same area at 1, and at 0.5 halfway in the logarithm of the sides. The
    windows are so many sides of that: around a narrow box itself they would be as narrow, and a
    camera moves by more than the width of a person."""
    block: Number = number(1 / 3, "above 0 and at most 1", 1e-6, 1 + 1e-6)
    """Largest base block of a feature, in sides of its part, above 0 and at most 1 (the paper's
    code: 1/5, on some sequences 1)."""
    lam: Number = not_negative(0.01)
    """Weight lambda of the l1 penalty (eq. 14), not negative."""
    smoothing: Number = not_negative(1.5)
    """Standard deviation of the 3x3 Gaussian that smooths the maps, in cells; 0: none."""
    overhang: Number = not_negative(0.0)
    """How far the box may move out of the frame, in sides of the object, not negative; 0: not at
    all, as the paper's window, which is clipped to the frame."""
    prior: Number = not_negative(0.6)
    """Motion prior: a displacement of d costs prior * d^2 / (w h), on the scale of
    -log(1 - Noisy-OR); 0: every position in the window is as likely (the paper's setting)."""

    translation: TranslationFilter | None = group(TranslationFilter)
    colour: ColourHistograms | None = group(ColourHistograms)
    scale: ScaleFilter | None = group(ScaleFilter)
    aspect: AspectRatio | None = group(AspectRatio)
    rotation: RotationFilter | None = group(RotationFilter)
    verification: Verification | None = group(Verification)
    redetection: Redetection | None = group(Redetection)

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
            "squareness": 0.0,
            "block": 0.2,
            "smoothing": 0.5,
            "prior": 0.0,
            **dict.fromkeys(COMPONENTS),
        }
        return cls(**(preset | changes))

    def __post_init__(self) -> None:
        check_fields(self)
        if self.redetection is not None and self.verification is None:
            raise ValueError(
                "redetection needs verification, which says when the object is missed: "
                "set both to None, or neither"
            )
        features = self.pool_size * self.parts * self.selectors
        if features > _MOST_FEATURES:
            raise ValueError(
                f"pool_size={self.pool_size} with parts={self.parts} and selectors="
                f"{self.selectors} are {features} features: expected at most {_MOST_FEATURES}"
            )

    @property
    def grid(self) -> "Grid":
        """The cells of object and window: the larger one of search and translation filter.

        Raises ValueError while they depend on the box (`resolve`), and where the window has more
        than 4096 cells on a side.
        """
        if self.translation is None:
            return self.search_grid
        return self._grid(max(self.window_factor, self.translation.window_factor))

    @property
    def search_grid(self) -> "Grid":
        """The cells of object and search window, in which the classifiers vote.

        Raises ValueError as `grid` does.
        """
        return self._grid(self.window_factor)

    def _grid(self, window_factor: float) -> "Grid":
        if self.canvas == "native" or self.window_minimum > 0:
            raise ValueError(
                f"canvas={self.canvas!r} with window_minimum={self.window_minimum} takes its shape "
                "from the box: call config.resolve(box) first"
            )
        rows, columns = self.canvas if isinstance(self.canvas, tuple) else (self.canvas,) * 2
        if max(rows, columns) * window_factor > _MOST_CELLS:
            raise ValueError(
                f"canvas={self.canvas!r} with window_factor={window_factor:g} gives a window "
                f"of more than {_MOST_CELLS} cells on a side"
            )
        return Grid(
            rows,
            columns,
            margin_rows=round(rows * (window_factor - 1) / 2),
            margin_columns=round(columns * (window_factor - 1) / 2),
        )

    def resolve(self, box: BoxLike) -> "Config":
        """The same settings with the shapes that depend on the box fixed: canvas and window.

        box: [4], x, y, w, h in pixels, concrete. Returns itself where nothing depends on it.

        Raises ValueError where the box is not as stated, or has a side of more than 4096 pixels
        with canvas="native".
        """
        if self.canvas != "native" and self.window_minimum <= 0:
            return self
        _, _, width, height = (float(side) for side in box_numbers(box))
        canvas = (round(height), round(width)) if self.canvas == "native" else self.canvas
        factor = max(self.window_factor, *(self.window_minimum / side for side in (width, height)))
        return dataclasses.replace(self, canvas=canvas, window_factor=factor, window_minimum=0.0)


def single_precision(config: Config) -> Config:
    """The same settings with numbers in float32, those that are integers in int32.

    The one place where their types are fixed: JAX would give Python's and NumPy's numbers other
    ones with 64 bits allowed.

    Raises ValueError unless config is a Config whose numbers are no arrays.
    """
    check_config(config)

    numbers, structure = jax.tree.flatten(config)
    kinds = _numbers_of(structure)
    return jax.tree.unflatten(
        structure,
        (
            _single(name, dtype, number)
            for (name, dtype), number in zip(kinds, numbers, strict=True)
        ),
    )


def _single(name: str, dtype: Any, number: Any) -> Any:
    if np.shape(number):
        raise ValueError(
            f"config.{name} must be one number here, but has the shape {np.shape(number)}: arrays "
            "of them are for track_batch and jax.vmap"
        )
    if isinstance(number, jax.Array):
        return number if number.dtype == dtype else number.astype(dtype)
    return dtype(number)  # of NumPy, in a tenth of the time of JAX's


@functools.lru_cache(maxsize=64)  # as a step takes few milliseconds
def _numbers_of(structure: Any) -> list[tuple[str, Any]]:
    """Name and type of every number of settings of this structure."""
    paths = jax.tree_util.tree_leaves_with_path(structure.unflatten([0] * structure.num_leaves))
    return [
        (jax.tree_util.keystr(path, simple=True, separator="."), number_type(path))
        for path, _ in paths
    ]


def number_type(path: tuple[Any, ...]) -> Any:
    """The type of the number at a path of JAX's in a Config: float32 or int32."""
    settings: Any = Config
    for key in path[:-1]:
        settings = COMPONENTS[key.name]
    return settings.__dataclass_fields__[path[-1].name].metadata["dtype"]


def check_config(config: Any) -> None:
    """ValueError unless config is a Config."""
    if not isinstance(config, Config):
        raise ValueError(f"config must be a dcs_jax.Config, but is {shown(config)}")


# What the tracker can have beyond the paper, and the class of its settings.
COMPONENTS: dict[str, type] = {
    field.name: field.metadata["group"]
    for field in dataclasses.fields(Config)
    if "group" in field.metadata
}


def resolve_all(config: Config, boxes: np.ndarray) -> Config:
    """The same settings with the shapes that depend on the boxes [B, 4] fixed.

    Raises ValueError where they are not the same for all boxes, as one program serves them all.
    """
    check_config(config)
    one, *others = (config.resolve(box) for box in boxes)
    for position, other in enumerate(others, 1):
        if (other.canvas, other.window_factor) != (one.canvas, one.window_factor):
            sizes = [f"{box[2]:g} x {box[3]:g}" for box in (boxes[0], boxes[position])]
            raise ValueError(
                f"canvas={config.canvas!r} with window_minimum={config.window_minimum} takes its "
                f"shape from the box, but boxes[0] has {sizes[0]} pixels and boxes[{position}] "
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
        """Candidate positions in the window, per axis: the middle one is no motion."""
        return 2 * self.margin_rows + 1, 2 * self.margin_columns + 1
