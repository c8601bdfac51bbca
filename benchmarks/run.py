"""The figures of speed, all in one run, as a table in Markdown beside what is asked for.

    python -m benchmarks.run [ROOT] [--quick] [--only single,batch] [--plots docs]

ROOT is a folder of sequences as for `dcs-jax evaluate`; without it a rendered clip stands in for
the sequence, and the seeds of the sequences are left out. What is compared takes turns; a figure is
the median of --rounds (least to greatest). --python names the Python of an environment with the
contrib wheel of OpenCV, for KCF and CSRT on the same frames. A case that fails has a row that says
so, and the exit code is 1. --plots writes how time and memory grow as growth.png into a folder.
"""

import argparse
import os
import platform
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import jax
import numpy as np

import dcs_jax
from benchmarks import fresh, growth, throughput
from benchmarks.material import Case, Material, OpenCV, Panel, Row, load
from dcs_jax.cli.environment import keep_compiled_programs

CASES: dict[str, Case] = {
    "single": throughput.single,
    "targets": throughput.targets,
    "seeds": throughput.seeds,
    "sizes": growth.sizes,
    "frames": growth.frames,
    "batch": growth.batch,
    "length": fresh.length,
    "memory": fresh.memory,
    "first": fresh.first_call,
    "import": fresh.imports,
}
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
    parser.add_argument("--python", type=Path, default=Path(sys.executable), help="with OpenCV")
    parser.add_argument("--plots", type=Path, help="folder for growth.png")
    arguments = parser.parse_args(command_line)
    names = arguments.only.split(",") if arguments.only else list(CASES)
    if unknown := set(names) - set(CASES):
        parser.error(f"--only {','.join(unknown)}: expected some of {','.join(CASES)}")
    rounds = arguments.rounds or (QUICK_ROUNDS if arguments.quick else ROUNDS)
    begin = time.perf_counter()
    keep_compiled_programs()
    sequence = load(arguments.root, arguments.sequence, QUICK_FRAMES if arguments.quick else None)
    with tempfile.TemporaryDirectory() as folder, OpenCV(arguments.python, Path(folder)) as opencv:
        material = Material(*sequence, arguments.root, opencv, rounds, arguments.quick)
        print(about(material), end="\n\n")
        print("| case | measured | asked for |\n|---|---|---|", flush=True)
        panels: list[Panel] = []
        seconds: dict[str, float] = {}
        failed = False
        for name in names:
            since = time.perf_counter()
            for made in guarded(name, material):
                if isinstance(made, Panel):
                    panels.append(made)
                else:
                    print(made, flush=True)
                    failed |= made.measured.startswith(FAILED)
            seconds[name] = time.perf_counter() - since
    spent = ", ".join(f"{name} {taken:.0f}" for name, taken in seconds.items())
    print(f"\n{time.perf_counter() - begin:.0f} s in all: {spent}")
    if arguments.plots is not None and panels:
        growth.draw(panels, arguments.plots / "growth.png")
    return int(failed)


def guarded(name: str, material: Material) -> Iterator[Row | Panel]:
    """What a case gives, as soon as it does; what fails in it is a row and does not end the run."""
    try:
        yield from CASES[name](material)
    except Exception as error:
        message = " ".join(str(error).split()).replace("|", "/")
        yield Row(name, f"{FAILED}{type(error).__name__}: {message}")


def about(material: Material) -> str:
    """What the figures depend on, in two lines."""
    available = sorted(os.sched_getaffinity(0))
    held = "taskset" if len(available) < (os.cpu_count() or 1) else "no taskset"
    versions = {
        "dcs_jax": dcs_jax.__version__,
        "jax": jax.__version__,
        "numpy": np.__version__,
        "OpenCV": material.opencv.version,
        "Python": platform.python_version(),
    }
    named = ", ".join(f"{name} {version}" for name, version in versions.items())
    return (
        f"{len(available)} cores of {os.cpu_count()} ({held}: {','.join(map(str, available))}), "
        f"load {os.getloadavg()[0]:.1f} at the start; medians of {material.rounds} (least to "
        f"greatest)\n{named}; OpenCV has {', '.join(material.opencv.trackers)}"
    )


if __name__ == "__main__":
    raise SystemExit(main())
