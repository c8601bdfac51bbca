"""Text and flat shapes on an RGB image, for the film strip and the labels on a video."""

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

Colour = tuple[int, int, int]  # RGB

BOLD = 600
PAPER: Colour = (15, 21, 32)
SAMPLES = 2  # a drawing is made this many times larger, then averaged


@cache
def _font() -> cv2.FontFace:
    return cv2.FontFace("sans")


def text_width(text: str, size: float, weight: int = 400) -> int:
    """Width of a line of text in pixels; `size` is its height in pixels."""
    return int(cv2.getTextSize((0, 0), text, (0, 0), _font(), round(size), weight)[2])


def put_text(
    image: NDArray[np.uint8],
    text: str,
    left: float,
    baseline: float,
    colour: Colour,
    size: float,
    weight: int = 400,
) -> None:
    """Write a line of text into the image; `size` is its height in pixels, `weight` 100 to 800."""
    origin = (round(left), round(baseline))
    cv2.putText(image, text, origin, colour, _font(), round(size), weight)


class Drawing:
    """An image addressed in its final pixels and drawn `SAMPLES` times larger.

    Positions and lengths are in final pixels, from the top-left corner.
    """

    def __init__(self, height: int, width: int) -> None:
        self.height, self.width = height, width
        self._image = np.full((height * SAMPLES, width * SAMPLES, 3), PAPER, np.uint8)

    def text(
        self,
        text: str,
        left: float,
        baseline: float,
        colour: Colour,
        size: float,
        weight: int = 400,
    ) -> None:
        """Write a line of text that is `size` pixels high."""
        origin = (left * SAMPLES, baseline * SAMPLES)
        put_text(self._image, text, *origin, colour, size * SAMPLES, weight)

    def text_width(self, text: str, size: float, weight: int = 400) -> float:
        """Width of a line of text, pixels."""
        return text_width(text, size * SAMPLES, weight) / SAMPLES

    def fill(
        self,
        left: float,
        top: float,
        right: float,
        bottom: float,
        colour: Colour,
        opacity: float = 1,
    ) -> None:
        """Fill a rectangle; `opacity` in [0, 1]."""
        rows, columns = (
            slice(round(low * SAMPLES), round(high * SAMPLES))
            for low, high in ((top, bottom), (left, right))
        )
        area = self._image[rows, columns]
        area[:] = np.rint(area + opacity * (np.array(colour) - area.astype(np.float64)))

    def curve(self, points: NDArray[np.float64], colour: Colour, thickness: float) -> None:
        """Draw a line through the points [n, 2], x and y."""
        fixed_point = np.rint(points * SAMPLES * 16).astype(np.int32)
        size = round(thickness * SAMPLES)
        cv2.polylines(self._image, [fixed_point], False, colour, size, cv2.LINE_AA, shift=4)

    def dot(self, point: NDArray[np.float64], radius: float, colour: Colour) -> None:
        """Fill a circle around the point [2], x and y."""
        x, y = (round(coordinate * SAMPLES * 16) for coordinate in point)
        size = round(radius * SAMPLES * 16)
        cv2.circle(self._image, (x, y), size, colour, cv2.FILLED, cv2.LINE_AA, shift=4)

    def paste(self, image: NDArray[np.uint8], left: float, top: float) -> None:
        """Paste an image that is already `SAMPLES` times larger."""
        row, column = round(top * SAMPLES), round(left * SAMPLES)
        area = self._image[row : row + image.shape[0], column : column + image.shape[1]]
        area[:] = image[: area.shape[0], : area.shape[1]]

    def finish(self) -> NDArray[np.uint8]:
        """The image [height, width, 3] in its final size."""
        size = (self.width, self.height)
        return cv2.resize(self._image, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
