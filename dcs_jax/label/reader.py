"""Decoding a video from a keyframe on, to the frame that is asked for."""

from bisect import bisect_right
from collections import deque
from collections.abc import Generator, Iterator

from av.container import InputContainer
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from dcs_jax.io.video import VideoFile, decoded_frames, open_video, shown_frames
from dcs_jax.label.index import Keyframe, VideoIndex

_Numbered = tuple[int, VideoFrame]


class WrongIndex(Exception):  # noqa: N818 (it is no error of a user)
    """The file does not have the frames that the index says: some cannot be decoded."""


class VideoReader:
    """Decodes the frames of a video; it goes on where it is if that is the shortest way.

    Frames are as `shown_frames` yields them. For one thread at a time.
    """

    def __init__(self, source: VideoFile, index: VideoIndex) -> None:
        self._source, self._index = source, index
        self._firsts = [keyframe.first for keyframe in index.keyframes]
        self._opened: tuple[InputContainer, VideoStream] | None = None
        self._frames: Generator[_Numbered] | None = None
        self._next = 0
        self._fresh = False  # whether nothing was decoded since it began

    def frames(self, index: int) -> Iterator[_Numbered]:
        """Decode frames one after the other, each with its index, up to the one asked for.

        Raises `WrongIndex` where the file has other frames, ValueError where it cannot be opened.
        """
        start = bisect_right(self._firsts, index) - 1
        if self._frames is None or not self._firsts[start] <= self._next <= index:
            self._begin(start)
        while True:
            assert self._frames is not None
            found = next(self._frames, None)
            number = self._index.length if found is None else found[0]
            if number > self._next and not (number == self._next + 1 and self._fresh):
                self.close()
                raise WrongIndex
            if number > index:
                # What is shown here needs frames before the keyframe.
                start -= 1
                if start < 0:
                    self.close()
                    raise WrongIndex
                self._begin(start)
                continue
            self._next, self._fresh = number + 1, False
            assert found is not None
            yield found
            if number == index:
                return

    def close(self) -> None:
        """Close the file; the next frame opens it again."""
        if self._frames is not None:
            self._frames.close()
        if self._opened is not None:
            self._opened[0].close()
        self._frames = self._opened = None

    def _begin(self, number: int) -> None:
        keyframe = self._index.keyframes[number]
        if keyframe.seek is None:
            self.close()
        if self._opened is None:
            self._opened = open_video(self._source.path)
        container, stream = self._opened
        if keyframe.seek is not None:
            container.seek(keyframe.seek, stream=stream)
        self._frames = self._decode(container, stream, keyframe)
        self._next, self._fresh = keyframe.first, True

    def _decode(
        self, container: InputContainer, stream: VideoStream, keyframe: Keyframe
    ) -> Generator[_Numbered]:
        order: deque[int] = deque()  # of the frames that the deinterlacer still has
        incomplete = -1  # a deinterlaced frame needs the one before

        def known() -> Iterator[VideoFrame]:
            nonlocal incomplete
            count = 0
            for frame in decoded_frames(container, stream, lambda: None, self._index.whole):
                number = count
                if self._index.numbers is not None:
                    number = self._index.numbers.get(frame.pts or 0, -1)
                count += 1
                if number < keyframe.first:
                    continue
                if keyframe.seek is not None and incomplete < 0 and frame.interlaced_frame:
                    incomplete = number
                order.append(number)
                yield frame

        for frame in shown_frames(known(), stream):
            number = order.popleft()
            if number != incomplete:
                yield number, frame
