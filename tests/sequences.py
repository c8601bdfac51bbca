"""The real sequences of the papers: research data that is not ours to ship."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from dcs_jax.io.annotations import read_boxes
from dcs_jax.io.frames import open_source

ROOT = Path(__file__).parents[2] / "shared" / "sequences"


class Sequence(NamedTuple):
    """frames: [T, H, W, 3] uint8, RGB. truth: [T, 4], x, y, w, h in pixels, NaN: unlabelled."""

    frames: np.ndarray
    truth: np.ndarray


def load(name: str, length: int | None = None) -> Sequence:
    """The first frames of a sequence; skips the test where it is missing."""
    folder = ROOT / name
    if not folder.is_dir():
        pytest.skip(f"the sequence {name} is not in ../shared/sequences")
    frames = np.stack(list(open_source(folder, end=length)))
    return Sequence(frames, read_boxes(folder / "groundtruth_rect.txt")[: len(frames)])
