"""Many seeds of one sequence in one compiled call."""

import functools
import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from time import perf_counter
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Key
from numpy.typing import NDArray

from dcs_jax import tracker
from dcs_jax.config import Config
from dcs_jax.io.frames import chunks
from dcs_jax.sequence import Frames
from dcs_jax.types import Frame, State, StepInfo

CHUNK_FRAMES = 32
CHUNK_BYTES = 2**28  # fewer frames a chunk where they are very large

# As in sequence.py: one thread for the products of a step. The seeds are shared among threads.
_OPTIONS: dict[str, Any] = {"xla_cpu_multi_thread_eigen": False}


class Runs(NamedTuple):
    """The tracks of S seeds of one sequence.

    boxes: [S, T, 4] float32, x, y, w, h in pixels; the first row is the given box.
    confidence: [S, T] float32 in [0, 1]; NaN for a tracker that has none.
    seconds: of tracking the S seeds, without compilation and without reading the frames.
    """

    boxes: NDArray[np.float32]
    confidence: NDArray[np.float32]
    seconds: float


def run_seeds(
    frames: Iterable[NDArray[np.uint8]],
    box: NDArray[np.float64],
    seeds: Sequence[int],
    config: Config,
    advance: Callable[[int], None] = lambda tracked: None,
) -> Runs:
    """Track a box with every seed: the tracks of `track_sequence` with `jax.random.key(seed)`.

    The seeds are dealt out to one thread a core, and each thread runs its seeds in one compiled
    call, chunk of frames by chunk, so that memory does not grow with the length of the video.

    frames: [H, W, 3] uint8 RGB each, read as they are needed.
    box: [4], x, y, w, h in pixels, of the first frame.
    advance: is told the number of track-frames after each chunk.
    """
    rest = iter(frames)
    first = next(rest)
    config = config.resolve(box)
    shares = [share for share in np.array_split(np.asarray(seeds), cores()) if share.size]
    size = max(1, min(CHUNK_FRAMES, CHUNK_BYTES // first.nbytes))
    seconds = 0.0
    with ThreadPoolExecutor(len(shares)) as threads:

        def on_each(function: Any, *columns: Iterable[Any], counts: float = 1) -> list[Any]:
            """Compile, then call on every share at once and wait.

            The fraction of the time that counts goes on the clock.
            """
            nonlocal seconds
            arguments = list(zip(*columns, strict=True))
            # One after the other: shares of the same size have the same program.
            compiled = [_compiled(function, *given) for given in arguments]
            begin = perf_counter()
            calls = zip(compiled, arguments, strict=True)
            done = threads.map(lambda call: jax.block_until_ready(call[0](*call[1])), calls)
            results = list(done)
            seconds += (perf_counter() - begin) * counts
            return results

        def same(value: Any) -> list[Any]:
            return [value] * len(shares)

        keys = [jax.vmap(jax.random.key)(jnp.asarray(share, jnp.uint32)) for share in shares]
        corner = same(jnp.asarray(box, jnp.float32))
        started = on_each(_start, same(jnp.asarray(first)), corner, keys, same(config))
        states = [state for state, _ in started]
        collected = [[info] for _, info in started]
        advance(len(seeds))
        for chunk in chunks(rest, size):
            # Chunks of one length whatever the video's: one compiled program serves all.
            padding = np.repeat(chunk[-1:], size - len(chunk), axis=0)
            padded = jnp.asarray(np.concatenate([chunk, padding]))
            counts = len(chunk) / size
            followed = on_each(_follow, states, same(padded), same(config), counts=counts)
            states = [state for state, _ in followed]
            for share, (_, infos) in zip(collected, followed, strict=True):
                share.append(jax.tree.map(lambda leaf: leaf[:, : len(chunk)], infos))  # noqa: B023
            advance(len(seeds) * len(chunk))

    def gather(field: str) -> NDArray[np.float32]:
        return np.concatenate(
            [np.concatenate([getattr(infos, field) for infos in share], 1) for share in collected]
        )

    return Runs(gather("box"), gather("confidence"), seconds)


@functools.partial(jax.jit, compiler_options=_OPTIONS)
def _start(
    frame: Frame, box: Float[Array, "4"], keys: Key[Array, " S"], config: Config
) -> tuple[State, StepInfo]:
    """States after the first frame and its records [S, 1, ...], one a key."""

    def start(key: Key[Array, ""]) -> tuple[State, StepInfo]:
        state = tracker.init(frame, box, key, config)
        info = tracker.score(state, frame, config)
        return state, jax.tree.map(lambda leaf: leaf[None], info)

    return jax.vmap(start)(keys)


@functools.partial(jax.jit, compiler_options=_OPTIONS)
def _follow(state: State, frames: Frames, config: Config) -> tuple[State, StepInfo]:
    """States after the next frames and their records [S, T, ...].

    Seed by seed, each scanned over the frames: its classifiers then stay in the cache. Ten seeds
    of david on two threads: 390 track-frames/s with the paper preset, against 325 for one scan of
    the step vmapped over the seeds; 570 against 517 with the default.
    """

    def follow(state: State) -> tuple[State, StepInfo]:
        return jax.lax.scan(lambda state, frame: tracker.step(state, frame, config), state, frames)

    return jax.lax.map(follow, state)


_programs: dict[Any, Any] = {}


def _compiled(function: Any, *arguments: Any) -> Any:
    """The program for arguments of these shapes, compiled once and not on the clock."""
    leaves, structure = jax.tree.flatten(arguments)
    key = (function, structure, *map(_kind, leaves))
    if key not in _programs:
        _programs[key] = function.lower(*arguments).compile()
    return _programs[key]


def _kind(leaf: Any) -> tuple[Any, ...]:
    """What a program depends on of an argument; a Python number has a type of its own."""
    dtype = getattr(leaf, "dtype", type(leaf))
    return np.shape(leaf), dtype, getattr(leaf, "weak_type", False)


def cores() -> int:
    """The cores this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1
