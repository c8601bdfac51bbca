"""What the cases of `benchmarks.run` are given, and what they return."""

import itertools
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.workers import HERE, Worker
from dcs_jax.evaluation.datasets import find_sequences
from dcs_jax.synthetic import render

PRESETS = ("default", "paper")


class Row(NamedTuple):
    """A line of the table: what was measured, beside what is asked for."""

    case: str
    measured: str
    asked: str = ""

    def __str__(self) -> str:
        return f"| {self.case} | {self.measured} | {self.asked} |"


class Panel(NamedTuple):
    """How something grows: a picture of `lines` over `xs`, by name."""

    title: str
    x: str
    y: str
    xs: Sequence[float]
    lines: dict[str, list[float]]


class OpenCV(Worker):
    """The trackers of an OpenCV, in a process of its own, with the Python that has it."""

    def __init__(self, python: Path, folder: Path) -> None:
        """Start it; folder: for the frames it is to read."""
        super().__init__([python, HERE / "benchmarks" / "opencv_worker.py"])
        self._folder = folder
        found = self.read()
        self.version: str = found["version"]
        self.trackers: list[str] = found["trackers"]

    def clock(
        self, tracker: str, frames: NDArray[np.uint8], boxes: Any, updates: int
    ) -> Callable[[], float]:
        """A call that returns the seconds of so many updates of a tracker for each box [B, 4]."""
        with tempfile.NamedTemporaryFile(dir=self._folder, suffix=".npy", delete=False) as file:
            np.save(file, frames[: updates + 1])
        question = {
            "tracker": tracker,
            "frames": file.name,
            "boxes": np.asarray(boxes, np.float64).tolist(),
            "count": updates,
        }
        return lambda: float(self.ask(question))


class Material(NamedTuple):
    """frames: [T, H, W, 3] of the sequence `name`. box: [4] in its first frame.

    root: where the sequences are, None without. rounds: of everything that takes turns. quick:
    fewer points and frames.
    """

    name: str
    frames: NDArray[np.uint8]
    box: NDArray[np.float64]
    root: Path | None
    opencv: OpenCV
    rounds: int
    quick: bool


Case = Callable[[Material], Iterator[Row | Panel]]


def load(
    root: Path | None, name: str, length: int | None = None
) -> tuple[str, NDArray[np.uint8], NDArray[np.float64]]:
    """Name, frames and first box of a sequence below the root; without one of a rendered clip.

    length: frames, at most.
    """
    if root is None:
        clip = render(length or 200)
        return "a rendered clip", clip.frames, clip.boxes[0].astype(np.float64)
    (entry,) = find_sequences(root, [name])
    sequence = entry.load()
    return name, np.stack(list(itertools.islice(sequence.frames, length))), sequence.truth[0]
