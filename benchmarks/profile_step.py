"""Where the time of a step goes.

    python -m benchmarks.profile_step [SEQUENCE] [--setting 'default selectors=20'] [--rounds 15]

For each stage of `tracker.step`, in microseconds: alone, and in the whole step (the step as far as
this stage, less the step as far as the one before). Beside it additions and bytes counted by hand,
the floor those imply at the rates of adding and of copying measured in the same run, and how many
times the floor the stage takes in the step. SEQUENCE is a folder NAME with NAME/img/* and
NAME/groundtruth_rect.txt; without it a rendered clip is tracked. That the stages together are the
step is checked first.
"""

import argparse
import functools
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.against_opencv import load
from dcs_jax import extras, tracker
from dcs_jax.config import Config
from dcs_jax.core.appearance import PLACES as PATCH
from dcs_jax.core.gradients import DIRECTIONS
from dcs_jax.core.haar import responses
from dcs_jax.core.samples import LABELS, training_patches
from dcs_jax.core.search import confidence_map, find_peak
from dcs_jax.core.selection import select
from dcs_jax.core.strong import combine
from dcs_jax.core.weak import error, update_weak
from dcs_jax.core.window import column_sums, window_integral
from dcs_jax.evaluation.settings import parse_setting
from dcs_jax.sequence import start_track, track_chunk
from dcs_jax.types import Sighting, State

CALLS = 20  # between two looks at the clock
LEARNED = 30  # frames tracked before the one that is measured
CORNERS = (2 * 6 + 2 * 8 + 9) / 5  # a feature has in the mean: its five types are equally likely
R, PATTERNS = len(LABELS), 2 ** len(LABELS)

Made = dict[str, Any]  # what the stages so far have returned, by their names
Counts = tuple[float, float]  # additions (a multiplication with it is free), bytes moved


class Size(NamedTuple):
    """What the counts are made of: of the frame, the window, the map and the pool."""

    pixels: int
    channels: int
    width: int
    rows: int  # lines of the window's integral image
    columns: int
    places: int
    parts: int
    problems: int  # K * N
    features: int
    iterations: int
    sizes: int

    @classmethod
    def of(cls, config: Config, frame: jax.Array) -> "Size":
        """The sizes of one step on this frame."""
        height, width = frame.shape[:2]
        problems = config.parts * config.selectors
        return cls(
            pixels=height * width,
            channels=frame.size // (height * width),
            width=width,
            rows=config.grid.window[0] + 1,
            columns=config.grid.window[1] + 1,
            places=int(np.prod(config.grid.positions)),
            parts=config.parts,
            problems=problems,
            features=problems * config.pool_size,
            iterations=config.iterations,
            sizes=config.sizes,
        )


class Stage(NamedTuple):
    """A part of the step: what it makes of frame, state and the stages before, and its counts."""

    name: str
    run: Callable[[jax.Array, State, Made, Config], Any]
    counts: Callable[[Size], Counts]


def stages(config: Config) -> list[Stage]:
    """The step in order; where it changes, so must this list."""
    table = [
        Stage(
            "column sums",
            lambda frame, state, made, config: column_sums(frame),
            lambda n: (n.pixels * (n.channels + 1), n.pixels * (n.channels + 8)),
        ),
        Stage(
            "window, search",
            lambda frame, state, made, config: window_integral(
                made["column sums"], state.box, config.grid
            ),
            _window,
        ),
        Stage(
            "confidence map",
            lambda frame, state, made, config: confidence_map(
                made["window, search"], state.pool, state.weak, state.strong, config
            ),
            # One view a corner, then midpoint, sign and sum; the views stay in the nearest cache.
            lambda n: (
                n.problems * n.places * (CORNERS + 3),
                4 * (n.rows * n.columns + 2 * n.parts * n.places),
            ),
        ),
        Stage(
            "place filter",
            lambda frame, state, made, config: extras.witness(
                state.extras, made["window, search"], config
            ),
            _gradients,
        ),
        Stage("peak", _peak, lambda n: (20 * n.places, 4 * 10 * n.places)),
        Stage("recognition", _recognise, _patches),
        Stage("elsewhere, if lost", _elsewhere, lambda n: (0, 0)),
        Stage(
            "window, training",
            lambda frame, state, made, config: window_integral(
                made["column sums"], _seen(made).box, config.grid
            ),
            _window,
        ),
        Stage(
            "Haar responses",
            lambda frame, state, made, config: responses(
                training_patches(
                    made["window, training"], _seen(made).box, made["column sums"].shape, config
                ),
                state.pool,
            ),
            # Nine corners, weights and the R values at each; then transposed.
            lambda n: (9 * R * n.features, n.features * (9 * (2 + 1 + 4 * R) + 4 * 3 * R)),
        ),
        Stage(
            "weak update",
            lambda frame, state, made, config: update_weak(state.weak, made["Haar responses"]),
            lambda n: (n.features * (4 * (R - 1) + 5 * R), 4 * n.features * (2 * R + 8)),
        ),
        Stage(
            "selection",
            _select,
            # Votes to patterns and back; in each iteration Phi x and Phi' r, and the two iterates.
            lambda n: (
                4 * R * n.features + n.iterations * n.problems * PATTERNS * (2 * R + 6),
                4 * n.features * (R + 2) + 4 * n.iterations * n.problems * PATTERNS * 6,
            ),
        ),
        Stage("strong", _combine, lambda n: (2 * n.features, 4 * 3 * n.features)),
        Stage("extras, learning", _learn, _both),
    ]
    only_extras = {"place filter", "recognition", "elsewhere, if lost", "extras, learning"}
    return [stage for stage in table if config.extras or stage.name not in only_extras]


def _window(n: Size) -> Counts:
    """Each line takes two rows of the frame, and their sums run along it; columns likewise."""
    down, across = n.rows * n.width, n.rows * n.columns
    return 4 * down + 3 * across, 4 * (6 * down + 4 * across)


def _gradients(n: Size) -> Counts:
    """Of the place filter: differences, then directions; its transforms have few cells."""
    cells = n.rows * n.columns
    return cells * (4 + 2 * DIRECTIONS), 4 * cells * (6 + DIRECTIONS)


def _patches(n: Size) -> Counts:
    """Of S resampled patches: each line is between two of the integral image, both ways."""
    lines, places = n.sizes * PATCH * n.columns, n.sizes * PATCH**2
    return 2 * lines + places * (6 + 2 * DIRECTIONS), 4 * (3 * lines + places * (6 + DIRECTIONS))


def _both(n: Size) -> Counts:
    """Of the place filter and the patches, to learn from."""
    (additions, moved), (more, more_moved) = _gradients(n), _patches(n)
    return additions + more, moved + more_moved


def _seen(made: Made) -> Sighting:
    sighting: Sighting = made.get("elsewhere, if lost", made["peak"][0])
    return sighting


def _peak(frame: jax.Array, state: State, made: Made, config: Config) -> tuple[Sighting, jax.Array]:
    found, shape = made["confidence map"], made["column sums"].shape
    evidence = found.evidence + made.get("place filter", 0)
    displacement = find_peak(evidence, state.box, shape, config)
    noisy_or, scores = found.at(*tracker._nearest(displacement, config.grid))
    moved = tracker._move(state.box, displacement, shape, config.grid)
    return Sighting(moved, noisy_or, scores), displacement


def _recognise(frame: jax.Array, state: State, made: Made, config: Config) -> Sighting:
    assert state.extras is not None
    seen, displacement = made["peak"]
    window, shape = made["window, search"], made["column sums"].shape
    return extras.recognise(state.extras, seen, window, displacement, shape, config)


def _elsewhere(frame: jax.Array, state: State, made: Made, config: Config) -> Sighting:
    return extras.seek(tracker._find, state, made["recognition"], made["column sums"], config)


def _select(frame: jax.Array, state: State, made: Made, config: Config) -> Any:
    weak, votes = made["weak update"]
    shape = (config.pool_size, config.parts, config.selectors)
    return select(votes.reshape(-1, *shape), error(weak).reshape(shape), config)


def _combine(frame: jax.Array, state: State, made: Made, config: Config) -> Any:
    shape = (config.pool_size, config.parts, config.selectors)
    return combine(made["selection"][0], error(made["weak update"][0]).reshape(shape))


def _learn(frame: jax.Array, state: State, made: Made, config: Config) -> State:
    window = made["window, training"]
    return extras.learn(state, _learned(state, made), _seen(made), window, config)[0]


def _learned(state: State, made: Made) -> State:
    """The state with what the classifiers have learned."""
    weak, _ = made["weak update"]
    return state._replace(box=_seen(made).box, weak=weak, strong=made["strong"])


def run(table: list[Stage], frame: jax.Array, state: State, config: Config) -> Made:
    """The stages in turn: what each made."""
    made: Made = {}
    for stage in table:
        made[stage.name] = stage.run(frame, state, made, config)
    return made


def check(made: Made, frame: jax.Array, state: State, config: Config) -> None:
    """RuntimeError where the stages did not make the state that `tracker.step` makes."""
    whole, _ = jax.jit(tracker.step)(state, frame, config)
    staged = made["extras, learning"] if config.extras else _learned(state, made)
    for one, other in zip(jax.tree.leaves(whole), jax.tree.leaves(staged), strict=True):
        if not np.allclose(one, other, rtol=1e-3, atol=1e-3):
            raise RuntimeError("the stages listed here are no longer those of tracker.step")


def rates() -> tuple[float, float]:
    """Additions a second, one operand in the cache each, and bytes copied a second."""
    views, side, numbers = 8, 256, 1 << 17  # all of it stays in the cache
    image = jnp.ones((side + views, side + views), jnp.float32)
    line = jnp.ones(numbers, jnp.float32)

    @jax.jit
    def add(image: jax.Array) -> jax.Array:
        shifted = [image[shift : shift + side, shift : shift + side] for shift in range(views)]
        return functools.reduce(jnp.add, shifted)

    copy = jax.jit(jnp.negative)
    seconds = measure({"add": lambda: add(image), "copy": lambda: copy(line)}, 15)
    # A floor takes the best that the machine did.
    return views * side**2 / seconds["add"][0], 8 * numbers / seconds["copy"][0]


def measure(calls: dict[str, Callable[[], Any]], rounds: int) -> dict[str, list[float]]:
    """Seconds of each call, sorted; they take turns, so that all see the same machine."""
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for call in calls.values():
        jax.block_until_ready(call())  # compiles
    for _ in range(rounds):
        for name, call in calls.items():
            begin = time.perf_counter()
            for _ in range(CALLS):
                made = call()
            jax.block_until_ready(made)
            seconds[name].append((time.perf_counter() - begin) / CALLS)
    return {name: sorted(times) for name, times in seconds.items()}


def main() -> None:
    """Print the table of one setting."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("sequence", nargs="?", type=Path)
    parser.add_argument("--setting", default="default", help="a preset and changes NAME=VALUE")
    parser.add_argument("--rounds", type=int, default=15)
    arguments = parser.parse_args()
    frames, truth = load(arguments.sequence)
    config = parse_setting(arguments.setting).config("").resolve(truth[0])
    shown = jnp.asarray(frames[: LEARNED + 2])
    state, _ = start_track(shown[0], jnp.asarray(truth[0], jnp.float32), jax.random.key(0), config)
    state, _ = track_chunk(state, shown[1:-1], config)
    frame, table = shown[-1], stages(config)
    made = jax.jit(functools.partial(run, table))(frame, state, config)
    check(made, frame, state, config)

    nothing = jax.jit(lambda frame, state, made, config: frame[0, 0])
    calls = {"nothing": functools.partial(nothing, frame, state, made, config)}
    for number, stage in enumerate(table):
        so_far = jax.jit(functools.partial(run, table[: number + 1]))
        calls[f"alone {number}"] = functools.partial(jax.jit(stage.run), frame, state, made, config)
        calls[f"so far {number}"] = functools.partial(so_far, frame, state, config)
    measured = measure(calls, arguments.rounds)
    seconds = {name: statistics.median(times) for name, times in measured.items()}
    additions, copied = rates()

    size = Size.of(config, frame)
    print(f"{arguments.setting}: {size}")
    print(f"{additions / 1e9:.1f} additions and {copied / 1e9:.1f} bytes a nanosecond\n")
    print("| stage | alone, us | in the step, us | 1000 additions | kB | floor, us | times floor |")
    print("|---|---|---|---|---|---|---|")
    before, least = seconds["nothing"], 0.0
    for number, stage in enumerate(table):
        operations, moved = stage.counts(size)
        floor = max(operations / additions, moved / copied)
        alone = seconds[f"alone {number}"] - seconds["nothing"]
        in_step = seconds[f"so far {number}"] - before
        before, least = before + in_step, least + floor
        print(
            f"| {stage.name} | {alone * 1e6:.0f} | {in_step * 1e6:.0f} | {operations / 1e3:.0f} "
            f"| {moved / 1e3:.0f} | {floor * 1e6:.0f} "
            f"| {f'{in_step / floor:.1f}' if floor else ''} |"
        )
    total = before - seconds["nothing"]
    print(f"| all | | {total * 1e6:.0f} | | | {least * 1e6:.0f} | {total / least:.1f} |")


if __name__ == "__main__":
    main()
