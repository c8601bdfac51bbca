"""What the bytes of an image say: the image, and without decoding its size and whether it is whole.

The images of a folder are checked for a different size before anything is tracked; decoding them
all for that would double the time spent on reading.
"""

import io
import struct
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
from numpy.typing import NDArray

_PNG, _JPEG = b"\x89PNG\r\n\x1a\n", b"\xff\xd8"

# JPEG markers that start a frame header: C0 to CF without DHT, JPG and DAC.
_JPEG_FRAME = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_JPEG_SCAN, _JPEG_END = b"\xff\xda", b"\xff\xd9"
_APP1, _EXIF = 0xE1, b"Exif\x00\x00"
_ORIENTATION = 0x0112  # tag
_TIFF = {b"II*\0": "<", b"MM\0*": ">"}  # byte order
_AS_STORED = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
_TRANSPOSED = 5  # orientation from which on rows are shown as columns


def image_size(path: Path) -> tuple[int, int]:
    """Rows and columns of the image as shown, turned as its EXIF orientation says.

    Raises:
        ValueError: the file cannot be read as an image.
    """
    with path.open("rb") as file:
        head = file.read(24)
        try:
            if head.startswith(_PNG):
                columns, rows = struct.unpack(">II", head[16:24])
                return _as_shown((rows, columns), _png_orientation(file))
            if head.startswith(_JPEG):
                return _as_shown(*_jpeg_size(file))
        except struct.error:
            raise ValueError(f"{path} is cut off within its header") from None
        file.seek(0)
        content = file.read()
    image = decode(content)
    if image is None:
        raise ValueError(f"{path} cannot be read as an image")
    rows, columns = image.shape[:2]
    return rows, columns


def decode(image: bytes) -> NDArray[Any] | None:
    """The image as shown, [H, W, 3] RGB in the depth of the file; None where it is none.

    Opaque, and turned as its EXIF orientation says.
    """
    if not image:
        return None
    # With any other flag OpenCV 5 gets TIFF wrong: the colours of 16 bits, grey of 32 bits.
    tiff = image[:4] in _TIFF
    flags = cv2.IMREAD_UNCHANGED if tiff else _AS_STORED
    try:
        stored = cv2.imdecode(np.frombuffer(image, np.uint8), flags)
    except cv2.error:
        return None
    if stored is None:
        return None
    image_rgb: NDArray[Any] = stored
    if tiff:
        channels = 1 if stored.ndim == 2 else stored.shape[2]
        # Grey, with or without transparency, and BGR, likewise.
        planes = [0, 0, 0] if channels < 3 else [2, 1, 0]
        image_rgb = stored.reshape(*stored.shape[:2], channels)[..., planes]
    turn = _orientation(image)
    if turn >= _TRANSPOSED:
        image_rgb = image_rgb.transpose(1, 0, 2)
    if turn in (2, 3, 6, 7):
        image_rgb = image_rgb[:, ::-1]
    if turn in (3, 4, 7, 8):
        image_rgb = image_rgb[::-1]
    return np.ascontiguousarray(image_rgb)


def _orientation(image: bytes) -> int:
    """How the rows and columns as decoded are shown: 1 to 8, as EXIF counts; 1 unless said.

    Of JPEG, PNG and WebP; TIFF is turned by its decoder.
    """
    file = io.BytesIO(image)
    try:
        if image.startswith(_PNG):
            return _png_orientation(file)
        if image.startswith(_JPEG):
            return _jpeg_size(file)[1]
        if image.startswith(b"RIFF") and image[8:12] == b"WEBP":
            return _webp_orientation(file)
    except struct.error:
        pass
    return 1


def _as_shown(stored: tuple[int, int], orientation: int) -> tuple[int, int]:
    rows, columns = stored
    return (columns, rows) if orientation >= _TRANSPOSED else (rows, columns)


def _jpeg_size(file: BinaryIO) -> tuple[tuple[int, int], int]:
    """Rows and columns, and orientation, from the segments up to the frame header.

    struct.error if the file ends before.
    """
    file.seek(2)
    orientation = 1
    while True:
        marker = 0
        while marker in (0, 0xFF):  # any number of fill bytes may precede a marker
            (marker,) = struct.unpack("B", file.read(1))
        (length,) = struct.unpack(">H", file.read(2))
        if marker in _JPEG_FRAME:
            return struct.unpack(">xHH", file.read(5)), orientation
        if marker == _APP1:
            segment = file.read(length - 2)
            if segment.startswith(_EXIF):
                orientation = _tiff_orientation(segment[len(_EXIF) :])
        else:
            file.seek(length - 2, 1)


def _png_orientation(file: BinaryIO) -> int:
    """From a chunk between header and picture."""
    file.seek(33)
    while len(head := file.read(8)) == 8:
        length, kind = struct.unpack(">I4s", head)
        if kind == b"eXIf":
            return _tiff_orientation(file.read(length))
        if kind in (b"IDAT", b"IEND"):
            break
        file.seek(length + 4, 1)
    return 1


def _webp_orientation(file: BinaryIO) -> int:
    file.seek(12)
    while len(head := file.read(8)) == 8:
        kind, length = struct.unpack("<4sI", head)
        if kind == b"EXIF":
            return _tiff_orientation(file.read(length).removeprefix(_EXIF))
        file.seek(length + length % 2, 1)
    return 1


def _tiff_orientation(tiff: bytes) -> int:
    """From the first directory of a block of EXIF, which is a TIFF file."""
    order = _TIFF.get(tiff[:4])
    if order is None:
        return 1
    try:
        (first,) = struct.unpack_from(f"{order}I", tiff, 4)
        (count,) = struct.unpack_from(f"{order}H", tiff, first)
        for entry in range(first + 2, first + 2 + 12 * count, 12):
            tag, value = struct.unpack_from(f"{order}H6xH", tiff, entry)
            if tag == _ORIENTATION:
                return value if 1 <= value <= 8 else 1
    except struct.error:  # cut off
        pass
    return 1


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
