"""What every reader of a data set returns: a name, frames and labels."""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dcs_jax.checks import check_box
from dcs_jax.io.frames import StoredSource, open_source
from dcs_jax.io.images import image_names


class Sequence(NamedTuple):
    """A labelled sequence, from its first labelled frame on.

    name: name as in `find_sequences`.
    frames: source of the frames, opened and checked, not yet read.
    truth: [T, 4] float64, x, y, w, h in pixels, NaN where unlabelled; the first row is labelled.
    """

    name: str
    frames: StoredSource
    truth: NDArray[np.float64]

    def fingerprint(self) -> str:
        """A digest of the labels, and of the names and contents of the files of the frames.

        Reading the files is a small part of decoding them. Their sizes would not be enough:
        uncompressed images have the same size whatever they show.
        """
        path = self.frames.path
        files = sorted(path.iterdir()) if path.is_dir() else [path]
        digest = hashlib.sha256(self.truth.tobytes())
        digest.update(f"{self.frames.start} {self.frames.length}".encode())
        for file in filter(Path.is_file, files):
            with file.open("rb") as content:
                digest.update(file.name.encode() + hashlib.file_digest(content, "sha256").digest())
        return digest.hexdigest()[:16]


class Entry(NamedTuple):
    """A sequence that is found and not yet opened.

    load: opens the sequence; raises ValueError or OSError, which say what is wrong with it.
    """

    name: str
    load: Callable[[], Sequence]


def open_sequence(
    name: str,
    source: Path,
    truth: NDArray[np.float64],
    annotation: Path,
    start: int = 0,
    end: int | None = None,
) -> Sequence:
    """The frames `start` to `end` of a source with their labels, from the first labelled frame on.

    truth: [end - start, 4], one row for each frame.
    annotation: file of the labels, for messages.

    Raises ValueError where frames and labels differ in number, no frame is labelled, or the first
    label is not a box that can be tracked.
    """
    frames = open_source(source, start, end)
    if len(truth) != frames.length:
        raise ValueError(
            f"{annotation} labels {len(truth)} frames, but {source} has {frames.length}: "
            "expected one label for each frame"
        )
    labelled = np.flatnonzero(~np.isnan(truth).any(axis=1))
    if not labelled.size:
        raise ValueError(f"{annotation} labels no frame")
    first = int(labelled[0])
    check_box(truth[first], frames.shape)
    if first:
        frames = open_source(source, start + first, end)
    return Sequence(name, frames, truth[first:])


def holds_images(folder: Path) -> bool:
    """Whether there are images in a folder."""
    return bool(image_names(folder))


def count_images(folder: Path) -> int:
    """The number of images in a folder. Raises ValueError if there is no such folder."""
    if not folder.is_dir():
        raise ValueError(f"{folder} does not exist: expected a folder of images")
    return len(image_names(folder))
