"""Video files, decoded by FFmpeg through PyAV.

PyAV and not OpenCV: as fast at 1920x1080, though not on small frames (`benchmarks.decode`), it says
what OpenCV hides: fields, hidden samples, the orientation, how many frames there are, and what
could not be decoded.
"""

import functools
import math
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import av
import av.filter
import numpy as np
from av.container import InputContainer
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from dcs_jax.io.source import FOLDER_FPS, BrokenSource, Image, StoredSource, check_range

# Whether a video is whole is judged by the number of frames and by the time that its container
# announces, which may be estimates: it is if it lacks at most this many frames by one of them.
SLACK = 2
_HIGHEST_FPS = 2000
# Their duration is not announced, but estimated from what is there.
_ESTIMATED = frozenset(("mpegts", "mpeg"))
# Titles and comments may be in any encoding: an error before PyAV 19, which has no such argument.
_ANY_ENCODING: dict[str, Any] = (
    {"metadata_errors": "replace"} if int(av.__version__.split(".")[0]) < 19 else {}
)


class VideoFile(StoredSource):
    """A video file that FFmpeg can decode. See `open_source`.

    whole: whether it does not break off. container: FFmpeg's name of its kind of file.
    """

    def __init__(self, path: Path, start: int, end: int | None) -> None:
        self.path, self.name = path, str(path)
        self.start = start
        self.notes = []
        container, stream = open_video(path)
        with container:
            self.fps = frame_rate(stream)
            self.container = container.format.name
            counted = _count(container, stream)
        self.total = counted.frames
        self.whole = counted.whole
        self._last_time = counted.last_time
        check_range(path, start, end, self.total if counted.whole else None)
        self._end = end
        stop = self.total if end is None else end
        self.length = max(stop - start, 0)
        first = next(self._frames(), None)
        if first is None:
            raise ValueError(f"{path} cannot be read as a video: no frame of it can be decoded")
        rows, columns, _ = first[0]().shape
        self.shape = (rows, columns, 3)
        self.notes.clear()

    def __iter__(self) -> Iterator[Image]:
        self.notes.clear()
        index, end_time = 0, -math.inf
        # Decoding up to the start is the only way of seeking that is exact for every codec.
        for image, time in self._frames():
            if self._end is not None and index >= self._end:
                return
            if index >= self.start:
                shown = image()
                if shown.shape != self.shape:
                    raise BrokenSource(
                        f"{self.path}: frame {index} has {_size(shown.shape)} pixels, but those "
                        f"before it have {_size(self.shape)}",
                        index,
                    )
                yield shown
            index, end_time = index + 1, time
        self._check_end(index, end_time)

    def _frames(self) -> Iterator[tuple[Callable[[], Image], float]]:
        """Every frame, converted when called, and its time in seconds."""
        container, stream = open_video(self.path)
        with container:
            for frame in noted_frames(container, stream, self.name, self.notes, self.whole):
                yield functools.partial(to_rgb, frame), frame.time or 0.0

    def _check_end(self, index: int, time: float) -> None:
        """Raise if the video is broken at frame `index`, where it stops, and not at its end."""
        if index <= self.start:
            raise ValueError(
                f"{self.path} has {index} readable frames, but the start is {self.start}"
            )
        expected = self.total if self._end is None else self._end
        if self._end is None and self.whole:
            # Frames before the first that can be decoded by itself are none that were lost.
            late = time < self._last_time - SLACK / self.fps
            expected = expected if late and expected - index > SLACK else index
        if index < expected or not self.whole:
            raise BrokenSource(
                f"{self.path} breaks off: frame {index} cannot be decoded, "
                f"expected {max(expected, index + 1)} frames",
                index,
            )


EXPECTED = "a video file or a folder of images"


def open_container(
    name: str, address: Any, expected: str = EXPECTED, **options: Any
) -> InputContainer:
    """Open what FFmpeg can read; ValueError where it cannot. name, expected: for the message."""
    try:
        return av.open(address, **_ANY_ENCODING, **options)
    except (av.error.FFmpegError, OSError) as error:
        reason = error.strerror
        if isinstance(error, av.error.InvalidDataError):
            reason = "no video, or one that is cut off"
        elif isinstance(error, av.error.ExitError):
            reason = f"no data for {options['timeout']:g} s"
        raise ValueError(
            f"{name} cannot be read as a video ({reason}): expected {expected}"
        ) from None


def open_video(path: Path) -> tuple[InputContainer, VideoStream]:
    """The container of a file, and its moving pictures; ValueError where it cannot be read."""
    container = open_container(str(path), f"file:{os.path.abspath(path)}")
    return container, video_stream(path, container)


def video_stream(path: Path | str, container: InputContainer) -> VideoStream:
    """The moving pictures of a file (not the cover of a song), decoded on all cores.

    Raises ValueError where there are none.
    """
    moving = [
        stream
        for stream in container.streams.video
        # No cover of a song, and no text, which FFmpeg would show as a terminal does.
        if not stream.disposition & stream.disposition.attached_pic and stream.name != "ansi"
    ]
    if not moving:
        container.close()
        raise ValueError(
            f"{path} cannot be read as a video: it holds no moving pictures, expected {EXPECTED}"
        )
    moving[0].thread_type = "AUTO"
    return moving[0]


def frame_rate(stream: VideoStream) -> float:
    """Frames per second; some containers announce the unit of their clock in its place."""
    rates = (stream.average_rate, stream.base_rate, stream.codec_context.framerate)
    return next((float(rate) for rate in rates if rate and rate <= _HIGHEST_FPS), FOLDER_FPS)


def noted_frames(
    container: InputContainer,
    stream: VideoStream,
    name: str,
    notes: list[str],
    whole: bool = True,
) -> Iterator[VideoFrame]:
    """The frames as a player shows them; in the end a note says how many could not be decoded."""
    lacking = 0

    def failed() -> None:
        nonlocal lacking
        lacking += 1

    yield from shown_frames(decoded_frames(container, stream, failed, whole), stream)
    if lacking:
        plural = "s" * (lacking != 1)
        notes.append(f"{name}: {lacking} frame{plural} could not be decoded, and left out")


def decoded_frames(
    container: InputContainer,
    stream: VideoStream,
    failed: Callable[[], None],
    whole: bool = True,
) -> Iterator[VideoFrame]:
    """The frames that are meant to be shown, and were decoded without an error.

    The others are left out, and `failed` is called for each. The caller finds by the number and the
    times of the frames whether something lacks at the end.

    whole: whether the last packet is; where the file breaks off, it is taken for half a frame.
    """
    packets = stored_packets(container, stream, failed)
    broken: OSError | None = None

    def next_packet() -> "av.Packet[Any] | None":
        nonlocal broken
        try:
            return next(packets, None)
        except OSError as error:
            broken = error
            return None

    packet = next_packet()
    end = math.inf  # frames that are shown later refer to what lacks
    while packet is not None:
        following = next_packet()
        if not whole and packet.size and (following is None or not following.size):
            end = math.inf if packet.pts is None else packet.pts
        else:
            try:
                for frame in packet.decode():
                    # FFmpeg makes up what it could not decode.
                    if not isinstance(frame, VideoFrame) or frame.is_corrupt:
                        failed()
                    elif frame.pts is None or frame.pts < end:
                        yield frame
            except av.error.InvalidDataError:
                failed()
        packet = following
    if broken is not None:
        raise broken


def stored_packets(
    container: InputContainer, stream: VideoStream, failed: Callable[[], None] = lambda: None
) -> "Iterator[av.Packet[Any]]":
    """The packets of a stream, and an empty one at the end; `failed` is called for damaged ones.

    Raises OSError where it breaks off, after the empty packet: what has come can be decoded.
    """
    packets = container.demux(stream)
    while True:
        try:
            packet = next(packets, None)
        except av.error.InvalidDataError:
            failed()
            continue
        except OSError:
            last: av.Packet[Any] = av.Packet()
            last.stream = stream
            yield last
            raise
        if packet is None:
            return
        yield packet


def shown_frames(frames: Iterator[VideoFrame], stream: VideoStream) -> Iterator[VideoFrame]:
    """The frames as a player shows them: as many, those of two fields deinterlaced.

    From the first interlaced frame on the filter keeps one frame back, of which it needs the next.
    """
    graph: av.filter.Graph | None = None
    for frame in frames:
        if graph is None and frame.interlaced_frame:
            graph = _deinterlacer(frame, stream)
        if graph is None:
            yield frame
        else:
            graph.push(frame)
            yield from _pull(graph)
    if graph is not None:
        graph.push(None)
        yield from _pull(graph)


def _deinterlacer(frame: VideoFrame, stream: VideoStream) -> av.filter.Graph:
    graph = av.filter.Graph()
    buffer = graph.add_buffer(
        template=stream,
        width=frame.width,
        height=frame.height,
        format=frame.format,
        time_base=stream.time_base,
    )
    # One frame out for each one in; which field is the first is marked in each.
    deinterlace = graph.add("bwdif", "mode=send_frame:parity=auto:deint=interlaced")
    sink = graph.add("buffersink")
    buffer.link_to(deinterlace)
    deinterlace.link_to(sink)
    graph.configure()
    return graph


def _pull(graph: av.filter.Graph) -> Iterator[VideoFrame]:
    while True:
        try:
            frame = graph.pull()
        except (av.error.BlockingIOError, av.error.EOFError):
            return
        assert isinstance(frame, VideoFrame)
        yield frame


def to_rgb(frame: VideoFrame, width: int | None = None, height: int | None = None) -> Image:
    """A frame as it is meant to be shown: [H, W, 3] RGB, turned and mirrored as it is marked.

    width, height: pixels to which it is scaled before it is turned; by default it is not.

    Pixels stay as they are stored, also where they are not meant to be square.
    """
    rgb = frame.reformat(width, height, "rgb24")
    plane: Any = rgb.planes[0]
    # Where it lies: `to_ndarray` makes a copy, which takes a tenth of what decoding takes.
    image = np.ndarray((rgb.height, rgb.width, 3), np.uint8, plane, strides=(plane.line_size, 3, 1))
    return _oriented(np.ascontiguousarray(image), frame)


def _oriented(image: Image, frame: VideoFrame) -> Image:
    side_data: Any = frame.side_data.get("DISPLAYMATRIX")
    if side_data is None:
        return image
    # Rows of 16.16 fixed point numbers: x' = a x + c y, y' = b x + d y.
    (a, b, _), (c, d, _), _ = np.frombuffer(bytes(side_data), np.int32).reshape(3, 3).tolist()
    if abs(b) > abs(a):
        image = image.transpose(1, 0, 2)
        across, down = c, b
    else:
        across, down = a, d
    if across < 0:
        image = image[:, ::-1]
    if down < 0:
        image = image[::-1]
    return np.ascontiguousarray(image)


class _Counted(NamedTuple):
    """What a file holds.

    frames: their number, those that an edit list hides not counted; where the file breaks off,
        the number that it announces. whole: whether it does not break off. last_time: of the last
        frame, seconds.
    """

    frames: int
    whole: bool
    last_time: float


def _count(container: InputContainer, stream: VideoStream) -> _Counted:
    unit = float(stream.time_base or 0)
    rate = frame_rate(stream)
    entries = stream.index_entries
    if "mp4" in container.format.name and stream.frames and len(entries) == stream.frames:
        # A table of all frames, which need not be read.
        shown = [entry.timestamp for entry in entries if not entry.is_discard]
        end = max(entry.pos + entry.size for entry in entries)
        return _Counted(len(shown), end <= container.size, max(shown, default=0) * unit)
    frames, last = 0, -math.inf
    for packet in stored_packets(container, stream):
        if packet.size and not packet.is_discard:
            frames += 1
            time = packet.pts if packet.pts is not None else packet.dts
            if time is not None:
                last = max(last, time * unit)
    whole = True
    announced = stream.frames
    if container.format.name not in _ESTIMATED:
        start, duration = (container.start_time or 0) / av.time_base, _duration(container, stream)
        # The duration of an AVI may be guessed from what is there, the number of frames is stated.
        duration = max(duration, announced / rate)
        announced = announced or round(duration * rate)
        lacks_time = duration and last < start + duration - (SLACK + 1) / rate
        whole = frames >= announced - SLACK or not lacks_time
    return _Counted(frames if whole else max(announced, frames), whole, last)


def _duration(container: InputContainer, stream: VideoStream) -> float:
    """Seconds that a container announces for the pictures; 0 where it does not."""
    if stream.duration and stream.time_base:
        return float(stream.duration * stream.time_base)
    if match := re.fullmatch(
        r"(\d+):(\d+):([\d.]+)", stream.metadata.get("DURATION", "")
    ):  # Matroska
        hours, minutes, seconds = map(float, match.groups())
        return 3600 * hours + 60 * minutes + seconds
    # The sound may be longer than the pictures.
    return (container.duration or 0) / av.time_base if len(container.streams) == 1 else 0.0


def _size(shape: tuple[int, ...]) -> str:
    return f"{shape[1]} x {shape[0]}"
