"""A folder of images as a source of frames."""

import os
import re
from collections.abc import Iterator, Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dcs_jax.io.image_bytes import decode, image_size, is_cut_off
from dcs_jax.io.source import FOLDER_FPS, BrokenSource, Image, StoredSource, check_range

IMAGE_SUFFIXES = frozenset(
    (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp", ".ppm", ".pgm", ".jp2")
)
_SAMPLED = 16  # images from which the range of a folder's values is taken
_OUTLIERS = 0.1  # per cent at either end: a broken pixel is not the range


class ImageFolder(StoredSource):
    """A folder of images in natural order. See `open_source`."""

    def __init__(self, path: Path, start: int, end: int | None) -> None:
        """path: the folder, or a pattern of names in it such as img_%04d.png."""
        images = list_images(path)
        self.total = len(images)
        check_range(path, start, end, self.total)
        self.path, self.name = path, str(path)
        self.start = start
        self.fps = FOLDER_FPS
        self.notes = []
        self._images = images[start:end]
        self.length = len(self._images)
        size = image_size(self._images[0])
        for image in self._images[1:]:
            if image_size(image) != size:
                raise ValueError(
                    f"{image} has {_text(image_size(image))} pixels, but the frames before it "
                    f"have {_text(size)}: all images of a folder must have the same size"
                )
        self.shape = (*size, 3)
        self._range: tuple[float, float] | None = None

    def __iter__(self) -> Iterator[Image]:
        return map(self.read, range(self.start, self.start + self.length))

    def read(self, index: int) -> Image:
        """The frame of this index; `BrokenSource` where it cannot be read."""
        image = self._stored(index)
        if image.dtype == np.uint8:
            return image
        if self._range is None and index > self.start:
            self.read(self.start)  # the range is found with it
        return self._as_bytes(image)

    def _stored(self, index: int) -> NDArray[Any]:
        path = self._images[index - self.start]
        try:
            content = path.read_bytes()
        except OSError as error:
            raise BrokenSource(f"{path} (frame {index}): {error.strerror}", index) from error
        if is_cut_off(content):
            raise BrokenSource(f"{path} (frame {index}) is cut off", index)
        image = decode(content)
        if image is None:
            raise BrokenSource(f"{path} (frame {index}) cannot be decoded", index)
        return image

    def _as_bytes(self, image: NDArray[Any]) -> Image:
        """An image of more than 8 bits, the folder's own range of values as 0 to 255."""
        if self._range is None:
            low, high = self._range = _value_range(self._images, image)
            depth = f"{8 * image.dtype.itemsize}-bit"
            self.notes.append(
                f"{self.path} holds {depth} images: their values {low:g} to {high:g} are taken "
                "as 0 to 255"
            )
        low, high = self._range
        scale = 255 / (high - low) if high > low else 0.0
        scaled = np.clip((image.astype(np.float32) - low) * scale, 0, 255)
        return np.rint(np.nan_to_num(scaled)).astype(np.uint8)


_COUNTER = re.compile(r"%(0\d+)?d")  # in a pattern of names, as FFmpeg has it


def is_pattern(path: Path) -> bool:
    """Whether the path is a pattern of names such as img_%04d.png, and no file has that name."""
    return bool(_COUNTER.search(path.name)) and not path.exists()


def list_images(path: Path) -> list[Path]:
    """The images of a folder in natural order, or those that fit a pattern.

    Raises ValueError if there are none.
    """
    if is_pattern(path):
        folder = path.parent
        before, _, after = _COUNTER.sub("\0", path.name, count=1).partition("\0")
        fits = re.compile(re.escape(before) + r"\d+" + re.escape(after))
        names = list(filter(fits.fullmatch, image_names(folder) if folder.is_dir() else ()))
        if not names:
            raise ValueError(f"{folder} holds no images with a name like {path.name}")
        return [folder / name for name in sorted(names, key=natural)]
    folder = path
    names = image_names(folder)
    if not names:
        raise ValueError(f"{folder} holds no images (jpg, png, bmp, tif, webp, ppm or jp2)")
    return [folder / name for name in sorted(names, key=natural)]


def image_names(folder: Path) -> list[str]:
    """The names of the images in a folder, in any order.

    Folders are none, nor are hidden files, which some systems leave beside each image.
    """
    with os.scandir(folder) as entries:
        return [
            entry.name
            for entry in entries
            if not entry.name.startswith(".")
            and Path(entry.name).suffix.lower() in IMAGE_SUFFIXES
            and entry.is_file()
        ]


# A sign is one only where it follows no letter or digit: not in 2024-11-14 or img-7.
_NUMBER = re.compile(r"((?:(?<![^\W_])[-+])?\d+(?:\.\d+)*)")


def natural(name: str) -> tuple[list[str | tuple[Decimal, ...]], str]:
    """Sort key that compares numbers as numbers, and equal keys by the name itself.

    One point makes a fraction, more of them separate whole numbers: 10.05, but 1.2.10.
    """
    # re.split with a group alternates text and digits, so text is never compared with a number.
    parts = _NUMBER.split(os.path.splitext(name)[0].lower())
    return [_numbers(part) if n % 2 else part for n, part in enumerate(parts)], name


def _numbers(text: str) -> tuple[Decimal, ...]:
    return tuple(map(Decimal, [text] if text.count(".") == 1 else text.split(".")))


def _value_range(paths: Sequence[Path], image: NDArray[Any]) -> tuple[float, float]:
    """The range of a folder's values, from some of its images; `image` is one of them."""
    samples = [image]
    for index in np.unique(np.linspace(0, len(paths) - 1, _SAMPLED).astype(int)):
        # One that cannot be read is reported in its turn.
        try:
            sample = decode(paths[index].read_bytes())
        except OSError:
            continue
        if sample is not None and sample.dtype == image.dtype:
            samples.append(sample)
    values = np.concatenate([sample[::2, ::2].ravel() for sample in samples])
    values = values[np.isfinite(values)]
    if not values.size:
        return 0.0, 0.0
    low, high = np.percentile(values, (_OUTLIERS, 100 - _OUTLIERS))
    return float(low), float(high)


def _text(size: tuple[int, int]) -> str:
    return f"{size[1]} x {size[0]}"
