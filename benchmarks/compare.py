"""Whether this checkout is slower than another one, and whether its boxes are the same.

    python -m benchmarks.compare BASE [--sequence DIR] [--setting default] [--rounds 9]

BASE is a revision of git, for which there is a worktree while the command runs, or the directory of
a checkout. --sequence and --setting may be given several times: each setting is then compared on
each sequence. Both checkouts track the same frames, in processes of their own and in turn, so that
the load of the machine is the same for both, and each round gives a ratio of their times. The exit
code is 1 if the whole 95 % interval of the ratios' median lies above 1 + tolerance in any of them,
and else 0. Boxes that differ are reported, but do not change it: the difference may be meant.
"""

import argparse
import contextlib
import itertools
import math
import statistics
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import quantile_test

from benchmarks.common import HERE, Worker, around, load, median_range, ratios, take_turns

SAME = 1e-3  # pixels: what rounding in a track of some hundred frames may come to


class Comparison(NamedTuple):
    """What was measured with one setting on one sequence.

    base, this: [B, T, 4] float32, the boxes. seconds: of each round, by the names "base", "this".
    """

    base: NDArray[np.float32]
    this: NDArray[np.float32]
    seconds: dict[str, list[float]]

    def slower(self, tolerance: float) -> bool:
        """Whether this checkout is slower by more than the tolerance, beyond chance."""
        return (
            median_interval(ratios(self.seconds["this"], self.seconds["base"]))[0] > 1 + tolerance
        )

    def boxes(self) -> str:
        """Whether the boxes are the same, in words."""
        if self.this.tobytes() == self.base.tobytes():
            return "identical, bit for bit"
        apart = float(np.abs(self.this - self.base).max())
        verdict = "the same to rounding" if apart <= SAME else "NOT THE SAME"
        return f"{verdict}, at most {apart:.2g} px apart"

    def __str__(self) -> str:
        """The table of speeds, the ratio and the boxes, as Markdown."""
        of_rounds = ratios(self.seconds["this"], self.seconds["base"])
        low, high = median_interval(of_rounds)
        track_frames = self.this.size / 4
        rates = (
            f"| {name} | {median_range([track_frames / t for t in times], 0)} |"
            for name, times in self.seconds.items()
        )
        return "\n".join(
            [
                "| checkout | track-frames/s |",
                "|---|---|",
                *rates,
                "",
                f"time of this / time of base: {statistics.median(of_rounds):.3f}, 95 % interval "
                f"{low:.3f} to {high:.3f}, rounds {min(of_rounds):.3f} to {max(of_rounds):.3f}",
                f"boxes: {self.boxes()}",
            ]
        )


def main(command_line: Sequence[str] | None = None) -> int:
    """Compare, print a table for each setting and sequence, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("base", help="a revision of git, or the directory of a checkout")
    parser.add_argument("--sequence", type=Path, action="append", help="default: rendered")
    parser.add_argument("--setting", action="append", help="a preset and changes NAME=VALUE")
    parser.add_argument("--targets", type=int, default=1, help="tracked in one batch")
    parser.add_argument("--frames", type=int, default=150, help="at most")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--tolerance", type=float, default=0.1, help="0.1: a tenth slower")
    arguments = parser.parse_args(command_line)
    if arguments.rounds < 1 or arguments.targets < 1:
        parser.error("--rounds and --targets must be at least 1")
    cases = itertools.product(arguments.sequence or [None], arguments.setting or ["default"])
    slower = False
    with checkout_of(arguments.base) as base:
        for sequence, setting in cases:
            frames, truth = load(sequence, length=arguments.frames)
            boxes = around(truth[0], arguments.targets)
            size = f"{len(boxes)} x {len(frames)} frames of {frames.shape[2]}x{frames.shape[1]}"
            name = "a rendered clip" if sequence is None else sequence.name
            print(
                f"\n{setting}, {name}, {size}, {arguments.rounds} rounds in turn "
                f"with {arguments.base}\n",
                flush=True,
            )
            found = compare(base, frames, boxes, setting, arguments.rounds)
            print(found, flush=True)
            if found.slower(arguments.tolerance):
                print(f"slower by more than {arguments.tolerance:.0%}")
                slower = True
    return int(slower)


def compare(
    base: Path, frames: NDArray[np.uint8], boxes: NDArray[np.float32], setting: str, rounds: int
) -> Comparison:
    """Track boxes [B, 4] through frames [T, H, W, 3] with the checkout at `base` and with this."""
    with tempfile.TemporaryDirectory() as folder:
        shown, initial = Path(folder) / "frames.npy", Path(folder) / "boxes.npy"
        np.save(shown, frames)
        np.save(initial, boxes)
        command = ["track", shown, initial, setting]
        with start(command, base) as old, start(command, HERE) as new:
            first = first_boxes(old, base), first_boxes(new, HERE)
            return Comparison(*first, take_turns({"base": old.ask, "this": new.ask}, rounds))


def start(command: Sequence[Any], checkout: Path) -> Worker:
    """A process that imports the modules of a checkout before all others."""
    return Worker(command, environment={"PYTHONPATH": str(checkout)})


def first_boxes(worker: Worker, checkout: Path) -> NDArray[np.float32]:
    """The boxes [B, T, 4] that the process writes first; RuntimeError if not of this checkout."""
    first = worker.read()
    if not Path(first["package"]).resolve().is_relative_to(checkout.resolve()):
        raise RuntimeError(f"{checkout} has no dcs_jax: {first['package']} was run")
    return np.array(first["boxes"], np.float32)


@contextlib.contextmanager
def checkout_of(base: str) -> Iterator[Path]:
    """The directory, or a worktree of the revision, which is removed at the end."""
    if Path(base).is_dir():
        yield Path(base).resolve()
        return
    git = ["git", "-C", str(HERE)]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "base"
        add = [*git, "worktree", "add", "--quiet", "--detach", str(path), base]
        done = subprocess.run(add, capture_output=True, text=True, check=False)
        if done.returncode:
            raise SystemExit(f"{base} is neither a directory nor a revision: {done.stderr.strip()}")
        try:
            yield path
        finally:
            subprocess.run([*git, "worktree", "remove", "--force", str(path)], check=True)


def median_interval(values: Sequence[float]) -> tuple[float, float]:
    """The 95 % interval of the median, from the order of the values alone.

    Of nine it is the second and the eighth; of five or fewer the least and the greatest.
    """
    low, high = quantile_test(values, p=0.5).confidence_interval(0.95)
    return (min(values), max(values)) if math.isnan(low) else (float(low), float(high))


if __name__ == "__main__":
    raise SystemExit(main())
