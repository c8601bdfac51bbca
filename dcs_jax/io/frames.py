"""Frames from a folder of images or a video file, one at a time: `open_source`.

A source is cheap to open, and is checked then, so that errors that can be found early are reported
before anything is tracked. It can be iterated over more than once.
"""

from pathlib import Path

from dcs_jax.io.images import ImageFolder, is_pattern
from dcs_jax.io.live import is_stream, open_stream
from dcs_jax.io.source import BrokenSource, FrameSource, Image, StoredSource
from dcs_jax.io.video import VideoFile

__all__ = ["BrokenSource", "FrameSource", "Image", "StoredSource", "open_frames", "open_source"]


def open_frames(
    source: str, start: int = 0, end: int | None = None, raw: str | None = None
) -> FrameSource:
    """`open_source`, or a stream: a camera's number, an address, "-" or a named pipe.

    raw: WxH or WxH:FORMAT where a pipe is bare pixels (see `io.live.open_stream`).

    Raises ValueError as they do, and where a stream is to start later than it does.
    """
    if not is_stream(source):
        if raw is not None:
            raise ValueError(f"--raw is for standard input and pipes, but the source is {source}")
        return open_source(source, start, end)
    if start:
        raise ValueError(f"{source} is a stream, which starts at 0, but the start is {start}")
    if end is not None and end <= 0:
        raise ValueError(f"the range is 0 to {end}: the end is exclusive and must be after it")
    return open_stream(source, end, raw)


def open_source(path: str | Path, start: int = 0, end: int | None = None) -> StoredSource:
    """Open the frames `start` (inclusive) to `end` (exclusive, None for all) of a folder or video.

    The images of a folder, in natural order (img2 before img10), are in the folder itself or in its
    subfolder `img` (the layout of OTB); img_%04d.png names those that differ in a number. Grey
    images become RGB with equal channels, and the range of those with more than 8 bits becomes 0 to
    255. Images and videos are turned as they are marked, interlaced videos deinterlaced.

    Raises:
        ValueError: the file is missing or not a video; the folder has no images; images cannot be
            read or differ in size (checked from `start` to `end`); the range is empty or extends
            beyond the last frame.
    """
    path = Path(path)
    if is_pattern(path):
        return ImageFolder(path, start, end)
    if not path.exists():
        raise ValueError(f"{path} does not exist: expected a video file or a folder of images")
    if path.is_dir():
        inner = path / "img"
        return ImageFolder(inner if inner.is_dir() else path, start, end)
    return VideoFile(path, start, end)
