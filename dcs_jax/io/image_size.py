"""What the bytes of an image say without decoding: its size, and whether the file is complete.

The images of a folder are checked for a different size before anything is tracked; decoding them
all for that would double the time spent on reading.
"""

import struct
from pathlib import Path
from typing import BinaryIO

import cv2

_PNG, _JPEG = b"\x89PNG\r\n\x1a\n", b"\xff\xd8"

# JPEG markers that start a frame header: C0 to CF without DHT, JPG and DAC.
_JPEG_FRAME = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_JPEG_SCAN, _JPEG_END = b"\xff\xda", b"\xff\xd9"


def image_size(path: Path) -> tuple[int, int]:
    """Rows and columns of the image as stored (an EXIF orientation is not applied).

    Raises:
        ValueError: the file cannot be read as an image.
    """
    with path.open("rb") as file:
        head = file.read(24)
        try:
            if head.startswith(_PNG):
                columns, rows = struct.unpack(">II", head[16:24])
                return rows, columns
            if head.startswith(_JPEG):
                return _jpeg_size(file)
        except struct.error:
            raise ValueError(f"{path} is cut off within its header") from None
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
    if image is None:
        raise ValueError(f"{path} cannot be read as an image")
    rows, columns = image.shape[:2]
    return rows, columns


def _jpeg_size(file: BinaryIO) -> tuple[int, int]:
    """Read the segments of a JPEG file up to its frame header; struct.error if it ends before."""
    file.seek(2)
    while True:
        marker, length = struct.unpack(">HH", file.read(4))
        if marker & 0xFF in _JPEG_FRAME:
            rows, columns = struct.unpack(">xHH", file.read(5))
            return rows, columns
        file.seek(length - 2, 1)


def is_cut_off(image: bytes) -> bool:
    """Whether the file of a JPEG or PNG image ends before the image does; False for other formats.

    OpenCV decodes a JPEG that is cut off, with grey for the rest, and only prints a line on stderr.
    It refuses such images in the other formats.
    """
    if image.startswith(_PNG):
        return b"IEND" not in image
    if not image.startswith(_JPEG):
        return False
    # A thumbnail, which is an image itself, is in a segment before the first scan. Within the scans
    # the two bytes of the end cannot occur.
    start = len(_JPEG)
    while start < len(image) and image[start : start + 2] != _JPEG_SCAN:
        if image[start] != 0xFF:
            return False  # neither a segment nor padding before one: left to the decoder
        padding = image[start + 1 : start + 2] == b"\xff"
        start += 1 if padding else 2 + int.from_bytes(image[start + 2 : start + 4])
    return _JPEG_END not in image[start:]
