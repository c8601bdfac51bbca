"""What several benchmarks use: sequences, times of calls that take turns, and worker processes.

pytest-benchmark, which `bench_selection` uses, finishes one call before it begins the next. The
calls here are compared, some in processes of their own: they take turns, and each round gives a
ratio, which does not change with the speed of the machine.
"""

import contextlib
import itertools
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Self

import jax
import numpy as np
from numpy.typing import NDArray

from dcs_jax.compilation import FROM_SECONDS
from dcs_jax.evaluation.datasets import find_sequences
from dcs_jax.synthetic import render

HERE = Path(__file__).resolve().parents[1]  # this checkout
WORKER = HERE / "benchmarks" / "worker.py"


def load(
    folder: Path | None, name: str | None = None, length: int | None = None
) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """Frames [T, H, W, 3] and annotation [T, 4] of a sequence; without a folder of a rendered clip.

    folder: of the sequence, or of several, of which `name` is one. length: frames, at most.
    """
    if folder is None:
        clip = render(length or 200)
        return clip.frames, clip.boxes.astype(np.float64)
    entry, *_ = find_sequences(folder, None if name is None else [name])
    sequence = entry.load()
    return np.stack(list(itertools.islice(sequence.frames, length))), sequence.truth[:length]


def around(box: NDArray[Any], targets: int) -> NDArray[np.float32]:
    """The box, and others of its size at most 6 pixels away from it: [targets, 4]."""
    angles = np.arange(targets) * 2.4  # radians, the golden angle: no two are the same
    away = np.minimum(np.sqrt(np.arange(targets)), 6)
    moves = np.stack([away * np.cos(angles), away * np.sin(angles)], 1)
    return np.concatenate([box[:2] + moves, np.tile(box[2:], (targets, 1))], 1).astype(np.float32)


def clocked(call: Callable[[], Any]) -> Callable[[], float]:
    """A function that returns the seconds of the call, which is made once before, to compile."""
    jax.block_until_ready(call())

    def seconds() -> float:
        start = time.perf_counter()
        jax.block_until_ready(call())
        return time.perf_counter() - start

    return seconds


def take_turns(calls: Mapping[str, Callable[[], float]], rounds: int) -> dict[str, list[float]]:
    """What each call returns, seconds, one number a round; every other round goes backwards."""
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    order = list(calls)
    for _ in range(rounds):
        for name in order:
            seconds[name].append(calls[name]())
        order.reverse()
    return seconds


def ratios(above: Sequence[float], below: Sequence[float]) -> list[float]:
    """The ratio of each round."""
    return [one / other for one, other in zip(above, below, strict=True)]


def median_range(values: Sequence[float], digits: int = 1) -> str:
    """Median, and least and greatest value where there are several."""
    middle, low, high = (
        f"{value:.{digits}f}" for value in (statistics.median(values), min(values), max(values))
    )
    return middle if len(values) == 1 else f"{middle} ({low} to {high})"


class Worker:
    """A process that answers each line it reads with one, both JSON; for use in a `with`."""

    def __init__(
        self,
        arguments: Sequence[Any],
        python: str | Path | None = None,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        """Start `worker.py`.

        arguments: its command line. python: the interpreter, by default this one. environment:
            changes of the environment; by default the modules are those of this checkout.
        """
        self._command = [str(python or sys.executable), str(WORKER), *map(str, arguments)]
        self._process = subprocess.Popen(
            self._command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": str(HERE), **(environment or {})},
        )

    def __enter__(self) -> Self:
        """The worker itself."""
        return self

    def __exit__(self, *raised: object) -> None:
        """End the process, which has nothing more to read."""
        if raised[0] is not None:
            self._process.kill()
        self._process.communicate()

    def ask(self, question: Any = None) -> Any:
        """The answer to a question; RuntimeError where the process has ended."""
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # `read` raises
            self._process.stdin.write(json.dumps(question) + "\n")
            self._process.stdin.flush()
        return self.read()

    def read(self) -> Any:
        """The next line that the process writes; RuntimeError where it has ended."""
        assert self._process.stdout is not None
        answer = self._process.stdout.readline()
        if not answer:
            command = " ".join(self._command)
            raise RuntimeError(f"{command} ended with {self._process.wait()}")
        return json.loads(answer)


def fresh(*arguments: Any, cache: str | None = None) -> Any:
    """The first answer of a new process.

    cache: folder of its compiled programs, by default that of this process.
    """
    kept = cache or jax.config.jax_compilation_cache_dir  # type: ignore[attr-defined]
    environment = {
        "JAX_COMPILATION_CACHE_DIR": kept,
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": str(FROM_SECONDS),
    }
    with Worker(arguments, environment=environment) as worker:
        return worker.read()


class Row(NamedTuple):
    """A line of the table: what was measured, and what is asked for."""

    case: str
    measured: str
    asked: str = ""

    def __str__(self) -> str:
        return f"| {self.case} | {self.measured} | {self.asked} |"


class Panel(NamedTuple):
    """A diagram of growth: `lines` over `xs`, by name."""

    title: str
    x: str
    y: str
    xs: Sequence[float]
    lines: dict[str, list[float]]


class OtherTrackers(Worker):
    """The trackers of OpenCV and dlib, in a process of its own.

    python: the interpreter that has them, dlib only if it is installed. folder: for the frames
    that the process reads.
    """

    def __init__(self, python: Path, folder: Path) -> None:
        super().__init__(["others"], python)
        self._folder = folder
        found = self.read()
        self.versions: dict[str, str] = found["versions"]
        self.trackers: list[str] = found["trackers"]

    def clock(
        self, tracker: str, frames: NDArray[np.uint8], boxes: Any, updates: int
    ) -> Callable[[], float]:
        """A function that returns the seconds of updates of a tracker for each box [B, 4]."""
        with tempfile.NamedTemporaryFile(dir=self._folder, suffix=".npy", delete=False) as file:
            np.save(file, frames[: updates + 1])
        question = {
            "tracker": tracker,
            "frames": file.name,
            "boxes": np.asarray(boxes, np.float64).tolist(),
            "count": updates,
        }
        return lambda: float(self.ask(question))


class Inputs(NamedTuple):
    """What every case gets.

    name: of the sequence. frames: [T, H, W, 3]. box: [4] in the first frame.
    root: folder of the sequences, or None. rounds: of calls that take turns. quick: fewer points
    and frames.
    """

    name: str
    frames: NDArray[np.uint8]
    box: NDArray[np.float64]
    root: Path | None
    others: OtherTrackers
    rounds: int
    quick: bool


Case = Callable[[Inputs], Iterator[Row | Panel]]
