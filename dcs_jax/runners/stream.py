"""Tracks through frames as they come, in memory that does not grow with their number."""

import inspect
import math
from collections.abc import Generator, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import jax
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
from dcs_jax.io.frames import Image, ahead, chunks
from dcs_jax.runners.slots import Records, Slots
from dcs_jax.types import BoxLike, Track

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
    ) -> None:
        """What `track_stream` has checked; frames: those after the first."""
        self._slots = slots
        self._config = config
        self._boxes = np.ones((slots.size, 4), np.float32)
        self._boxes[: len(boxes)] = boxes
        self._active = np.zeros(slots.size, bool)
        self._new = np.arange(slots.size) < len(boxes)
        self._keys: dict[int, jax.Array] = {}
        self._last = first  # the last frame that was yielded
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
        """The slots that will have a track in the next chunk: [S]."""
        return self._active | self._new

    def add(self, box: BoxLike, key: jax.Array | None = None) -> int:
        """Start a track in the last frame that was yielded; it is followed from the next on.

        box: [4], x, y, w, h in pixels in that frame.
        key: of its features, if each track has its own; None if all share one pool.

        Returns its slot, the first one that is free. Raises ValueError where none is, where an
        argument is not as stated, and after the end of the stream.
        """
        if inspect.getgeneratorstate(self._chunks) == inspect.GEN_CLOSED:
            raise ValueError(
                "the stream has ended: a track that is added now would never be followed"
            )
        check_box(box, self._last.shape)
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
        self._new[slot] = True
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
        self._keys.pop(slot, None)

    def _scan(self, frames: Iterable[Image]) -> Generator[Chunk]:
        first = self._last
        yield self._chunk(0, first[None], self._init())
        start = 1
        for stack in ahead(chunks(frames, self._slots.length)):
            if self._new.any():
                self._init()
            records = self._slots.scan(stack, self._active)
            self._last = stack[-1]
            yield self._chunk(start, stack, records)
            start += len(stack)

    def _init(self) -> Records:
        """Start the new tracks in the last frame."""
        records = self._slots.init(self._last, self._boxes, self._new, self._keys)
        self._active |= self._new
        self._new[:] = False
        self._keys.clear()
        return records

    def _chunk(self, start: int, frames: NDArray[np.uint8], records: Records) -> Chunk:
        track = Track(*self._slots.rows(records))
        return Chunk(start, frames, track, self._active.copy())


def track_stream(
    frames: Iterable[Image],
    boxes: BoxLike | Sequence[BoxLike],
    keys: jax.Array | None = None,
    config: Config = Config(),
    *,
    slots: int | None = None,
    chunk: int | None = None,
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
    boxes = check_boxes(boxes, first.shape)
    keys = check_keys(keys, len(boxes))
    size = len(boxes) if slots is None else check_count("slots", slots, most=MOST_SLOTS)
    if chunk is not None:
        chunk = check_count("chunk", chunk)
        most = max(1, LARGEST_CHUNK // math.prod(first.shape))
        if chunk > most:
            raise ValueError(
                f"chunk must be at most {most} frames of the shape {first.shape}, which are "
                f"{LARGEST_CHUNK // 2**20} MiB, but is {chunk}"
            )
    if size < len(boxes):
        raise ValueError(f"slots is {size}, but there are {len(boxes)} boxes")
    if keys.ndim:
        keys = keys[np.minimum(np.arange(size), len(boxes) - 1)]
    resolved = resolve_all(config, boxes)
    tracks = Slots(size, first.shape, keys, resolved, length=chunk)
    return Stream(_same_shape(source, first), first, boxes, tracks, config)


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
