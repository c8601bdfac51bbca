"""Frames from a folder of images or a video file, one at a time.

A source is cheap to open, and is checked then, so that errors that can be found early are reported
before anything is tracked. It can be iterated over more than once.
"""

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from dcs_jax.io.image_size import image_size, is_cut_off

Image = NDArray[np.uint8]  # [H, W, 3], RGB
Item = TypeVar("Item")

IMAGE_SUFFIXES = frozenset(
    (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp", ".ppm", ".pgm", ".jp2")
)
_ALIGNMENT = 64  # bytes, of an array that JAX does not copy
FOLDER_FPS = 30.0  # a folder of images has no frame rate
# The number of frames that a container announces may be an estimate from its duration: a video
# that is at most this many frames shorter counts as complete.
ANNOUNCED_SLACK = 2


class BrokenSource(ValueError):  # noqa: N818 (named after what is broken)
    """The source fails after some good frames.

    frame: index of the first frame that cannot be read.
    """

    def __init__(self, message: str, frame: int) -> None:
        super().__init__(message)
        self.frame = frame


class FrameSource(ABC):
    """The frames `start` to `end` of a folder or video. Iterating yields [H, W, 3] uint8 RGB.

    path: folder of the images, or the video file.
    shape: (H, W, 3).
    start: index of the first frame, counted from 0.
    length: number of frames from start to end, None for a video that does not announce it.
    total: number of frames of the whole folder or video, None likewise.
    fps: frames per second at which the source is meant to be shown.

    Iterating raises `BrokenSource` at a frame that cannot be read, after the good ones before it.
    """

    path: Path
    shape: tuple[int, int, int]
    start: int
    length: int | None
    total: int | None
    fps: float

    @abstractmethod
    def __iter__(self) -> Iterator[Image]: ...


class ImageFolder(FrameSource):
    """A folder of images in natural order. See `open_source`."""

    def __init__(self, path: Path, start: int, end: int | None) -> None:
        images = _list_images(path)
        self.total = len(images)
        _check_range(path, start, end, self.total)
        self.path = path
        self.start = start
        self.fps = FOLDER_FPS
        self._images = images[start:end]
        self.length = len(self._images)
        size = image_size(self._images[0])
        for image in self._images[1:]:
            if image_size(image) != size:
                raise ValueError(
                    f"{image} has {_text(image_size(image))} pixels, but the frames before it "
                    f"have {_text(size)}: all images of a folder must have the same size"
                )
        self.shape = (*size, 3)

    def __iter__(self) -> Iterator[Image]:
        flags = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION
        for index, path in enumerate(self._images, self.start):
            try:
                content = path.read_bytes()
            except OSError as error:
                raise BrokenSource(f"{path} (frame {index}): {error.strerror}", index) from error
            if is_cut_off(content):
                raise BrokenSource(f"{path} (frame {index}) is cut off", index)
            image = cv2.imdecode(np.frombuffer(content, np.uint8), flags) if content else None
            if image is None:
                raise BrokenSource(f"{path} (frame {index}) cannot be decoded", index)
            yield image.astype(np.uint8, copy=False)


class VideoFile(FrameSource):
    """A video file that OpenCV can decode. See `open_source`."""

    def __init__(self, path: Path, start: int, end: int | None) -> None:
        self.path = path
        self.start = start
        capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
        good, frame = capture.read()
        self.fps = capture.get(cv2.CAP_PROP_FPS) or FOLDER_FPS
        announced = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        capture.release()
        if not good:
            raise ValueError(
                f"{path} cannot be read as a video: expected a video file or a folder of images"
            )
        self.total = announced if announced > 0 else None
        _check_range(path, start, end, self.total)
        self._end = end
        stop = end if end is not None else self.total
        self.length = None if stop is None else stop - start
        rows, columns = frame.shape[:2]
        self.shape = (rows, columns, 3)

    def __iter__(self) -> Iterator[Image]:
        capture = cv2.VideoCapture(str(self.path), cv2.CAP_FFMPEG)
        try:
            index = 0
            time = 0.0  # of the last good frame, milliseconds
            # Decoding up to the start is the only way of seeking that is exact for every codec.
            while self._end is None or index < self._end:
                if not capture.grab():
                    break
                time = capture.get(cv2.CAP_PROP_POS_MSEC)
                if index >= self.start:
                    good, image = capture.retrieve()
                    if not good:
                        break
                    yield cv2.cvtColor(image, cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)
                index += 1
            self._check_end(index, time)
        finally:
            capture.release()

    def _check_end(self, index: int, time: float) -> None:
        """Raise if the video is broken at frame `index`, where it stops, and not at its end."""
        if self._end is not None and index < self._end:
            expected = self._end
        elif self._end is None and self.total is not None:
            # With a varying frame rate an estimated count is wrong, but the time of the last frame
            # is not: the video is complete if either of them says so.
            shown = max(index, round(time / 1000 * self.fps) + 1)
            expected = self.total if self.total - shown > ANNOUNCED_SLACK else index
        else:
            expected = index
        if index <= self.start:
            raise ValueError(
                f"{self.path} has {index} readable frames, but the start is {self.start}"
            )
        if index < expected:
            raise BrokenSource(
                f"{self.path} breaks off: frame {index} cannot be decoded, "
                f"expected {expected} frames",
                index,
            )


def open_source(path: str | Path, start: int = 0, end: int | None = None) -> FrameSource:
    """Open the frames `start` (inclusive) to `end` (exclusive, None for all) of a folder or video.

    The images of a folder, in natural order (img2 before img10), are in the folder itself or in its
    subfolder `img` (the layout of OTB). Grey images become RGB with equal channels.

    Raises:
        ValueError: the file is missing or not a video; the folder has no images; images cannot be
            read or differ in size (checked from `start` to `end`); the range is empty or extends
            beyond the last frame.
    """
    path = Path(path)
    if not path.exists():
        raise ValueError(f"{path} does not exist: expected a video file or a folder of images")
    if path.is_dir():
        inner = path / "img"
        return ImageFolder(inner if inner.is_dir() else path, start, end)
    return VideoFile(path, start, end)


def _list_images(folder: Path) -> list[Path]:
    """The images of a folder in natural order; ValueError if there are none."""
    images = [path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES]
    if not images:
        raise ValueError(f"{folder} holds no images (jpg, png, bmp, tif, webp, ppm or jp2)")
    return sorted(images, key=lambda path: _natural(path.name))


def chunks(frames: Iterable[Image], length: int) -> Iterator[NDArray[np.uint8]]:
    """Stack frames to [length, H, W, 3]; the last chunk may be shorter.

    If reading a frame raises an exception, the frames before it are yielded first.
    """
    stack: NDArray[np.uint8] | None = None
    filled = 0
    broken: Exception | None = None
    rest = iter(frames)
    while True:
        try:
            frame = next(rest)
        except StopIteration:
            break
        except Exception as error:  # raised below, after the frames before it
            broken = error
            break
        if stack is None:
            stack = _aligned((length, *frame.shape))
        stack[filled] = frame
        filled += 1
        if filled == length:
            yield stack
            stack, filled = None, 0
    if stack is not None:
        yield stack[:filled]
    if broken is not None:
        raise broken


def _aligned(shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """An array that JAX reads where it is: others it copies."""
    memory = np.empty(math.prod(shape) + _ALIGNMENT, np.uint8)
    first = -memory.ctypes.data % _ALIGNMENT
    return memory[first : first + math.prod(shape)].reshape(shape)


def ahead(items: Iterator[Item]) -> Iterator[Item]:
    """The same items; a thread makes the next one while the current one is used.

    An exception that is raised by making an item is raised in its place.
    """
    with ThreadPoolExecutor(1, "dcs_jax.ahead") as thread:
        future = thread.submit(next, items, None)
        while (item := future.result()) is not None:
            future = thread.submit(next, items, None)
            yield item


def _check_range(path: Path, start: int, end: int | None, length: int | None) -> None:
    known = f"{path} has {length} frames, but the " if length is not None else "the "
    if start < 0 or (length is not None and start >= length):
        raise ValueError(f"{known}start is {start}: frames are counted from 0")
    if end is not None and (end <= start or (length is not None and end > length)):
        raise ValueError(
            f"{known}range is {start} to {end}: the end is exclusive and must be after the start"
        )


def _natural(name: str) -> tuple[list[str | int], str]:
    """Sort key that compares runs of digits as numbers, and equal keys by the name itself."""
    # re.split with a group alternates text and digits, so text is never compared with a number.
    parts = re.split(r"(\d+)", name.lower())
    return [int(part) if part.isdecimal() else part for part in parts], name


def _text(size: tuple[int, int]) -> str:
    return f"{size[1]} x {size[0]}"
