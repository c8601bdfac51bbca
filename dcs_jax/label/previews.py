"""Small images of all frames of a video, which are there at once."""

import threading

import cv2
from av.video.frame import VideoFrame

from dcs_jax.io.video import to_rgb

_WIDTH = 480  # pixels, at most
_QUALITY = 75  # of JPEG
_BYTES = 2**27  # of all of them: some 9000; later frames have none


class Previews:
    """JPEG images of frames by their index. They may be added and asked for in any thread."""

    def __init__(self) -> None:
        self._kept: dict[int, bytes] = {}
        self._size = 0
        self._lock = threading.Lock()

    @property
    def full(self) -> bool:
        """Whether no more are kept."""
        return self._size >= _BYTES

    def get(self, index: int) -> bytes | None:
        """The image of a frame; None where there is none yet."""
        return self._kept.get(index)

    def add(self, index: int, frame: VideoFrame) -> None:
        """Keep a frame, if it is not known and there is room."""
        if index in self._kept or self.full:
            return
        factor = min(1.0, _WIDTH / frame.width)
        width, height = max(2, round(factor * frame.width)), max(2, round(factor * frame.height))
        bgr = cv2.cvtColor(to_rgb(frame, width=width, height=height), cv2.COLOR_RGB2BGR)
        done, encoded = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
        if done:
            with self._lock:
                self._kept[index] = encoded.tobytes()
                self._size += len(encoded)
