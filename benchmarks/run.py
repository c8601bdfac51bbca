"""All figures of speed in one run, as a table in Markdown with what is asked for.

    python -m benchmarks.run [ROOT] [--quick] [--only single,batch] [--plots docs]

ROOT is a folder of sequences as for `dcs-jax evaluate`; without it a rendered clip replaces the
sequence, and the seeds of the sequences are left out. Calls that are compared take turns; a figure
is the median of --rounds (least to greatest). --python is the Python of an environment with
opencv-contrib-python-headless and dlib-bin, for KCF, CSRT and dlib's correlation tracker on the
same frames. A case that fails has a row that says so, and the exit code is 1. --plots writes
growth.png, how time and memory grow, into a folder.
"""

import argparse
import functools
import os
import platform
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import dcs_jax
from benchmarks import growth
from benchmarks.common import (
    Case,
    Inputs,
    OtherTrackers,
    Panel,
    Row,
    around,
    clocked,
    fresh,
    load,
    median_range,
    ratios,
    take_turns,
)
from dcs_jax.compilation import cache
from dcs_jax.evaluation.datasets import find_sequences
from dcs_jax.evaluation.runner import run_seeds
from dcs_jax.evaluation.settings import parse_setting

PRESETS = ("default", "paper")
TARGETS, SEEDS = 32, 30
BATCHES = (1, 8, 32, 128, 256)
QUICK_ROUNDS, ROUNDS = 1, 5
QUICK_FRAMES = 33
FAILED = "FAILED: "


def main(command_line: Sequence[str] | None = None) -> int:
    """Measure and print; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("root", nargs="?", type=Path, help="folder of sequences")
    parser.add_argument("--sequence", default="david", help="of ROOT, for all but the seeds")
    parser.add_argument("--quick", action="store_true", help="fewer of everything: under 2 minutes")
    parser.add_argument("--rounds", type=int, help=f"default {ROUNDS}, quick {QUICK_ROUNDS}")
    parser.add_argument("--only", help=f"some of {','.join(CASES)}")
    parser.add_argument(
        "--python", type=Path, default=Path(sys.executable), help="with OpenCV and dlib"
    )
    parser.add_argument("--plots", type=Path, help="folder for growth.png")
    arguments = parser.parse_args(command_line)
    names = arguments.only.split(",") if arguments.only else list(CASES)
    if unknown := set(names) - set(CASES):
        parser.error(f"--only {','.join(unknown)}: expected some of {','.join(CASES)}")
    rounds = arguments.rounds or (QUICK_ROUNDS if arguments.quick else ROUNDS)
    start = time.perf_counter()
    cache()
    name = "a rendered clip" if arguments.root is None else arguments.sequence
    length = QUICK_FRAMES if arguments.quick else None
    frames, truth = load(arguments.root, arguments.sequence, length)
    with (
        tempfile.TemporaryDirectory() as folder,
        OtherTrackers(arguments.python, Path(folder)) as others,
    ):
        inputs = Inputs(name, frames, truth[0], arguments.root, others, rounds, arguments.quick)
        print(about(inputs), end="\n\n")
        print("| case | measured | asked for |\n|---|---|---|", flush=True)
        panels: list[Panel] = []
        seconds: dict[str, float] = {}
        failed = False
        for case in names:
            since = time.perf_counter()
            for made in guarded(case, inputs):
                if isinstance(made, Panel):
                    panels.append(made)
                else:
                    print(made, flush=True)
                    failed |= made.measured.startswith(FAILED)
            seconds[case] = time.perf_counter() - since
    spent = ", ".join(f"{name} {taken:.0f}" for name, taken in seconds.items())
    print(f"\n{time.perf_counter() - start:.0f} s in all: {spent}")
    if arguments.plots is not None and panels:
        growth.draw(panels, arguments.plots / "growth.png")
    return int(failed)


def guarded(name: str, inputs: Inputs) -> Iterator[Row | Panel]:
    """What a case yields; an exception in it is a row too, and does not end the run."""
    try:
        yield from CASES[name](inputs)
    except Exception as error:
        message = " ".join(str(error).split()).replace("|", "/")
        yield Row(name, f"{FAILED}{type(error).__name__}: {message}")


def about(inputs: Inputs) -> str:
    """What the figures depend on, in two lines."""
    available = sorted(os.sched_getaffinity(0))
    held = "taskset" if len(available) < (os.cpu_count() or 1) else "no taskset"
    versions = {
        "dcs_jax": dcs_jax.__version__,
        "jax": jax.__version__,
        "numpy": np.__version__,
        **inputs.others.versions,
        "Python": platform.python_version(),
    }
    named = ", ".join(f"{name} {version}" for name, version in versions.items())
    return (
        f"{len(available)} cores of {os.cpu_count()} ({held}: {','.join(map(str, available))}), "
        f"load {os.getloadavg()[0]:.1f} at the start; medians of {inputs.rounds} (least to "
        f"greatest)\n{named}; compared with {', '.join(inputs.others.trackers)}"
    )


def single(inputs: Inputs) -> Iterator[Row | Panel]:
    """One target, both presets and every other tracker; the frames are in memory.

    Of the others the updates alone are timed, of dcs_jax the whole track.
    """
    frames, box = inputs.frames, inputs.box
    updates = min(len(frames) - 1, 30 if inputs.quick else 200)
    shown = jnp.asarray(frames)
    calls = {}
    for preset in PRESETS:
        config = parse_setting(preset).config(inputs.name)
        track = functools.partial(dcs_jax.track_sequence, shown, box, jax.random.key(0), config)
        calls[preset] = clocked(track)
    for tracker in inputs.others.trackers:
        calls[tracker] = inputs.others.clock(tracker, frames, [box], updates)
    seconds = take_turns(calls, inputs.rounds)
    a_frame = {
        name: [t / (len(frames) if name in PRESETS else updates) for t in times]
        for name, times in seconds.items()
    }
    size = f"{frames.shape[2]}x{frames.shape[1]}, box of {box[2]:g}x{box[3]:g}"
    asked = {"default": "40 times MIL, ahead of KCF, CSRT and dlib", "paper": "25 times MIL"}
    for preset in PRESETS:
        times = ", ".join(
            f"{median_range(ratios(a_frame[tracker], a_frame[preset]))} times {tracker} "
            f"({1 / statistics.median(a_frame[tracker]):.0f} frames/s)"
            for tracker in inputs.others.trackers
        )
        rate = median_range([1 / t for t in a_frame[preset]], 0)
        yield Row(
            f"{inputs.name}, {size}, one target, {preset}: {len(frames)} frames, others {updates}",
            f"{rate} frames/s; {times}",
            asked[preset],
        )


def targets(inputs: Inputs) -> Iterator[Row | Panel]:
    """32 targets in one video, one target, and a loop over 32 of OpenCV's MIL."""
    chunks, updates = (1, 2) if inputs.quick else (4, 8)
    frames = inputs.frames[: 1 + 32 * chunks]
    boxes = around(inputs.box, TARGETS)
    shown = jnp.asarray(frames)
    one = functools.partial(dcs_jax.track_sequence, shown, inputs.box, jax.random.key(0))
    many = functools.partial(dcs_jax.track_batch, shown, boxes, jax.random.key(0))
    calls = {
        "one": clocked(one),
        "many": clocked(many),
        "MIL": inputs.others.clock("MIL", frames, boxes, updates),
    }
    seconds = take_turns(calls, inputs.rounds)
    one_frame = [t / len(frames) for t in seconds["one"]]
    many_frame = [t / len(frames) / TARGETS for t in seconds["many"]]
    mil_frame = [t / updates / TARGETS for t in seconds["MIL"]]
    yield Row(
        f"{TARGETS} targets in one video, default: {len(frames)} frames, MIL {updates}",
        f"{median_range([1 / t for t in many_frame], 0)} track-frames/s; "
        f"{median_range(ratios(one_frame, many_frame), 2)} times one target, "
        f"{median_range(ratios(mil_frame, many_frame))} times {TARGETS} MIL in a loop",
        "2 times one target, 60 times MIL",
    )


def seeds(inputs: Inputs) -> Iterator[Row | Panel]:
    """30 seeds of every sequence below the root, one run of each preset.

    In quick mode 33 frames of one sequence are tracked, from which the time of all follows.
    """
    if inputs.root is None:
        yield Row(f"{SEEDS} seeds of the sequences", "skipped: no ROOT was given")
        return
    entries = find_sequences(inputs.root)
    for preset, asked in zip(PRESETS, ("under 3 minutes", "under 6 minutes"), strict=True):
        setting = parse_setting(preset)
        start = time.perf_counter()
        if inputs.quick:
            few = inputs.frames[:33]
            runs = run_seeds(iter(few), inputs.box, range(SEEDS), setting.config(inputs.name))
            total = sum(len(entry.load().truth) for entry in entries)
            measured = (
                f"{runs.seconds / 60 * total / len(few):.1f} minutes of tracking, made of "
                f"{len(few)} frames of {inputs.name} for {total}"
            )
        else:
            tracking, count = 0.0, 0
            for entry in entries:
                sequence = entry.load()
                config = setting.config(entry.name)
                runs = run_seeds(sequence.frames, sequence.truth[0], range(SEEDS), config)
                tracking += runs.seconds
                count += int(np.prod(runs.boxes.shape[:2]))
            whole = time.perf_counter() - start
            measured = (
                f"{whole / 60:.1f} minutes with reading and compilation, "
                f"{tracking / 60:.1f} of tracking, one run ({count / tracking:.0f} track-frames/s)"
            )
        yield Row(f"{SEEDS} seeds of {len(entries)} sequences, {preset}", measured, asked)


def batch(inputs: Inputs) -> Iterator[Row | Panel]:
    """Track-frames per second over the number of targets in one video."""
    counts = BATCHES[:3:2] if inputs.quick else BATCHES
    shown = jnp.asarray(inputs.frames[: 9 if inputs.quick else 33])
    calls = {}
    for count in counts:
        boxes = around(inputs.box, count)
        track = functools.partial(dcs_jax.track_batch, shown, boxes, jax.random.key(0))
        calls[str(count)] = clocked(track)
    seconds = take_turns(calls, inputs.rounds)
    rates = {count: [count * len(shown) / t for t in seconds[str(count)]] for count in counts}
    yield Row(
        f"batch of {counts[0]} to {counts[-1]}, default: {len(shown)} frames",
        "; ".join(f"{n}: {median_range(rates[n], 0)}" for n in counts) + " track-frames/s",
        "linear or better: no fewer with more",
    )
    lines = {"track_batch": [statistics.median(rates[count]) for count in counts]}
    yield Panel("Targets in one video", "targets", "track-frames/s", counts, lines)


def first_call(inputs: Inputs) -> Iterator[Row | Panel]:
    """The first call of `track_sequence` in a process, with an empty and with a warm cache."""
    for preset in PRESETS[:1] if inputs.quick else PRESETS:
        cold: list[float] = []
        warm: list[float] = []
        second: list[float] = []
        for _ in range(inputs.rounds):
            with tempfile.TemporaryDirectory() as cache:
                for seconds in (cold, warm):
                    found = fresh("first", preset, cache=cache)
                    seconds.append(found["first"])
                    second.append(found["second"])
        yield Row(
            f"first call, {preset}",
            f"{median_range(cold)} s, with the cache warm {median_range(warm, 2)} s "
            f"(the second call {statistics.median(second):.2f} s)",
            "under 6 s, under 1 s warm",
        )


def imports(inputs: Inputs) -> Iterator[Row | Panel]:
    """`import dcs_jax` after `import jax`, in a process of its own."""
    seconds = [fresh("imports") for _ in range(inputs.rounds)]
    yield Row("import dcs_jax beyond jax", f"{median_range(seconds, 2)} s", "under 1 s")


CASES: dict[str, Case] = {
    "single": single,
    "targets": targets,
    "seeds": seeds,
    "table": growth.table,
    "sizes": growth.sizes,
    "frames": growth.frames,
    "batch": batch,
    "length": growth.length,
    "memory": growth.memory,
    "first": first_call,
    "import": imports,
}

if __name__ == "__main__":
    raise SystemExit(main())
