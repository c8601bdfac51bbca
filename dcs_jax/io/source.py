"""What every source of frames is: a folder of images, a video file, a stream."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]  # [H, W, 3], RGB
FOLDER_FPS = 30.0  # of what has no frame rate


class BrokenSource(ValueError):  # noqa: N818 (named after what is broken)
    """The source fails after some good frames.

    frame: index of the first frame that cannot be read.
    """

    def __init__(self, message: str, frame: int) -> None:
        super().__init__(message)
        self.frame = frame


class FrameSource(ABC):
    """Frames of a folder, a video or a stream. Iterating yields [H, W, 3] uint8 RGB.

    name: path or address, for messages.
    shape: (H, W, 3).
    start: index of the first frame, counted from 0.
    length: number of frames from start to end; None for a stream, which does not announce it.
    fps: frames per second at which the source is meant to be shown.
    notes: what a user should know of how the frames are read, a sentence each; complete when all
        frames are read.

    Iterating raises `BrokenSource` at a frame that cannot be read, after the good ones before it.
    """

    name: str
    shape: tuple[int, int, int]
    start: int
    length: int | None
    fps: float
    notes: list[str]

    @abstractmethod
    def __iter__(self) -> Iterator[Image]: ...


class StoredSource(FrameSource):
    """The frames `start` to `end` of a folder or video file, which can be read more than once.

    path: folder of the images, or the video file.
    total: number of frames of the whole folder or video.
    """

    path: Path
    length: int
    total: int


def check_range(path: Path, start: int, end: int | None, total: int | None) -> None:
    """ValueError unless frames `start` to `end` are there; total: None where it is not known."""
    known = f"{path} has {total} frames, but the " if total is not None else "the "
    if start < 0 or (total is not None and start >= total):
        raise ValueError(f"{known}start is {start}: frames are counted from 0")
    if end is not None and (end <= start or (total is not None and end > total)):
        raise ValueError(
            f"{known}range is {start} to {end}: the end is exclusive and must be after the start"
        )
