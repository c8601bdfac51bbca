"""Frames that are decoded once for several readers."""

import math
import threading
from collections import deque
from collections.abc import Iterator

from dcs_jax.io.frames import BrokenSource, FrameSource, Image


class SharedFrames:
    """The frames of a source for several readers, each with a start and an end of its own.

    The frames between the reader that is furthest behind and the one that is furthest ahead are
    kept. If the one behind always reads next, these are a chunk, however long the video is. Each
    reader may be in a thread of its own.
    """

    def __init__(self, source: FrameSource) -> None:
        self._source = source
        self._decoding = iter(source)
        self._kept: deque[Image] = deque()
        self._next = source.start  # index of the next frame to decode; those before it are kept
        self._positions: list[float] = []  # index of the frame that each reader reads next
        self._lock = threading.Lock()

    def reader(self, start: int, end: int | None) -> Iterator[Image]:
        """The frames from `start` to before `end`, None for all.

        All readers have to be made before the first of them is read. Reading raises what the source
        raises, and a `BrokenSource` where the source ends too early.
        """
        self._positions.append(start)
        return self._read(len(self._positions) - 1, start, end)

    def _read(self, reader: int, start: int, end: int | None) -> Iterator[Image]:
        index = start
        try:
            while end is None or index < end:
                with self._lock:
                    frame = self._frame(index)
                    self._positions[reader] = index + 1
                if frame is None:
                    break
                yield frame
                index += 1
        finally:
            self._positions[reader] = math.inf
        if index == start or (end is not None and index < end):
            raise BrokenSource(
                f"{self._source.name} has {self._next} frames, but the range is {start} to "
                f"{'its end' if end is None else end}",
                index,
            )

    def _frame(self, index: int) -> Image | None:
        """Image `index`, decoded now or kept; None if the source ends before it."""
        while self._next <= index:
            frame = next(self._decoding, None)
            if frame is None:
                return None
            self._kept.append(frame)
            self._next += 1
            self._forget()
        return self._kept[index - self._next]

    def _forget(self) -> None:
        """Drop the frames that all readers have read."""
        while self._kept and self._next - len(self._kept) < min(self._positions):
            self._kept.popleft()
