"""Where the time of a step goes.

    python -m benchmarks.profile_step [SEQUENCE] [--setting 'default selectors=20'] [--frames 20]

Tracks under JAX's profiler, and adds up the times of XLA's operations by stage: the outermost
`jax.named_scope` of the tracker around an operation. The profiler adds some tenths of a microsecond
to each operation, which doubles a stage of many small ones. As the fastest operations take a few
nanoseconds, their time is what the profiler adds, and is taken off all. What XLA fuses across
stages counts for the last one. The sum should be near the time of a step without the profiler,
which is printed too. SEQUENCE is the folder of a sequence; without it a rendered clip is tracked.
"""

import argparse
import functools
import operator
import re
import statistics
import tempfile
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

from benchmarks.common import clocked, load, median_range
from dcs_jax.evaluation.settings import parse_setting
from dcs_jax.runners.sequence import init_track, track_chunk

ROUNDS = 9  # without the profiler
OTHER = "other"
# What JAX adds to the path of an operation for functions and control flow.
WRAPPER = re.compile(r".*\(.*\)|while|body|cond|closed_call|eval_jaxpr|branch_\d+_fun")
# Operations that run others, whose times would count twice.
CONTAINERS = ("while", "conditional", "call")
# Of the text of an HLO module: the compiled program offers nothing else.
HEAD = re.compile(r"(?:ENTRY )?%(\S+) \(.*\{$")
OPERATION = re.compile(r"\s+(?:ROOT )?%(\S+) = .*? ([\w-]+)\(")
PATH = re.compile(r'op_name="([^"]*)"')
CALLED = re.compile(
    r"(?:body|condition|to_apply|branch_computations)=\{?(%[^\s,}]+(?:, %[^\s,}]+)*)"
)


def main(command_line: Sequence[str] | None = None) -> None:
    """Print the table of one setting."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("sequence", nargs="?", type=Path)
    parser.add_argument("--setting", default="default", help="a preset and changes NAME=VALUE")
    parser.add_argument("--frames", type=int, default=20, help="profiled, at most")
    arguments = parser.parse_args(command_line)
    frames, truth = load(arguments.sequence, length=arguments.frames + 1)
    config = parse_setting(arguments.setting).config("").resolve(truth[0])
    shown = jnp.asarray(frames)
    state, _ = init_track(shown[0], jnp.asarray(truth[0], jnp.float32), jax.random.key(0), config)
    # A program that was kept from before the scopes have changed has the old ones.
    jax.config.update("jax_compilation_cache_include_metadata_in_key", True)
    steps = len(frames) - 1
    compiled = jax.jit(track_chunk).lower(state, shown[1:], config).compile()
    call = functools.partial(compiled, state, shown[1:], config)
    clock = clocked(call)
    alone = [1e6 * clock() / steps for _ in range(ROUNDS)]
    spent = by_stage(traced(call), stages(compiled.as_text() or ""))
    total = sum(seconds for seconds, _ in spent.values())

    print(f"{arguments.setting}: {steps} steps in {frames.shape[2]}x{frames.shape[1]}\n")
    print("| stage | us a step | share | operations |\n|---|---|---|---|")
    for name, (seconds, count) in spent.items():
        microseconds, share = 1e6 * seconds / steps, seconds / total
        print(f"| {name} | {microseconds:.0f} | {share:.0%} | {count / steps:.0f} |")
    print(
        f"\nall stages {1e6 * total / steps:.0f} us a step; without the profiler a step takes "
        f"{median_range(alone, 0)} us, median of {ROUNDS}"
    )


def stages(program: str) -> dict[str, str]:
    """The stage of every operation of a compiled program that does not run others, by its name.

    program: text of the HLO module. An operation without a stage, which XLA may have added, has
    that of the loop or branch it is in.
    """
    own: dict[str, str | None] = {}
    computations: dict[str, str] = {}  # by the names of the operations in them
    callers: dict[str, str] = {}  # operations, by the names of the computations they run
    leaves = []
    for line in program.splitlines():
        if head := HEAD.match(line):
            computation = head[1]
        elif operation := OPERATION.match(line):
            name, opcode = operation.groups()
            path = PATH.search(line)
            own[name], computations[name] = stage(path[1]) if path else None, computation
            for called in CALLED.findall(line):
                callers |= dict.fromkeys(called.replace("%", "").split(", "), name)
            if opcode not in CONTAINERS:
                leaves.append(name)

    def of(name: str) -> str:
        while own[name] is None and computations[name] in callers:
            name = callers[computations[name]]
        return own[name] or OTHER

    return {name: of(name) for name in leaves}


def stage(path: str) -> str | None:
    """The stage in the path of an operation, "jit(f)/while/body/STAGE/.../add"; None outside."""
    scopes = (part for part in path.split("/")[:-1] if not WRAPPER.fullmatch(part))
    return next(scopes, None)


def by_stage(
    times: Mapping[str, list[float]], stages: Mapping[str, str]
) -> dict[str, tuple[float, int]]:
    """Seconds and number of operations of each stage, the longest first.

    times: seconds of each run of an operation, by its name. An operation counts its median as often
        as it was run, since a single time may hold the turn of another process, less the least
        median, which is what the profiler adds.
    """
    medians = {name: statistics.median(times[name]) for name in times.keys() & stages.keys()}
    added = min(medians.values())
    spent: dict[str, tuple[float, int]] = {}
    for name, median in medians.items():
        seconds, count = spent.get(stages[name], (0.0, 0))
        runs = len(times[name])
        spent[stages[name]] = seconds + (median - added) * runs, count + runs
    return dict(sorted(spent.items(), key=operator.itemgetter(1), reverse=True))


def traced(call: Callable[[], Any]) -> dict[str, list[float]]:
    """Seconds of everything that the profiler saw in a call, by name."""
    options = jax.profiler.ProfileOptions()
    options.python_tracer_level = 0
    times: dict[str, list[float]] = defaultdict(list)
    with tempfile.TemporaryDirectory() as folder:
        with jax.profiler.trace(folder, profiler_options=options):
            jax.block_until_ready(call())
        [file] = Path(folder).rglob("*.xplane.pb")
        for plane in jax.profiler.ProfileData.from_file(str(file)).planes:
            for line in plane.lines:
                for event in line.events:
                    times[event.name].append(event.duration_ns / 1e9)
    return times


if __name__ == "__main__":
    main()
