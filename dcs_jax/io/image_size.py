"""The size of an image from its header, without decoding the pixels.

A folder is checked for images of odd size before anything is tracked; decoding them all for that
would double the time spent on reading.
"""

import struct
from pathlib import Path
from typing import BinaryIO

import cv2

# JPEG markers that start a frame header: C0 to CF without DHT, JPG and DAC.
_JPEG_FRAME = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}


def image_size(path: Path) -> tuple[int, int]:
    """Rows and columns of the image as stored (an EXIF orientation is not applied).

    Raises:
        ValueError: the file is no image that can be read.
    """
    with path.open("rb") as file:
        head = file.read(24)
        try:
            if head.startswith(b"\x89PNG\r\n\x1a\n"):
                columns, rows = struct.unpack(">II", head[16:24])
                return rows, columns
            if head.startswith(b"\xff\xd8"):
                return _jpeg_size(file)
        except struct.error:
            raise ValueError(f"{path} is cut off within its header") from None
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
    if image is None:
        raise ValueError(f"{path} cannot be read as an image")
    rows, columns = image.shape[:2]
    return rows, columns


def _jpeg_size(file: BinaryIO) -> tuple[int, int]:
    """Walk the segments of a JPEG file up to its frame header; struct.error where it ends first."""
    file.seek(2)
    while True:
        marker, length = struct.unpack(">HH", file.read(4))
        if marker & 0xFF in _JPEG_FRAME:
            rows, columns = struct.unpack(">xHH", file.read(5))
            return rows, columns
        file.seek(length - 2, 1)
