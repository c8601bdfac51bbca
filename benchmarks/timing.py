"""Times of calls that take turns, and how they are written."""

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax


def clocked(call: Callable[[], Any], repeats: int = 1) -> Callable[[], float]:
    """The call, once done off the clock, as that may compile, as one that returns its seconds.

    repeats: calls between two looks at the clock, for those that take microseconds.
    """
    jax.block_until_ready(call())

    def seconds() -> float:
        begin = time.perf_counter()
        for _ in range(repeats):
            made = call()
        jax.block_until_ready(made)
        return (time.perf_counter() - begin) / repeats

    return seconds


def take_turns(calls: Mapping[str, Callable[[], float]], rounds: int) -> dict[str, list[float]]:
    """What each call returns, seconds, one number a round.

    So all see the same machine, whose speed may drift; every other round goes backwards.
    """
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    order = list(calls)
    for _ in range(rounds):
        for name in order:
            seconds[name].append(calls[name]())
        order.reverse()
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
