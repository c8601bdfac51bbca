"""Times of calls that take turns, and how they are written."""

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax


def take_turns(
    calls: Mapping[str, Callable[[], Any]], rounds: int, repeats: int = 1
) -> dict[str, list[float]]:
    """Seconds of each call, one number a round; all see the same machine, whose speed may drift.

    repeats: calls between two looks at the clock, for those that take microseconds. Each is called
    once beforehand, off the clock, as that may compile.
    """
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for call in calls.values():
        jax.block_until_ready(call())
    for _ in range(rounds):
        for name, call in calls.items():
            begin = time.perf_counter()
            for _ in range(repeats):
                made = call()
            jax.block_until_ready(made)
            seconds[name].append((time.perf_counter() - begin) / repeats)
    return seconds


def ratios(above: Sequence[float], below: Sequence[float]) -> list[float]:
    """Round by round, which a machine that drifts does not change."""
    return [one / other for one, other in zip(above, below, strict=True)]


def spread(values: Sequence[float], digits: int = 1) -> str:
    """Median, and least and greatest value where there are several."""
    middle, low, high = (
        f"{value:.{digits}f}" for value in (statistics.median(values), min(values), max(values))
    )
    return middle if len(values) == 1 else f"{middle} ({low} to {high})"
