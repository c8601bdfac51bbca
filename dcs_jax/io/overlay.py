"""Boxes drawn on frames, and the video file they go to.

Frames are uint8 RGB [H, W, 3]. Boxes are x, y, w, h in pixels with pixel (0, 0) covering [0, 1) x
[0, 1); they are drawn to a fraction of a pixel.
"""

from pathlib import Path
from typing import Self

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dcs_jax.io.drawing import BOLD, Colour, put_text, text_width

TRACKED: Colour = (64, 224, 255)
TRUTH: Colour = (255, 255, 255)
INK: Colour = (14, 20, 30)

CODECS = {".mp4": "mp4v", ".m4v": "mp4v", ".mov": "mp4v", ".avi": "MJPG"}
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


def draw_track(
    frame: NDArray[np.uint8], box: ArrayLike, confidence: float, truth: ArrayLike | None = None
) -> NDArray[np.uint8]:
    """A copy of the frame with the tracked box, its confidence and, if given, the true box.

    confidence: in [0, 1], NaN for none.
    """
    frame = frame.copy()
    if truth is not None:
        draw_box(frame, truth, TRUTH)
    draw_box(frame, box, TRACKED, "" if np.isnan(confidence) else f"{confidence:.2f}")
    return frame


class VideoWriter:
    """Writes frames to a video file. A context manager.

    The codec follows the suffix: MPEG-4 in .mp4, .m4v and .mov, Motion JPEG in .avi. Both are in
    every OpenCV wheel; H.264 is not. They need even sides: a last odd row or column is cut off.
    """

    def __init__(self, path: str | Path, shape: tuple[int, int, int], fps: float = 30.0) -> None:
        """Open the file for frames of `shape` (H, W, 3).

        Raises:
            ValueError: the suffix is none of those above, or the file cannot be written.
        """
        path = Path(path)
        codec = CODECS.get(path.suffix.lower())
        if codec is None:
            raise ValueError(f"{path} must end in one of {', '.join(CODECS)} to become a video")
        rows, columns, _ = shape
        fourcc = cv2.VideoWriter.fourcc(*codec)
        self._writer = cv2.VideoWriter(str(path), fourcc, fps, (columns, rows))
        if not self._writer.isOpened():
            raise ValueError(
                f"{path} cannot be written as a {codec} video of {columns} x {rows} pixels"
            )

    def write(self, frame: NDArray[np.uint8]) -> None:
        """Append one frame [H, W, 3]."""
        self._writer.write(cv2.cvtColor(frame, cv2.COLOR_RGB2BGR))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._writer.release()
