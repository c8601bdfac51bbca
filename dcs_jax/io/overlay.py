"""Boxes drawn on frames, and the video file they go to.

Frames are uint8 RGB [H, W, 3]. Boxes are x, y, w, h in pixels with pixel (0, 0) covering [0, 1) x
[0, 1); they are drawn to a fraction of a pixel.
"""

import contextlib
from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Self

import av
import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dcs_jax.io.drawing import BOLD, Colour, put_text, text_width

TRACKED: Colour = (64, 224, 255)
# Of several objects, in turn.
OBJECTS: tuple[Colour, ...] = (
    TRACKED,
    (255, 206, 92),
    (178, 226, 120),
    (255, 132, 104),
    (206, 150, 255),
    (120, 180, 255),
)
TRUTH: Colour = (255, 255, 255)
INK: Colour = (14, 20, 30)

# Of a video that can be written, and the name of its container.
SUFFIXES = {".mp4": "mp4", ".m4v": "mp4", ".mov": "mov", ".mkv": "matroska", ".avi": "avi"}
_SHIFT = 4  # fractional bits of the coordinates given to OpenCV


def draw_box(
    frame: NDArray[np.uint8],
    box: ArrayLike,
    colour: Colour,
    label: str = "",
    thickness: int | None = None,
) -> None:
    """Draw a box [4] and its label into the frame.

    The line has a dark rim, so that it is visible on any background. A box with a NaN, which is an
    unlabelled one, is left out.

    thickness: thickness of the line in pixels, by default in proportion to the frame's size.
    """
    x, y, w, h = np.asarray(box, np.float64)
    if np.isnan([x, y, w, h]).any():
        return
    if thickness is None:
        # A thinner line would fall between two rows of pixels and be half as bright.
        thickness = max(2, round(min(frame.shape[:2]) / 240))
    # OpenCV's coordinates are those of pixel centres; far outside the frame they would overflow.
    corners = np.clip([[x, y], [x + w, y + h]], -(2**14), 2**14) - 0.5
    top_left, bottom_right = ((int(a), int(b)) for a, b in np.rint(corners * 2**_SHIFT))
    rim = thickness + 2 * max(1, thickness // 2)
    for line, width in ((INK, rim), (colour, thickness)):
        cv2.rectangle(frame, top_left, bottom_right, line, width, cv2.LINE_AA, _SHIFT)
    if label:
        _draw_label(frame, x, y, h, label, colour)


def _draw_label(
    frame: NDArray[np.uint8], x: float, y: float, h: float, label: str, colour: Colour
) -> None:
    """A filled tag above the box, or below it if there is no room, always within the frame."""
    rows, columns = frame.shape[:2]
    size = max(11, round(min(rows, columns) / 36))
    pad = max(2, size // 4)
    height, width = size + 2 * pad, text_width(label, size, BOLD) + 2 * pad
    top = y - height - pad
    if top < 0:
        top = y + h + pad
    top = round(min(max(top, 0), max(rows - height, 0)))
    left = round(min(max(x, 0), max(columns - width, 0)))
    cv2.rectangle(frame, (left, top), (left + width, top + height), colour, cv2.FILLED)
    put_text(frame, label, left + pad, top + height - 1.6 * pad, INK, size, BOLD)


def draw_tracks(
    frame: NDArray[np.uint8],
    names: Sequence[str],
    boxes: ArrayLike,
    confidence: ArrayLike,
    lost: ArrayLike,
    truth: ArrayLike | None = None,
) -> NDArray[np.uint8]:
    """A copy of the frame with the tracked boxes and, if given, the true box of the only object.

    A box has its name and confidence, and a darker colour where the object is lost.

    names: [S], "" for none. boxes: [S, 4], NaN left out. confidence: [S] in [0, 1], NaN for none.
    lost: [S]. truth: [4].
    """
    frame = frame.copy()
    if truth is not None:
        draw_box(frame, truth, TRUTH)
    of_all = zip(names, np.asarray(boxes), np.asarray(confidence), np.asarray(lost), strict=True)
    for number, (name, box, confident, gone) in enumerate(of_all):
        words = [name, "" if np.isnan(confident) else f"{confident:.2f}", "lost" if gone else ""]
        colour = OBJECTS[number % len(OBJECTS)]
        dimmed = (colour[0] // 2, colour[1] // 2, colour[2] // 2)
        draw_box(frame, box, dimmed if gone else colour, " ".join(filter(None, words)))
    return frame


def draw_track(
    frame: NDArray[np.uint8], box: ArrayLike, confidence: float, truth: ArrayLike | None = None
) -> NDArray[np.uint8]:
    """`draw_tracks` of one object without a name."""
    return draw_tracks(frame, [""], np.asarray(box)[None], [confidence], [False], truth)


class VideoWriter:
    """Writes frames to a video file that any player shows, a browser, too. A context manager.

    The codec follows the suffix: H.264 in .mp4, .m4v, .mov and .mkv, Motion JPEG in .avi. They
    need even sides: a last odd row or column is cut off.
    """

    def __init__(self, path: str | Path, shape: tuple[int, int, int], fps: float = 30.0) -> None:
        """Open the file for frames of `shape` (H, W, 3).

        Raises:
            ValueError: the suffix is none of those above.
            OSError: the file cannot be written.
        """
        self._path = Path(path)
        suffix = self._path.suffix.lower()
        if suffix not in SUFFIXES:
            raise ValueError(f"{path} must end in one of {', '.join(SUFFIXES)} to become a video")
        self._rows, self._columns = (side - side % 2 for side in shape[:2])
        # Opened here: FFmpeg would do so, and fail, with the first frames only.
        self._file = self._path.open("wb")
        self._container = av.open(self._file, "w", format=SUFFIXES[suffix])
        rate = Fraction(fps).limit_denominator(1000)
        if suffix == ".avi":
            self._stream = self._container.add_stream("mjpeg", rate, options={"qscale": "3"})
            self._stream.pix_fmt = "yuvj420p"
        else:
            # 20 looks as the frame does; the tracker waits for slower presets.
            options = {"preset": "veryfast", "crf": "20"}
            self._stream = self._container.add_stream("libx264", rate, options=options)
            self._stream.pix_fmt = "yuv420p"
        self._stream.height, self._stream.width = self._rows, self._columns
        self._failed = False

    def write(self, frame: NDArray[np.uint8]) -> None:
        """Append one frame [H, W, 3]; OSError where that fails."""
        image = np.ascontiguousarray(frame[: self._rows, : self._columns])
        self._mux(av.VideoFrame.from_ndarray(image, format="rgb24"))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        """Complete the file; OSError where that fails."""
        if not self._failed:
            self._mux(None)
            self._tell(self._container.close)
            self._file.close()

    def _mux(self, frame: av.VideoFrame | None) -> None:
        self._tell(lambda: self._container.mux(self._stream.encode(frame)))

    def _tell(self, write: Callable[[], None]) -> None:
        """Do it. Where it fails the file is removed, as it is no video."""
        try:
            write()
        except OSError as error:
            self._failed = True
            with contextlib.suppress(OSError):
                self._file.close()
            self._path.unlink(missing_ok=True)
            reason = f"the video cannot be written: {error.strerror}"
            raise OSError(error.errno, reason, str(self._path)) from None
