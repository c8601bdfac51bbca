"""Whether this checkout is slower than another one, and whether its boxes are the same.

    python -m benchmarks.compare BASE [--sequence DIR] [--setting default] [--rounds 9]

BASE is a revision of git, for which there is a worktree for the time of the command, or the
directory of a checkout. Both track the same frames in processes of their own and in turn, so that
what else the machine does meets them alike; each round gives a ratio of their times. The exit code
is 1 where the whole 95 % interval of the ratios' median lies above 1 + tolerance, and 0 otherwise.
Boxes that differ are reported, and no failure: the change may be meant.
"""

import argparse
import contextlib
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from scipy.stats import binom

from benchmarks.against_opencv import load
from benchmarks.timing import ratios, spread, take_turns
from benchmarks.workers import HERE, Worker

SAME = 1e-3  # pixels: rounding differs between any two compiled programs


def main(command_line: Sequence[str] | None = None) -> int:
    """Compare, print a table, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("base", help="a revision of git, or the directory of a checkout")
    parser.add_argument("--sequence", type=Path, help="NAME with NAME/img/*; default: rendered")
    parser.add_argument("--setting", default="default", help="a preset and changes NAME=VALUE")
    parser.add_argument("--targets", type=int, default=1, help="tracked in one batch")
    parser.add_argument("--frames", type=int, default=150, help="at most")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--tolerance", type=float, default=0.1, help="0.1: a tenth slower")
    arguments = parser.parse_args(command_line)
    if arguments.rounds < 1 or arguments.targets < 1:
        parser.error("--rounds and --targets must be at least 1")
    frames, truth = load(arguments.sequence)
    frames = frames[: arguments.frames]
    with checkout_of(arguments.base) as base, tempfile.TemporaryDirectory() as folder:
        paths = Path(folder) / "frames.npy", Path(folder) / "boxes.npy"
        np.save(paths[0], frames)
        np.save(paths[1], around(truth[0], arguments.targets))
        script = HERE / "benchmarks" / "track_worker.py"
        command = [sys.executable, script, *paths, arguments.setting]
        with start(command, base) as old, start(command, HERE) as new:
            boxes = {"base": first_boxes(old, base), "this": first_boxes(new, HERE)}
            seconds = take_turns({"base": old.ask, "this": new.ask}, arguments.rounds)

    of_rounds = ratios(seconds["this"], seconds["base"])
    low, high = median_interval(of_rounds)
    size = f"{arguments.targets} x {len(frames)} frames of {frames.shape[2]}x{frames.shape[1]}"
    print(f"{arguments.setting}, {size}, {arguments.rounds} rounds in turn\n")
    print("| checkout | track-frames/s |")
    print("|---|---|")
    for name, times in seconds.items():
        label = f"{arguments.base} (base)" if name == "base" else "this"
        print(f"| {label} | {spread([boxes[name].size / 4 / t for t in times], 0)} |")
    print(
        f"\ntime of this / time of base: {statistics.median(of_rounds):.3f}, 95 % interval "
        f"{low:.3f} to {high:.3f}, rounds {min(of_rounds):.3f} to {max(of_rounds):.3f}"
    )
    apart = float(np.abs(boxes["this"] - boxes["base"]).max())
    print(f"boxes: {'the same' if apart <= SAME else 'NOT THE SAME'}, at most {apart:.2g} px apart")
    if low > 1 + arguments.tolerance:
        print(f"slower by more than {arguments.tolerance:.0%}")
        return 1
    return 0


def start(command: Sequence[str | Path], checkout: Path) -> Worker:
    """A process that imports the modules of a checkout before all others."""
    return Worker(command, {"PYTHONPATH": str(checkout)})


def first_boxes(worker: Worker, checkout: Path) -> np.ndarray:
    """The boxes [B, T, 4] with which it begins; RuntimeError where they are of another checkout."""
    first = worker.read()
    if not Path(first["package"]).resolve().is_relative_to(checkout.resolve()):
        raise RuntimeError(f"{checkout} has no dcs_jax: {first['package']} was run")
    return np.array(first["boxes"])


@contextlib.contextmanager
def checkout_of(base: str) -> Iterator[Path]:
    """The directory, or a worktree of the revision that is removed at the end."""
    if Path(base).is_dir():
        yield Path(base).resolve()
        return
    git = ["git", "-C", str(HERE)]
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "base"
        add = [*git, "worktree", "add", "--quiet", "--detach", str(place), base]
        done = subprocess.run(add, capture_output=True, text=True, check=False)
        if done.returncode:
            raise SystemExit(f"{base} is no directory and no revision: {done.stderr.strip()}")
        try:
            yield place
        finally:
            subprocess.run([*git, "worktree", "remove", "--force", str(place)], check=True)


def around(box: np.ndarray, targets: int) -> np.ndarray:
    """The box, and others of its size some pixels away from it: [targets, 4] float32."""
    angles = np.arange(targets) * 2.4  # radians, the golden angle: no two lie alike
    away = np.minimum(np.sqrt(np.arange(targets)), 6)
    moves = np.stack([away * np.cos(angles), away * np.sin(angles)], 1)
    return np.concatenate([box[:2] + moves, np.tile(box[2:], (targets, 1))], 1).astype(np.float32)


def median_interval(values: Sequence[float]) -> tuple[float, float]:
    """The 95 % interval of the median, from the order of the values alone.

    Of nine it is the second and the eighth; of five or fewer the least and the greatest.
    """
    ordered, count = sorted(values), len(values)
    outside = max(int(binom.ppf(0.025, count, 0.5)) - 1, 0)
    return ordered[outside], ordered[count - 1 - outside]


if __name__ == "__main__":
    raise SystemExit(main())
