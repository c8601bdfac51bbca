"""Any frame of a clip at once, exact to the frame: the same ones as `open_source` yields.

A video is decoded from the keyframe before. What is decoded on the way is kept around the place
that is looked at, as it comes from the decoder: it is converted when it is asked for.
"""

import threading
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path

import cv2
from av.video.frame import VideoFrame

from dcs_jax.io.frames import BrokenSource, Image, open_source
from dcs_jax.io.images import ImageFolder
from dcs_jax.io.video import VideoFile, to_rgb
from dcs_jax.label.index import count_video, index_video
from dcs_jax.label.previews import Previews
from dcs_jax.label.reader import VideoReader, WrongIndex

JPEG_QUALITY = 90
CACHE_BYTES = 2**28  # of decoded frames: 80 of 1920 x 1080
_REST = 0.5  # seconds without a request, after which previews are made
_AHEAD, _BEHIND = 24, 12  # frames around the last one that are decoded while idle


class Clip:
    """The frames of a video file or a folder of images by their index, counted from 0.

    shape: (H, W, 3). length: number of frames that can be read; a video that breaks off has those
    before. fps: frames per second. notes: what a user should know, a sentence each.

    It may be used from several threads.
    """

    def __init__(self, path: str | Path, cache_bytes: int = CACHE_BYTES) -> None:
        """Raises ValueError as `open_source` does."""
        self.source = open_source(path)
        self.name = self.source.name
        self.shape = self.source.shape
        self.fps = self.source.fps
        self.notes: list[str] = []
        self._video: _Video | None = None
        if isinstance(self.source, VideoFile):
            self._video = _Video(self.source, cache_bytes)
            if not self.source.whole:
                self.notes.append(
                    f"{self.name} breaks off: its {self._video.length} frames can be labelled"
                )

    @property
    def length(self) -> int:
        return self.source.length if self._video is None else self._video.length

    def frame(self, index: int) -> Image:
        """The frame [H, W, 3] uint8 RGB.

        Raises ValueError where the index is out of range, `BrokenSource` where it cannot be read.
        """
        if not 0 <= index < self.length:
            raise ValueError(
                f"frame must be from 0 to {self.length - 1}, the last one, but is {index}"
            )
        if self._video is not None:
            return to_rgb(self._video.frame(index))
        assert isinstance(self.source, ImageFolder)
        return self.source.read(index)

    def frames(self, start: int, end: int) -> Iterator[Image]:
        """The frames `start` (inclusive) to `end` (exclusive), in order; raises as `frame` does.

        A video is opened anew for them: who looks at other frames meanwhile does not wait.
        """
        if self._video is not None:
            yield from map(to_rgb, self._video.frames(start, end))
        else:
            yield from map(self.frame, range(start, end))

    def jpeg(self, index: int) -> bytes:
        """The frame as a JPEG file; raises as `frame` does."""
        bgr = cv2.cvtColor(self.frame(index), cv2.COLOR_RGB2BGR)
        done, encoded = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        assert done
        return encoded.tobytes()

    def preview(self, index: int) -> bytes | None:
        """A small image of the frame as a JPEG file, where it is there at once; else None."""
        return None if self._video is None else self._video.previews.get(index)

    def set_busy(self, busy: bool) -> None:
        """Say whether the machine has other work than to prepare what may be asked for."""
        if self._video is not None:
            self._video.set_busy(busy)

    def close(self) -> None:
        """End its threads; it has no frames any more."""
        if self._video is not None:
            self._video.close()


class _Video:
    """The decoded frames of a video around the place that is looked at."""

    def __init__(self, source: VideoFile, cache_bytes: int) -> None:
        self._source, self._bytes = source, cache_bytes
        self._index = index_video(source)
        self._reader = VideoReader(source, self._index)
        self._counted = False  # whether the index is known to be right
        self._kept: dict[int, VideoFrame] = {}
        self._place, self._step = 0, 1
        self._decoding = threading.Lock()
        self._state = threading.Condition()
        self._waiting = 0  # requests
        self._closed = self._busy = False
        self._asked = 0.0  # when a frame was asked for
        self.previews = Previews()
        self._rest: Iterator[VideoFrame] | None = self.frames(0, self.length)
        threading.Thread(target=self._look_ahead, daemon=True, name="frames").start()

    @property
    def length(self) -> int:
        return self._index.length

    def frame(self, index: int) -> VideoFrame:
        with self._state:
            if index != self._place:
                self._step = 1 if index > self._place else -1
            self._place = index
            self._waiting += 1
            self._asked = time.monotonic()
        try:
            kept = self._kept.get(index)
            if kept is None:
                with self._decoding:
                    kept = self._kept.get(index) or self._decode(index)
                assert kept is not None
            return kept
        finally:
            with self._state:
                self._waiting -= 1
                self._state.notify_all()

    def frames(self, start: int, end: int) -> Iterator[VideoFrame]:
        reader = VideoReader(self._source, self._index)
        try:
            for wanted in range(start, end):
                ((_, frame),) = deque(reader.frames(wanted), maxlen=1)
                self.previews.add(wanted, frame)
                yield frame
        except WrongIndex:
            raise self._broken(wanted) from None
        finally:
            reader.close()

    def set_busy(self, busy: bool) -> None:
        with self._state:
            self._busy = busy
            self._state.notify_all()

    def close(self) -> None:
        with self._state:
            self._closed = True
            self._state.notify_all()
        with self._decoding:
            self._reader.close()
            self._kept.clear()

    def _decode(self, index: int, idle: bool = False) -> VideoFrame | None:
        """The frame; None where it was decoded while idle, and another was asked for meanwhile."""
        while True:
            if self._closed or index >= self.length:
                raise self._broken(index)
            try:
                for number, frame in self._reader.frames(index):
                    self._keep(number, frame)
                    if number == index:
                        return frame
                    if idle and self._waiting:
                        return None
            except WrongIndex:
                if self._counted:
                    raise self._broken(index) from None
                self._index, self._counted = count_video(self._source), True
                self._reader = VideoReader(self._source, self._index)
                self._kept.clear()

    def _broken(self, index: int) -> BrokenSource:
        return BrokenSource(f"{self._source.name}: frame {index} cannot be decoded", index)

    def _keep(self, number: int, frame: VideoFrame) -> None:
        """Keep a frame, and let those go that are the farthest from the place."""
        self._kept[number] = frame
        most = max(self._bytes // _bytes_of(frame), _AHEAD + _BEHIND + 1)
        while len(self._kept) > most:
            del self._kept[max(self._kept, key=lambda kept: abs(kept - self._place))]

    def _look_ahead(self) -> None:
        """While nothing is asked for, decode the frames around the place, then make previews."""
        failed: set[int] = set()

        def lacking() -> int | None:
            wanted = self._wanted()
            return next((n for n in wanted if n not in self._kept and n not in failed), None)

        while True:
            with self._state:
                self._state.wait_for(
                    lambda: (
                        self._closed
                        or not (self._waiting or (self._rest_waits() and lacking() is None))
                    ),
                    None if self._rest is None else _REST,
                )
                if self._closed:
                    return
                index = lacking()
                idle = not (self._waiting or self._rest_waits())
            if index is None:
                if idle:
                    self._make_preview()
                continue
            with self._decoding:
                if index in self._kept:
                    continue
                try:
                    self._decode(index, idle=True)
                except ValueError:  # it is reported where it is asked for
                    failed.add(index)

    def _rest_waits(self) -> bool:
        """Whether no previews are to be made now."""
        return self._rest is None or self._busy or time.monotonic() < self._asked + _REST

    def _make_preview(self) -> None:
        assert self._rest is not None
        try:
            if self.previews.full or next(self._rest, None) is None:
                self._rest = None
        except ValueError:  # it is reported where it is asked for
            self._rest = None

    def _wanted(self) -> list[int]:
        """Frames around the place; the ones that are shown next come first."""
        place, step = self._place, self._step
        ahead = range(place + step, place + (_AHEAD + 1) * step, step)
        if step < 0:
            # They are decoded upwards, from a keyframe.
            ahead = range(place - _AHEAD, place)
        behind = range(place - step, place - (_BEHIND + 1) * step, -step)
        return [number for number in (*ahead, *behind) if 0 <= number < self.length]


def _bytes_of(frame: VideoFrame) -> int:
    return sum(plane.buffer_size for plane in frame.planes)
