"""The layout of VOT: groundtruth.txt, with the images in color/ (2018 on) or in the same folder.

A line has 4 numbers, x, y, w, h, or 8, the corners of a polygon, which becomes the smallest upright
box around it. NaN or zeros stand for no label. Masks (lines that begin with m) are refused.
"""

import functools
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcs_jax.evaluation.datasets.sequence import Entry, Sequence, open_sequence
from dcs_jax.io.annotations import parse_numbers, read_lines

ANNOTATION = "groundtruth.txt"


def entries(folder: Path, name: str) -> list[Entry]:
    """The sequence of a folder in the layout of VOT; [] for other layouts."""
    if not ((folder / ANNOTATION).is_file() or (folder / "color").is_dir()):
        return []
    return [Entry(name, functools.partial(_load, name, folder))]


def _load(name: str, folder: Path) -> Sequence:
    annotation = folder / ANNOTATION
    images = folder / "color" if (folder / "color").is_dir() else folder
    return open_sequence(name, images, read_polygons(annotation), annotation)


def read_polygons(path: Path) -> NDArray[np.float64]:
    """Boxes [T, 4] of an annotation with 4 or 8 numbers in a line; NaN for no label.

    Raises ValueError, naming the line, where a line has neither.
    """
    lines = read_lines(path)
    return np.array([_box(line, f"{path}, line {n}") for n, line in enumerate(lines, 1)])


def _box(line: str, where: str) -> list[float]:
    expected = "4 numbers x,y,w,h or 8, the corners of a polygon"
    numbers = np.array(parse_numbers(line, where, (4, 8), expected))
    if np.isnan(numbers).any() or not numbers.any():
        return [np.nan] * 4
    if len(numbers) == 8:
        corners = numbers.reshape(4, 2)
        numbers = np.concatenate([corners.min(axis=0), np.ptp(corners, axis=0)])
    if not np.isfinite(numbers).all() or (numbers[2:] <= 0).any():
        raise ValueError(
            f"{where} is {line.strip()!r}: expected finite numbers and a positive size"
        )
    return [float(number) for number in numbers]
