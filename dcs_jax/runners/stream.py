"""Tracks through frames as they come, in memory that does not grow with their number."""

import inspect
import math
from collections.abc import Generator, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from dcs_jax.checks import (
    check_box,
    check_boxes,
    check_count,
    check_frame,
    check_key,
    check_keys,
    shown,
)
from dcs_jax.config import Config, resolve_all
from dcs_jax.io.chunks import ahead, chunks
from dcs_jax.io.source import Image
from dcs_jax.runners.slots import Slots, draw
from dcs_jax.types import BoxLike, Pool, State, StepInfo, Track

# Bytes. A chunk has its memory before its frames come.
LARGEST_CHUNK = 2**30
# So many states have some 3 GB.
MOST_SLOTS = 10_000


class Chunk(NamedTuple):
    """Some consecutive frames and where the objects are in them.

    start: index of the first of them, counted from 0.
    frames: [n, H, W] or [n, H, W, 3] uint8, as they came.
    track: arrays [S, n, ...], NumPy; NaN in a slot without a track.
    active: [S], the slots with a track.
    """

    start: int
    frames: NDArray[np.uint8]
    track: Track
    active: NDArray[np.bool_]


class Stream(Iterator[Chunk]):
    """Tracks on their way through a video, as `track_stream` makes it: an iterator of chunks.

    Between two chunks, tracks may be added and dropped.

    seconds: spent on tracking so far, without compilation and without waiting for frames.
    """

    def __init__(
        self,
        frames: Iterable[Image],
        first: Image,
        boxes: NDArray[np.float32],
        slots: Slots,
        config: Config,
        num_states: int = 0,
    ) -> None:
        """What `track_stream` has checked; frames: those after the first.

        num_states: slots with a track that goes on from a state; those of the boxes follow.
        """
        self._slots = slots
        self._config = config
        self._boxes = np.ones((slots.size, 4), np.float32)
        self._boxes[num_states : num_states + len(boxes)] = boxes
        number = np.arange(slots.size)
        self._active = number < num_states  # these have a state, and are stepped in every frame
        self._new = ~self._active & (number < num_states + len(boxes))
        self._waiting: dict[int, int] = {}  # of a slot, the frame in which its track starts
        self._keys: dict[int, jax.Array] = {}
        self._last = first  # the last frame that was yielded
        self._yielded = 0  # number of frames
        self._chunks = self._scan(frames)

    def __iter__(self) -> "Stream":
        """Itself."""
        return self

    def __next__(self) -> Chunk:
        """Track the next chunk. What the source of the frames raises comes after its last frame."""
        return next(self._chunks)

    def close(self) -> None:
        """Stop reading frames; there are no more chunks."""
        self._chunks.close()

    @property
    def seconds(self) -> float:
        return self._slots.sharding.seconds

    @property
    def active(self) -> NDArray[np.bool_]:
        """The slots that have a track, or will have one: [S]."""
        active = self._active | self._new
        active[list(self._waiting)] = True
        return active

    def state(self, slot: int) -> State:
        """The state of a track after the last frame that was yielded: see `dcs_jax.save`.

        ValueError where the slot has no track.
        """
        if not (0 <= slot < self._slots.size and self._active[slot]):
            raise ValueError(f"slot {slot} has no track, or none that has started")
        return self._slots.state(slot)

    def add(self, box: BoxLike, key: jax.Array | None = None, frame: int | None = None) -> int:
        """Start a track.

        box: [4], x, y, w, h in pixels.
        key: of its features, if each track has its own; None if all share one pool.
        frame: index of the frame with the box, counted from 0: one that is not yielded yet, a chunk
            then ends with it, and has the box in its last row; by default the last that was
            yielded. It is followed from the next on.

        Returns its slot, the first one that is free. Raises ValueError where none is, where an
        argument is not as stated, and after the end of the stream.
        """
        if inspect.getgeneratorstate(self._chunks) == inspect.GEN_CLOSED:
            raise ValueError(
                "the stream has ended: a track that is added now would never be followed"
            )
        check_box(box, self._last.shape)
        if frame is not None:
            check_count("frame", frame, least=self._yielded)
        box = np.asarray(box, np.float32)
        if self._slots.shared and key is not None:
            raise ValueError("key must be None: the tracks of this stream share one pool")
        if not self._slots.shared:
            check_key(key)
        if resolve_all(self._config, box[None]).grid != self._slots.grid:
            raise ValueError(
                f"box has {box[2]:g} x {box[3]:g} pixels, but with canvas={self._config.canvas!r} "
                "all boxes of a stream must be of one size"
            )
        free = np.flatnonzero(~self.active)
        if not free.size:
            raise ValueError(
                f"all {self._slots.size} slots have a track: drop one, or ask `track_stream` for "
                "more slots"
            )
        slot = int(free[0])
        if frame is None:
            self._new[slot] = True
        else:
            self._waiting[slot] = frame
        self._boxes[slot] = box
        if key is not None:
            self._keys[slot] = key
        return slot

    def drop(self, slot: int) -> None:
        """End the track of a slot, which is free then; ValueError where there is none."""
        slot = check_count("slot", slot, least=0)
        if not (0 <= slot < self._slots.size and self.active[slot]):
            raise ValueError(
                f"slot {slot} has no track: those that have one are "
                f"{', '.join(map(str, np.flatnonzero(self.active))) or 'none'}"
            )
        self._active[slot] = self._new[slot] = False
        self._waiting.pop(slot, None)
        self._keys.pop(slot, None)

    def _scan(self, frames: Iterable[Image]) -> Generator[Chunk]:
        first = self._last[None]
        if self._active.any():  # tracks that go on, also in the first frame
            yield self._track(first)
        else:
            self._start(0)
            yield self._chunk(first, self._init())
        for stack in ahead(chunks(frames, self._slots.length)):
            while len(stack):
                # Where a track starts, a chunk ends.
                later = [frame + 1 - self._yielded for frame in self._waiting.values()]
                count = min([len(stack), *later])
                yield self._track(stack[:count])
                stack = stack[count:]

    def _track(self, frames: NDArray[np.uint8]) -> Chunk:
        """Step the tracks, those that were added in the last frame, too, and start others."""
        if self._new.any() and self._yielded:
            self._init()
        stepped = self._active.copy()
        rows = self._slots.rows(self._slots.scan(frames, stepped))
        self._last = frames[-1]
        self._start(self._yielded + len(frames) - 1)
        if not self._new.any():
            return self._chunk(frames, rows)

        def with_first(of_all: NDArray[np.generic], first: NDArray[np.generic]) -> NDArray[Any]:
            of_all[~stepped, -1] = first[~stepped, 0]
            return of_all

        return self._chunk(frames, jax.tree.map(with_first, rows, self._init()))

    def _start(self, frame: int) -> None:
        """Let the tracks that start in this frame be new."""
        for slot in [slot for slot, start in self._waiting.items() if start == frame]:
            del self._waiting[slot]
            self._new[slot] = True

    def _init(self) -> StepInfo:
        """Start the new tracks in the last frame: their rows."""
        records = self._slots.init(self._last, self._boxes, self._new, self._keys)
        self._active |= self._new
        self._new[:] = False
        self._keys.clear()
        return self._slots.rows(records)

    def _chunk(self, frames: NDArray[np.uint8], rows: StepInfo) -> Chunk:
        chunk = Chunk(self._yielded, frames, Track(*rows), self._active.copy())
        self._yielded += len(frames)
        return chunk


def track_stream(
    frames: Iterable[Image],
    boxes: BoxLike | Sequence[BoxLike],
    keys: jax.Array | None = None,
    config: Config = Config(),
    *,
    slots: int | None = None,
    chunk: int | None = None,
    states: Sequence[State] = (),
) -> Stream:
    """Track boxes through frames as they come, chunk by chunk.

        for chunk in dcs_jax.track_stream(source, [(99, 146, 48, 64)]):
            chunk.track.boxes  # [S, n, 4], of the frames from chunk.start on

    The same boxes as `track_batch` and `track_sequence`, in the same sense, whatever the length of
    the chunks. While
    one is tracked, a thread reads the frames of the next. Memory: the states and two chunks,
    however many frames there are.

    The first chunk is the first frame alone. Where the source breaks, what came before it is
    tracked and yielded; then its exception is raised.

    frames: any iterable of uint8 images, [H, W] grey or [H, W, 3] RGB, all of one shape. The first
        is read at once.
    boxes: [B, 4], x, y, w, h in pixels in the first frame, as for `track_batch`.
    keys: one for all, by default `jax.random.key(0)`, or [B], one each. With one for all, so are
        the features of tracks that are added later; else they bring a key.
    config: settings, as for `track_batch`; its numbers may be arrays [S].
    slots: S, how many tracks there can be at a time, at least B, at most 10 000; by default B.
        Tracks that come and go compile nothing, and an empty slot takes no time.
    chunk: frames in a chunk; by default 32, fewer where they have more than 32 MiB. At most 1 GiB
        of frames.
    states: tracks that go on, as `Stream.state` or `load` gives them: they are followed into the
        first frame, and have the first slots. `boxes` may then be empty. The boxes are those of one
        run, in the same sense.

    Raises ValueError, before any compilation, where an argument is not as stated; while the stream
    runs, where a frame is not.
    """
    try:
        source = iter(frames)
    except TypeError:
        raise ValueError(f"frames must be an iterable of images, but is {shown(frames)}") from None
    nothing: Any = object()
    first = next(source, nothing)
    if first is nothing:
        raise ValueError("frames is empty: expected at least one frame")
    check_frame(first)
    states = list(states)
    if states and not len(boxes):
        boxes = np.empty((0, 4), np.float32)
    else:
        boxes = check_boxes(boxes, first.shape)
    count = len(states) + len(boxes)
    own_key = keys is not None
    keys = check_keys(keys, len(boxes))
    size = count if slots is None else check_count("slots", slots, most=MOST_SLOTS)
    if chunk is not None:
        chunk = check_count("chunk", chunk)
        most = max(1, LARGEST_CHUNK // math.prod(first.shape))
        if chunk > most:
            raise ValueError(
                f"chunk must be at most {most} frames of the shape {first.shape}, which are "
                f"{LARGEST_CHUNK // 2**20} MiB, but is {chunk}"
            )
    if size < count:
        raise ValueError(f"slots is {size}, but there are {count} boxes and states")
    for number, state in enumerate(states):
        if not isinstance(state, State):
            raise ValueError(f"states[{number}] must be a dcs_jax.State, but is {shown(state)}")
    # In a state only the size of the initial box counts.
    initial = [np.r_[0, 0, np.asarray(state.initial_size)] for state in states]
    resolved = resolve_all(config, np.asarray([*initial, *boxes], np.float32))
    if keys.ndim:
        keys = keys[np.clip(np.arange(size) - len(states), 0, len(boxes) - 1)]
    elif states and not _have_one_pool(states, draw(keys, resolved) if own_key else None):
        keys = jnp.broadcast_to(keys, (size,))  # each with a pool of its own
    tracks = Slots(size, first.shape, keys, resolved, length=chunk, states=states)
    return Stream(_same_shape(source, first), first, boxes, tracks, config, len(states))


def _have_one_pool(states: Sequence[State], drawn: Pool | None) -> bool:
    """Whether all states have the same features, those drawn if there are any."""
    pools = [drawn or states[0].pool, *(state.pool for state in states)]
    return all(map(np.array_equal, jax.tree.leaves(pools[:1] * len(pools)), jax.tree.leaves(pools)))


def _same_shape(frames: Iterable[Image], first: Image) -> Iterator[Image]:
    """The frames; ValueError at one of another shape than the first."""
    for number, frame in enumerate(frames, 1):
        check_frame(frame)
        if frame.shape != first.shape:
            raise ValueError(
                f"all frames must have one shape: the first has {first.shape}, frame {number} has "
                f"{frame.shape}"
            )
        yield frame
