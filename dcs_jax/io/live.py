"""Frames that come by themselves: cameras, network streams, pipes. They are read once."""

import errno
import functools
import itertools
import os
import re
import stat
import sys
import threading
from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack
from typing import Any

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from dcs_jax.io.source import FOLDER_FPS, BrokenSource, FrameSource, Image
from dcs_jax.io.video import (
    frame_rate,
    noted_frames,
    open_container,
    to_rgb,
    video_stream,
)

PATIENCE = 10.0  # seconds without a frame after which a camera or stream is given up
# What is lost there if nobody looks; others wait for their reader.
_LIVE_PROTOCOLS = frozenset(("rtsp", "rtsps", "rtmp", "rtmps", "udp", "rtp", "srt"))
# As soon as a frame is there it is wanted: nothing is collected first.
_AT_ONCE = {"fflags": "nobuffer", "flags": "low_delay", "rtsp_transport": "tcp"}

Convert = Callable[[], Image]


def is_stream(source: str) -> bool:
    """Whether a source is none of files: a camera's number, an address, "-" or a named pipe."""
    if source == "-" or source.isdecimal() or "://" in source:
        return True
    try:
        return stat.S_ISFIFO(os.stat(source).st_mode)
    except OSError:
        return False


def open_stream(
    source: str, most: int | None = None, raw: str | None = None, patience: float = PATIENCE
) -> "StreamSource":
    """Open a stream, and wait for its first frame.

    source: a camera's number, an address such as rtsp://…, "-" for standard input, or a named pipe.
    most: frames after which it ends; by default when the source does.
    raw: WxH or WxH:FORMAT for a pipe of bare pixels, by default rgb24; FORMAT as FFmpeg names it.
    patience: seconds without a frame after which it is given up; a pipe may take any time.

    Raises ValueError where it cannot be opened or gives no frame.
    """
    if source.isdecimal():
        return CameraSource(int(source), most, patience)
    return EncodedSource(source, most, raw, patience)


class StreamSource(FrameSource):
    """A stream: it has no length, and is read once. See `open_stream`.

    live: whether frames are lost where nobody takes them. They then are dropped from the opening
        on, all but the last one, so that no delay builds up.
    dropped: number of frames dropped since the first was taken.
    positions: for each frame taken, its number among all that came from the first of them on,
        counted from 0; who reads them, takes them from the left.
    """

    live: bool

    def __init__(self, name: str, most: int | None, patience: float) -> None:
        self.name, self.start, self.length, self.notes = name, 0, None, []
        self.dropped = 0
        self.positions: deque[int] = deque()
        self._most = most
        self._patience = patience
        self._begun = self._ended = False

    def _look(self) -> None:
        """Wait for the first frame, which says the shape."""
        self._source = arriving = self._arrive()
        try:
            first = next(arriving, None)
        except OSError as error:
            raise ValueError(f"{self.name} gives no frame: {error}") from None
        if first is None:
            raise ValueError(f"{self.name} gives no frame: expected a camera or a video stream")
        rows, columns, _ = first().shape
        self.shape = (rows, columns, 3)
        numbered = enumerate(itertools.chain([first], arriving))
        self._arriving = self._newest(numbered) if self.live else numbered

    @abstractmethod
    def _arrive(self) -> Generator[Convert]:
        """Every frame, as soon as it is there, converted when called; raises where it fails.

        Closes what it reads from.
        """

    def __iter__(self) -> Iterator[Image]:
        if self._begun:
            raise ValueError(f"{self.name} can be read once only: it is no file")
        self._begun = True
        try:
            yield from self._taken()
        finally:
            self._ended = True
            if not self.live:  # else the thread that reads closes it
                self._source.close()

    def _taken(self) -> Iterator[Image]:
        first = position = None
        taken = 0
        while self._most is None or taken < self._most:
            try:
                position, convert = next(self._arriving)
            except StopIteration:
                return
            except (ValueError, OSError) as error:
                so_far = f"after {taken} frame{'s' * (taken != 1)}"
                raise BrokenSource(f"{self.name} breaks off {so_far}: {error}", taken) from error
            image = convert()
            if image.shape != self.shape:
                raise BrokenSource(
                    f"{self.name}: frame {taken} has the shape {image.shape}, but the first has "
                    f"{self.shape}",
                    taken,
                )
            first = position if first is None else first
            self.positions.append(position - first)
            taken += 1
            self.dropped = position - first + 1 - taken
            yield image

    def _newest(self, numbered: Iterator[tuple[int, Convert]]) -> Iterator[tuple[int, Convert]]:
        """The newest frame whenever one is taken; a thread lets go of the others from now on.

        TimeoutError where none comes for too long.
        """
        arrived = threading.Condition()
        newest: deque[tuple[int, Convert]] = deque(maxlen=1)
        ended: list[Exception | None] = []

        def watch() -> None:
            error = None
            try:
                for frame in numbered:
                    with arrived:
                        newest.append(frame)
                        arrived.notify()
                    if self._ended:
                        break
                self._source.close()
            except Exception as raised:
                error = raised
            with arrived:
                ended.append(error)
                arrived.notify()

        def take() -> Iterator[tuple[int, Convert]]:
            while True:
                with arrived:
                    if not arrived.wait_for(lambda: newest or ended, self._patience):
                        raise TimeoutError(f"no frame for {self._patience:g} s")
                    if not newest:
                        if ended[0] is not None:
                            raise ended[0]
                        return
                    frame = newest.popleft()
                yield frame

        # A camera may never answer: the thread does not keep the process from ending.
        threading.Thread(target=watch, name="dcs_jax.live", daemon=True).start()
        return take()


class EncodedSource(StreamSource):
    """A network stream, or a pipe of encoded or raw video, which FFmpeg decodes."""

    def __init__(self, source: str, most: int | None, raw: str | None, patience: float) -> None:
        super().__init__("standard input" if source == "-" else source, most, patience)
        protocol = source.partition("://")[0].lower() if "://" in source else ""
        self.live = protocol in _LIVE_PROTOCOLS
        self._by_http = protocol in ("http", "https")
        options: dict[str, Any] = {} if raw is None else _raw_options(raw)
        self._files = ExitStack()
        if protocol:
            options["timeout"] = patience
            address: Any = source
        else:
            # Opened here: FFmpeg would open a pipe a second time to look what it holds.
            named = sys.stdin.fileno() if source == "-" else source
            pipe = open(named, "rb", closefd=source != "-")  # noqa: SIM115 (closed with the rest)
            address = self._files.enter_context(pipe)
        if self.live:
            options["options"] = _AT_ONCE
        expected = "an encoded video, or --raw" if not protocol else "the address of a video stream"
        with self._files:
            container = open_container(self.name, address, expected, **options)
            self._container = self._files.enter_context(container)
            self._stream = video_stream(self.name, self._container)
            if self.live:
                self._stream.thread_type = "SLICE"  # threads for whole frames give each one late
            self.fps = frame_rate(self._stream)
            self._look()
            self._files = self._files.pop_all()  # open, unless something failed

    def _arrive(self) -> Generator[Convert]:
        frames = noted_frames(self._container, self._stream, self.name, self.notes)
        try:
            for frame in frames:
                yield functools.partial(to_rgb, frame)
        except av.error.ExitError:
            raise TimeoutError(f"no data for {self._patience:g} s") from None
        except OSError as error:
            # FFmpeg 9 says this at the end of what has no stated length, sent in chunks perhaps.
            ended = error.errno == errno.EIO and (self._container.size or 0) <= 0
            if not (self._by_http and ended):
                raise
        finally:
            self._files.close()


class CameraSource(StreamSource):
    """A camera of this machine, by its number, which OpenCV knows on every system."""

    live = True

    def __init__(self, number: int, most: int | None, patience: float) -> None:
        super().__init__(f"camera {number}", most, patience)
        self._capture = cv2.VideoCapture(number)
        if not self._capture.isOpened():
            raise ValueError(
                f"camera {number} cannot be opened: expected the number of a camera that is "
                "connected and not in use, the first is 0"
            )
        self.fps = self._capture.get(cv2.CAP_PROP_FPS) or FOLDER_FPS
        self._look()

    def _arrive(self) -> Generator[Convert]:
        try:
            while True:
                good, image = self._capture.read()
                if not good:
                    raise OSError("it gives no more frames")
                yield functools.partial(_to_rgb, image)
        finally:
            self._capture.release()


def _to_rgb(bgr: NDArray[Any]) -> Image:
    return cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)


def _raw_options(raw: str) -> dict[str, Any]:
    match = re.fullmatch(r"(\d+)x(\d+)(?::(\w+))?", raw)
    if match is None or "0" in match.groups():
        raise ValueError(f"--raw is {raw!r}: expected WxH or WxH:FORMAT, as in 640x480:rgb24")
    columns, rows, pixels = match.groups()
    options = {"video_size": f"{columns}x{rows}", "pixel_format": pixels or "rgb24"}
    return {"format": "rawvideo", "options": options}
