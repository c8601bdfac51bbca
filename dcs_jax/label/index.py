"""Where the frames of a video are: their times in the order in which they are shown."""

from bisect import bisect_left
from typing import NamedTuple

from dcs_jax.io.video import (
    VideoFile,
    decoded_frames,
    open_video,
    stored_packets,
)


class Keyframe(NamedTuple):
    """A place at which decoding can begin.

    first: index of the first frame that can be shown from here on. seek: time to seek to, units of
    the stream; None for the start of the file.
    """

    first: int
    seek: int | None


class VideoIndex(NamedTuple):
    """The frames that a video shows.

    length: their number. numbers: from the time of a frame, units of the stream, to its index; None
    where the file does not have usable times: frames are then counted from the start.
    keyframes: in the order of `first`; the start of the file is the first one.
    whole: whether the file does not break off.
    """

    length: int
    numbers: dict[int, int] | None
    keyframes: list[Keyframe]
    whole: bool


def index_video(source: VideoFile) -> VideoIndex:
    """The index from the packets of the file, which is fast as nothing is decoded.

    Where they do not say enough, and where the file breaks off, all frames are decoded.
    """
    times: list[int] = []
    keys: list[tuple[int, int]] = []
    timed = source.whole
    container, stream = open_video(source.path)
    with container:
        for packet in stored_packets(container, stream):
            if not packet.size:
                continue
            if packet.pts is None or packet.is_corrupt:
                timed = False
                break
            if packet.is_keyframe:
                keys.append((packet.pts, packet.pts if packet.dts is None else packet.dts))
            if not packet.is_discard:
                times.append(packet.pts)
    if not timed or len(set(times)) != len(times) or len(times) != source.total:
        return count_video(source)
    return _index(sorted(times), keys, source.whole)


def count_video(source: VideoFile) -> VideoIndex:
    """The index from decoding every frame: exact for every file, and as slow as that is."""
    keys: list[tuple[int, int]] = []
    times: list[int | None] = []
    container, stream = open_video(source.path)
    with container:
        for frame in decoded_frames(container, stream, lambda: None, source.whole):
            times.append(frame.pts)
            if frame.key_frame and frame.pts is not None:
                keys.append((frame.pts, frame.pts if frame.dts is None else frame.dts))
    known = [time for time in times if time is not None]
    stored = "matroska" in source.container or "mp4" in source.container
    if not stored or len(known) < len(times) or known != sorted(set(known)):
        return VideoIndex(len(times), None, [Keyframe(0, None)], source.whole)
    return _index(known, keys, source.whole)


def _index(times: list[int], keys: list[tuple[int, int]], whole: bool) -> VideoIndex:
    """times: of the frames, ascending; keys: times at which keyframes are shown and decoded."""
    keyframes = {0: Keyframe(0, None)}
    for shown, seek in keys:
        first = bisect_left(times, shown)
        if first:
            keyframes[first] = Keyframe(first, seek)
    numbers = {time: number for number, time in enumerate(times)}
    return VideoIndex(len(times), numbers, sorted(keyframes.values(), key=_first), whole)


def _first(keyframe: Keyframe) -> int:
    return keyframe.first
