"""Cases of `benchmarks.run` in fresh processes: first call, import, long videos and memory."""

import statistics
import sys
import tempfile
from collections.abc import Iterator
from typing import Any

import jax

from benchmarks.material import PRESETS, Material, Panel, Row
from benchmarks.timing import spread
from benchmarks.workers import HERE, answer_of
from dcs_jax.cli.environment import CACHE_FROM_SECONDS

IMPORTS = """
from time import perf_counter
begin = perf_counter()
import jax
middle = perf_counter()
import dcs_jax
print(perf_counter() - middle)
"""
LENGTHS = (100, 1000, 10_000, 100_000)
BATCHES = (1, 32, 256)


def first_call(material: Material) -> Iterator[Row | Panel]:
    """The first call of `track_sequence` in a process, with an empty and with a warm cache."""
    for preset in PRESETS[:1] if material.quick else PRESETS:
        cold: list[float] = []
        warm: list[float] = []
        second: list[float] = []
        for _ in range(material.rounds):
            with tempfile.TemporaryDirectory() as cache:
                for seconds in (cold, warm):
                    found = _fresh("first", preset, **_cache(cache))
                    seconds.append(found["first"])
                    second.append(found["second"])
        yield Row(
            f"first call, {preset}",
            f"{spread(cold)} s, with the cache warm {spread(warm, 2)} s "
            f"(the second call {statistics.median(second):.2f} s)",
            "under 6 s, under 1 s warm",
        )


def imports(material: Material) -> Iterator[Row | Panel]:
    """`import dcs_jax` after `import jax`, in a process of its own."""
    command = [sys.executable, "-c", IMPORTS]
    here = {"PYTHONPATH": str(HERE)}
    seconds = [answer_of(command, here) for _ in range(material.rounds)]
    yield Row("import dcs_jax beyond jax", f"{spread(seconds, 2)} s", "under 1 s")


def length(material: Material) -> Iterator[Row | Panel]:
    """A stream of one target over the number of frames: time and peak memory, one run of each."""
    lengths = LENGTHS[:2] if material.quick else LENGTHS
    found = [_fresh("stream", count, 1) for count in lengths]
    a_frame = [1e3 * one["seconds"] / count for one, count in zip(found, lengths, strict=True)]
    yield Row(
        f"{lengths[0]} to {lengths[-1]} frames of 320x240, track_stream, default",
        "; ".join(
            f"{count}: {time:.2f} ms a frame, {one['peak'] / 1e6:.1f} MB"
            for count, time, one in zip(lengths, a_frame, found, strict=True)
        )
        + f"; the longest: {_shares(found[-1])}",
        "linear or better; memory within 1.5 times state plus one chunk",
    )
    yield Panel("Frames of a stream", "frames", "ms a frame", lengths, {"track_stream": a_frame})
    yield _memory_panel("Memory over frames", "frames", lengths, found)


def memory(material: Material) -> Iterator[Row | Panel]:
    """Peak memory of a stream over the number of targets, one run of each."""
    counts = BATCHES[1:2] if material.quick else BATCHES
    found = [_fresh("stream", 65, count) for count in counts]
    yield Row(
        f"memory of {', '.join(map(str, counts))} targets in 320x240, track_stream, default",
        "; ".join(f"{count}: {_shares(one)}" for count, one in zip(counts, found, strict=True)),
        "within 1.5 times state plus one chunk",
    )
    yield _memory_panel("Memory over targets", "targets", counts, found)


def _fresh(*arguments: Any, **environment: str) -> Any:
    command = [sys.executable, "-m", "benchmarks.fresh_worker", *map(str, arguments)]
    return answer_of(command, {"PYTHONPATH": str(HERE), **_cache(), **environment})


def _cache(folder: str | None = None) -> dict[str, str]:
    """Where compiled programs are kept, as environment; by default where this process does it."""
    kept: str = jax.config.jax_compilation_cache_dir  # type: ignore[attr-defined]
    return {
        "JAX_COMPILATION_CACHE_DIR": folder or kept,
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": str(CACHE_FROM_SECONDS),
    }


def _shares(one: dict[str, float]) -> str:
    least = one["states"] + one["chunk"]
    return (
        f"{one['peak'] / 1e6:.1f} MB = {one['peak'] / least:.2f} times (state "
        f"{one['states'] / 1e6:.1f} + chunk {one['chunk'] / 1e6:.1f} MB)"
    )


def _memory_panel(title: str, x: str, xs: tuple[int, ...], found: list[Any]) -> Panel:
    lines = {
        "peak beside the idle process": [one["peak"] / 1e6 for one in found],
        "state and one chunk": [(one["states"] + one["chunk"]) / 1e6 for one in found],
    }
    return Panel(title, x, "MB", xs, lines)
