"""Tracks frame by frame, as a loop over a camera has them: the habits of OpenCV's trackers."""

import functools
from collections import deque
from typing import Any, Literal, NamedTuple

import cv2
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from dcs_jax import tracker
from dcs_jax.checks import LARGEST_SEED, check_box, check_choice, check_count, check_frame
from dcs_jax.config import Config, check_config, resolve_all, single_precision
from dcs_jax.io.chunks import aligned
from dcs_jax.runners.programs import without_pool
from dcs_jax.runners.sequence import init_track
from dcs_jax.runners.slots import Slots
from dcs_jax.runners.stream import MOST_SLOTS
from dcs_jax.types import BoxLike, Pool, State, StepInfo

Order = Literal["rgb", "bgr"]
Box = tuple[float, float, float, float]


class Result(NamedTuple):
    """What one frame yielded, as in `StepInfo`.

    box: x, y, w, h in pixels. confidence: in [0, 1], NaN without verification. lost: whether the
    object has not been verified for some frames. part_scores: [K] in [0, 1].
    """

    box: Box
    confidence: float
    lost: bool
    part_scores: NDArray[np.float32]


class Tracker:
    """One track, frame by frame:

        tracker = dcs_jax.Tracker(order="bgr")  # frames of OpenCV
        tracker.init(frame, (99, 146, 48, 64))
        ok, box = tracker.update(frame)  # ok: not lost

    The boxes are those of `track_sequence` with the same seed. A frame is uint8, grey or colour, an
    array of NumPy or JAX or an image of PIL; its memory may be used again after the call.

    result: what the last frame yielded, a `Result`.
    state: all that the track carries, a `State`, copied. Kept, it can be set again to go back, also
        in another tracker of the same settings.
    """

    def __init__(self, config: Config = Config(), seed: int = 0, order: Order = "rgb") -> None:
        """config: settings. seed: of the features. order: of the colours in a frame.

        Raises ValueError where one of them is not as stated.
        """
        self._config, self._seed = config, _checked(config, seed, order)
        self._order = order
        self._numbers: list[jax.Array] = []
        self._settings: Any = None  # what is static of the settings
        self._pool: Any = None  # `Pool`
        # The state without the pool, and what the last frame yielded; empty before `init`.
        self._track: deque[tuple[State, jax.Array | None]] = deque(maxlen=1)
        self._frame: NDArray[np.uint8] | None = None

    def init(self, frame: Any, box: BoxLike) -> None:
        """Start the track: learn the object in its first frame.

        box: [4], x, y, w, h in pixels, as for `track_sequence`.

        Raises ValueError where frame or box are not as stated.
        """
        image = as_frame(frame, self._order)
        check_box(box, image.shape)
        self._begin(image, np.asarray(box, np.float32), jax.random.key(self._seed))

    def update(self, frame: Any) -> tuple[bool, Box]:
        """Follow the object into the next frame: whether it is not lost, and its box.

        Raises ValueError before `init`, or where the frame is not like those before it.
        """
        image = as_frame(frame, self._order)
        if not self._track:
            raise ValueError("the tracker has no track: call init with a frame and a box first")
        if self._frame is not None and image.shape != self._frame.shape:
            raise ValueError(
                f"frame must have the shape of those before it, {self._frame.shape}, but has "
                f"{image.shape}"
            )
        self._frame = image
        # The array of NumPy itself, and numbers that are on the device: what JAX does for others in
        # Python would take a tenth of the step. All in one call of C: Ctrl-C cannot come after the
        # last state was given up and before there is a new one.
        state, _ = self._track[0]
        arguments = state, self._pool, image, self._numbers, self._settings
        self._track.extend(map(_step, *([argument] for argument in arguments)))
        result = self.result
        return not result.lost, result.box

    def correct(self, box: BoxLike, frame: Any = None) -> None:
        """Say where the object really is: the track starts again there, with the same features.

        box: [4], x, y, w, h in pixels.
        frame: by default the one last given, whose memory must not have been used again since.

        Raises ValueError before `init`, or where box or frame are not as stated.
        """
        if frame is None and self._frame is None:
            raise ValueError("the tracker has no track: call init with a frame and a box first")
        image = as_frame(frame, self._order) if frame is not None else self._frame
        assert image is not None
        check_box(box, image.shape)
        self._begin(image, np.asarray(box, np.float32), jax.random.key(self._seed))

    @property
    def result(self) -> Result:
        if not self._track or self._track[0][1] is None:
            raise ValueError("the tracker has no result: call init with a frame and a box first")
        x, y, w, h, confidence, lost, *_ = row = np.asarray(self._track[0][1]).tolist()
        scores = np.array(row[_SCORES:], np.float32)
        return Result((x, y, w, h), confidence, bool(lost), scores)

    @property
    def state(self) -> State:
        if not self._track:
            raise ValueError("the tracker has no state: call init with a frame and a box first")
        state, _ = self._track[0]
        return _copied(state)._replace(pool=self._pool)

    @state.setter
    def state(self, state: State) -> None:
        if not isinstance(state, State):
            raise ValueError(f"state must be a dcs_jax.State, but is {state!r}")
        self._settle(np.r_[0, 0, state.initial_size])
        self._pool = state.pool
        row = self._track[0][1] if self._track else None
        self._track.append((_copied(without_pool(state, state.pool)), row))

    def _begin(self, image: Any, box: NDArray[np.float32], key: jax.Array) -> None:
        config = self._settle(box)
        self._frame = image
        state, info = init_track(image, box, key, config)
        self._pool = state.pool
        self._track.append((without_pool(state, state.pool), _row(info)))

    def _settle(self, box: NDArray[Any]) -> Config:
        """The settings for a box, whose numbers are then not sent with every frame."""
        config = self._config.resolve(box)
        numbers, self._settings = jax.tree.flatten(single_precision(config))
        self._numbers = [jnp.asarray(number) for number in numbers]
        return config


class MultiTracker:
    """Several tracks, frame by frame, which come and go without compilation:

        tracker = dcs_jax.MultiTracker(slots=4)
        car = tracker.add(frame, (99, 146, 48, 64))
        for frame in camera:
            results = tracker.update(frame)  # a dict: results[car].box
        tracker.drop(car)

    On all cores. An empty slot takes no time.
    """

    def __init__(
        self,
        slots: int = 8,
        config: Config = Config(),
        seed: int = 0,
        order: Order = "rgb",
    ) -> None:
        """slots: tracks that there can be at a time. The others as for `Tracker`."""
        slots = check_count("slots", slots, most=MOST_SLOTS)
        self._seed = _checked(config, seed, order)
        self._config, self._order, self._size = config, order, slots
        self._slots: Slots | None = None
        self._shape: tuple[int, ...] = ()
        self._active = np.zeros(slots, bool)

    @property
    def active(self) -> list[int]:
        """The slots that have a track."""
        return [int(slot) for slot in np.flatnonzero(self._active)]

    def add(self, frame: Any, box: BoxLike) -> int:
        """Start a track: learn the object in this frame. Returns its slot, the first free one.

        Raises ValueError where all slots have a track, or frame or box are not as stated.
        """
        image = as_frame(frame, self._order)
        check_box(box, image.shape)
        if self._active.all():
            raise ValueError(f"all {self._size} slots have a track: drop one, or ask for more")
        boxes = np.ones((self._size, 4), np.float32)
        slot = int(np.flatnonzero(~self._active)[0])
        boxes[slot] = np.asarray(box, np.float32)
        config = resolve_all(self._config, boxes[slot][None])
        if self._slots is None:
            key = jax.random.key(self._seed)
            self._slots = Slots(self._size, image.shape, key, config, length=1)
            self._shape = image.shape
        self._check_shape(image)
        if config.grid != self._slots.grid:
            raise ValueError(
                f"box has another size than the first, but with canvas={config.canvas!r} all boxes "
                "must be of one size"
            )
        new = np.arange(self._size) == slot
        self._slots.init(image, boxes, new)
        self._active |= new
        return slot

    def update(self, frame: Any) -> dict[int, Result]:
        """Follow all objects into the next frame: what it yielded, by slot.

        Raises ValueError where there is no track, or the frame is not like those before it.
        """
        image = as_frame(frame, self._order)
        if self._slots is None or not self._active.any():
            raise ValueError("there is no track: call add with a frame and a box first")
        self._check_shape(image)
        rows = self._slots.rows(self._slots.scan(image[None], self._active))
        return {slot: _result(rows, slot) for slot in self.active}

    def drop(self, slot: int) -> None:
        """End the track of a slot, which is free then; ValueError where there is none."""
        if slot not in self.active:
            raise ValueError(f"slot {slot} has no track: those that have one are {self.active}")
        self._active[slot] = False

    def _check_shape(self, image: NDArray[np.uint8]) -> None:
        if image.shape != self._shape:
            raise ValueError(
                f"frame must have the shape of those before it, {self._shape}, but has "
                f"{image.shape}"
            )


def as_frame(frame: Any, order: Order = "rgb") -> NDArray[np.uint8]:
    """An image of NumPy, JAX or PIL as a frame in one piece of memory, grey or RGB.

    Raises ValueError where it is none.
    """
    mode = getattr(frame, "mode", None)  # of PIL
    if mode is not None and hasattr(frame, "convert"):
        frame = np.asarray(frame if mode in ("L", "RGB") else frame.convert("RGB"))
    check_frame(frame)
    image = np.ascontiguousarray(frame)
    if order == "bgr" and image.ndim == 3:
        rgb = aligned(image.shape)  # of which JAX makes no copy
        cv2.cvtColor(image, cv2.COLOR_BGR2RGB, rgb)
        return rgb
    return image


def _checked(config: Config, seed: int, order: Order) -> int:
    check_config(config)
    seed = check_count("seed", seed, least=0, most=LARGEST_SEED)
    check_choice("order", order, ("rgb", "bgr"))
    return seed


def _result(rows: StepInfo, slot: int) -> Result:
    x, y, w, h = rows.box[slot, 0].tolist()
    confidence, lost = float(rows.confidence[slot, 0]), bool(rows.lost[slot, 0])
    return Result((x, y, w, h), confidence, lost, np.asarray(rows.part_scores[slot, 0]))


# The state's memory is used again: that of a new one would take a tenth of the step.
@functools.partial(jax.jit, static_argnames="settings", donate_argnames="state")
def _step(
    state: State, pool: Pool, frame: Any, numbers: list[jax.Array], settings: Any
) -> tuple[State, jax.Array]:
    """`step`, and what a user sees of it in one array: each one fetched takes 20 us."""
    config = jax.tree.unflatten(settings, numbers)
    state, info = tracker.step(state._replace(pool=pool), frame, config)
    return without_pool(state, pool), _row(info)


def _copied(state: State) -> State:
    return jax.tree.map(jnp.array, state)


def _row(info: StepInfo) -> jax.Array:
    confidence, lost = info.confidence[None], info.lost[None].astype(jnp.float32)
    return jnp.concatenate([info.box, confidence, lost, info.part_scores])


_SCORES = 6  # place of the parts' scores in a row
