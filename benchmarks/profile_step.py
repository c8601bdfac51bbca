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
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from benchmarks import counts
from benchmarks.against_opencv import load
from benchmarks.timing import clocked, take_turns
from dcs_jax import tracker
from dcs_jax.config import Config
from dcs_jax.core.haar import responses
from dcs_jax.core.samples import training_patches
from dcs_jax.core.search import confidence_map, find_peak
from dcs_jax.core.selection import select
from dcs_jax.core.strong import combine
from dcs_jax.core.weak import error, update_weak
from dcs_jax.core.window import column_sums, window_integral
from dcs_jax.evaluation.settings import parse_setting
from dcs_jax.extensions import extras
from dcs_jax.runners.sequence import start_track, track_chunk
from dcs_jax.types import Sighting, State

CALLS = 20  # between two looks at the clock
LEARNED = 30  # frames tracked before the one that is measured

Made = dict[str, Any]  # what the stages so far have returned, by their names


class Stage(NamedTuple):
    """A part of the step: what it makes of frame, state and the stages before, and its counts."""

    name: str
    run: Callable[[jax.Array, State, Made, Config], Any]
    counts: Callable[[counts.Size], counts.Counts]


def stages(config: Config) -> list[Stage]:
    """The step in order; where it changes, so must this list."""
    table = [
        Stage("column sums", lambda frame, state, made, config: column_sums(frame), counts.sums),
        Stage(
            "window, search",
            lambda frame, state, made, config: window_integral(
                made["column sums"], state.box, config.grid
            ),
            counts.window,
        ),
        Stage(
            "confidence map",
            lambda frame, state, made, config: confidence_map(
                made["window, search"], state.pool, state.weak, state.strong, config
            ),
            counts.votes,
        ),
        Stage("place filter", _witness, counts.gradients),
        Stage("peak", _peak, counts.peak),
        Stage("recognition", _recognise, counts.patches),
        Stage("elsewhere, if lost", _elsewhere, counts.nothing),
        Stage(
            "window, training",
            lambda frame, state, made, config: window_integral(
                made["column sums"], _seen(made).box, config.grid
            ),
            counts.window,
        ),
        Stage(
            "Haar responses",
            lambda frame, state, made, config: responses(
                training_patches(
                    made["window, training"], _seen(made).box, made["column sums"].shape, config
                ),
                state.pool,
            ),
            counts.haar,
        ),
        Stage(
            "weak update",
            lambda frame, state, made, config: update_weak(state.weak, made["Haar responses"]),
            counts.weak,
        ),
        Stage("selection", _select, counts.selection),
        Stage("strong", _combine, counts.strong),
        Stage("extras, learning", _learn, counts.both),
    ]
    only_extras = {"place filter", "recognition", "elsewhere, if lost", "extras, learning"}
    return [stage for stage in table if config.extras or stage.name not in only_extras]


def _seen(made: Made) -> Sighting:
    sighting: Sighting = made.get("elsewhere, if lost", made["peak"][0])
    return sighting


def _witness(frame: jax.Array, state: State, made: Made, config: Config) -> jax.Array:
    assert state.extras is not None
    return extras.witness(state.extras, made["window, search"], config)


def _peak(frame: jax.Array, state: State, made: Made, config: Config) -> tuple[Sighting, jax.Array]:
    votes, window, shape = made["confidence map"], made["window, search"], made["column sums"].shape
    displacement = find_peak(votes.evidence + made.get("place filter", 0), state.box, shape, config)
    # Without extras: recognition is a stage of its own.
    plain = state._replace(extras=None)
    seen = tracker._sight(plain, state.box, displacement, votes, window, shape, config)
    return seen, displacement


def _recognise(frame: jax.Array, state: State, made: Made, config: Config) -> Sighting:
    assert state.extras is not None
    seen, displacement = made["peak"]
    window, shape = made["window, search"], made["column sums"].shape
    return extras.recognise(state.extras, seen, state.given, window, displacement, shape, config)


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


def prepare(
    frames: NDArray[np.uint8], box: NDArray[np.float64], config: Config
) -> tuple[jax.Array, State]:
    """The last frame, and the state of a track through those before it."""
    shown = jnp.asarray(frames)
    state, _ = start_track(shown[0], jnp.asarray(box, jnp.float32), jax.random.key(0), config)
    state, _ = track_chunk(state, shown[1:-1], config)
    return shown[-1], state


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
    calls = {"add": lambda: add(image), "copy": lambda: copy(line)}
    seconds = take_turns({name: clocked(call, CALLS) for name, call in calls.items()}, 15)
    # A floor takes the best that the machine did.
    return views * side**2 / min(seconds["add"]), 8 * numbers / min(seconds["copy"])


def main() -> None:
    """Print the table of one setting."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("sequence", nargs="?", type=Path)
    parser.add_argument("--setting", default="default", help="a preset and changes NAME=VALUE")
    parser.add_argument("--rounds", type=int, default=15)
    arguments = parser.parse_args()
    frames, truth = load(arguments.sequence)
    config = parse_setting(arguments.setting).config("").resolve(truth[0])
    frame, state = prepare(frames[: LEARNED + 2], truth[0], config)
    table = stages(config)
    made = jax.jit(functools.partial(run, table))(frame, state, config)
    check(made, frame, state, config)

    nothing = jax.jit(lambda frame, state, made, config: frame[0, 0])
    calls: dict[str, Callable[[], Any]] = {
        "nothing": functools.partial(nothing, frame, state, made, config)
    }
    for number, stage in enumerate(table):
        so_far = jax.jit(functools.partial(run, table[: number + 1]))
        calls[f"alone {number}"] = functools.partial(jax.jit(stage.run), frame, state, made, config)
        calls[f"so far {number}"] = functools.partial(so_far, frame, state, config)
    clocks = {name: clocked(call, CALLS) for name, call in calls.items()}
    measured = take_turns(clocks, arguments.rounds)
    seconds = {name: statistics.median(times) for name, times in measured.items()}
    additions, copied = rates()

    size = counts.Size.of(config, frame)
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
