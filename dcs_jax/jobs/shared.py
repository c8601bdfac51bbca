"""Frames that are decoded once for several readers."""

import math
import threading
from collections import deque
from collections.abc import Iterator

from dcs_jax.io.frames import BrokenSource, Frame, FrameSource


class SharedFrames:
    """The frames of a source for readers that start and end where they like.

    Kept are the frames between the reader that is furthest behind and the one ahead: where the one
    behind always reads next, that is a chunk, whatever the length of the video. Readers may be in
    threads of their own.
    """

    def __init__(self, source: FrameSource) -> None:
        self._source = source
        self._decoding = iter(source)
        self._kept: deque[Frame] = deque()
        self._next = source.start  # index of the next frame to decode; those before it are kept
        self._places: list[float] = []  # the frame that each reader reads next
        self._lock = threading.Lock()

    def reader(self, start: int, end: int | None) -> Iterator[Frame]:
        """The frames from `start` to before `end`, None for all.

        All readers have to be made before any of them is read. Reading raises what the source
        raises, and a `BrokenSource` where the source is at its end too early.
        """
        self._places.append(start)
        return self._read(len(self._places) - 1, start, end)

    def _read(self, reader: int, start: int, end: int | None) -> Iterator[Frame]:
        index = start
        try:
            while end is None or index < end:
                with self._lock:
                    frame = self._frame(index)
                    self._places[reader] = index + 1
                if frame is None:
                    break
                yield frame
                index += 1
        finally:
            self._places[reader] = math.inf
        if index == start or (end is not None and index < end):
            raise BrokenSource(
                f"{self._source.path} has {self._next} frames, but the range is {start} to "
                f"{'its end' if end is None else end}",
                index,
            )

    def _frame(self, index: int) -> Frame | None:
        """Frame `index`, decoded now or kept; None if the source ends before it."""
        while self._next <= index:
            frame = next(self._decoding, None)
            if frame is None:
                return None
            self._kept.append(frame)
            self._next += 1
            self._forget()
        return self._kept[index - self._next]

    def _forget(self) -> None:
        """Drop the frames that no reader will read any more."""
        while self._kept and self._next - len(self._kept) < min(self._places):
            self._kept.popleft()
