"""The programs of the slots: start tracks in some of them, or step those in some of them.

Track by track, each through a block of frames: its classifiers then stay in the cache. Measured
against the step vmapped over the tracks in docs/decisions.md.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32

from dcs_jax import tracker
from dcs_jax.config import Config
from dcs_jax.core.window import ColumnSums, VideoFrame, column_sums, share_column_sums
from dcs_jax.types import Frame, Frames, Pool, State, StepInfo

# So many frames' column sums are held at a time: they take 8 bytes a pixel.
_BLOCK = 4


class InitArguments(NamedTuple):
    """Arguments of `init_slots` for each slot, [S, ...], or None.

    frame: of its own, or None where all have the same. key: None where all share a pool.
    """

    config: Config
    new: Bool[Array, " S"]
    frame: Any
    box: Float[Array, "S 4"]
    key: Any


class ScanArguments(NamedTuple):
    """Arguments of `scan_slots` for each slot, [S, ...].

    steps: number of frames. frames: of its own, or None where all slots have the same.
    """

    config: Config
    steps: Int32[Array, " S"]
    frames: Any


def init_slots(
    states: State, each: InitArguments, common: tuple[Pool | None, Frame | None]
) -> tuple[State, StepInfo]:
    """`init` and `score` of the new slots; the others keep their state. Records [S, 1, ...]."""
    pool, frame = common
    sums = None
    if frame is not None and share_column_sums(len(each.new), frame.shape):
        sums = column_sums(frame)

    def init_slot(slot: tuple[State, InitArguments]) -> tuple[State, StepInfo]:
        old, (config, new, own_frame, box, key) = slot
        shown = sums or (own_frame if frame is None else frame)
        features = key if pool is None else pool

        def init() -> tuple[State, StepInfo]:
            state, info = tracker.start(shown, box, features, config)
            return without_pool(state, pool), info

        empty = _empty(jax.eval_shape(init)[1])
        state, info = jax.lax.cond(new, init, lambda: (old, empty))
        return state, jax.tree.map(lambda leaf: leaf[None], info)

    return jax.lax.map(init_slot, (states, each))


def scan_slots(
    states: State, each: ScanArguments, common: tuple[Pool | None, Frames | None]
) -> tuple[State, StepInfo]:
    """`step` of each slot through its number of frames. Records [S, T, ...], NaN after them."""
    pool, frames = common
    if frames is None or not share_column_sums(len(each.steps), frames.shape[1:]):

        def scan_alone(slot: tuple[State, ScanArguments]) -> tuple[State, StepInfo]:
            state, (config, steps, own_frames) = slot
            shown = own_frames if frames is None else frames

            def frame_at(t: Int32[Array, ""]) -> VideoFrame:
                return VideoFrame(shown, t)

            return _scan_slot(state, pool, config, frame_at, len(shown), steps)

        return jax.lax.map(scan_alone, (states, each))

    block = math.gcd(len(frames), _BLOCK)

    def scan_block(states: State, first: Int32[Array, ""]) -> tuple[State, StepInfo]:
        shown = jax.lax.dynamic_slice_in_dim(frames, first, block)
        # The pixels are read from the video: they would be copied.
        sums = jax.lax.map(lambda frame: column_sums(frame)._replace(pixels=None), shown)

        def frame_at(t: Int32[Array, ""]) -> ColumnSums:
            return _at(sums, t)._replace(pixels=VideoFrame(frames, first + t))

        def scan_slot(slot: tuple[State, ScanArguments]) -> tuple[State, StepInfo]:
            state, (config, steps, _) = slot
            steps = jnp.clip(steps - first, 0, block)
            return _scan_slot(state, pool, config, frame_at, block, steps)

        return jax.lax.map(scan_slot, (states, each))

    firsts = jnp.arange(0, len(frames), block, dtype=jnp.int32)
    states, infos = jax.lax.scan(scan_block, states, firsts)  # [T / block, S, block, ...]

    def in_a_row(leaf: Array) -> Array:
        leaf = jnp.moveaxis(leaf, 0, 1)
        return leaf.reshape(len(leaf), len(frames), *leaf.shape[3:])

    return states, jax.tree.map(in_a_row, infos)


def _scan_slot(
    state: State,
    pool: Pool | None,
    config: Config,
    frame_at: Callable[[Int32[Array, ""]], VideoFrame | ColumnSums],
    length: int,
    steps: Int32[Array, ""],
) -> tuple[State, StepInfo]:
    """One track through the first `steps` of `length` frames; its records [length, ...]."""

    def step(t: Int32[Array, ""], state: State) -> tuple[State, StepInfo]:
        full = state if pool is None else state._replace(pool=pool)
        state, info = tracker.step(full, frame_at(t), config)
        return without_pool(state, pool), info

    def record(t: Int32[Array, ""], carry: tuple[State, StepInfo]) -> tuple[State, StepInfo]:
        state, infos = carry
        state, info = step(t, state)
        return state, jax.tree.map(lambda rows, row: rows.at[t].set(row), infos, info)

    info = jax.eval_shape(step, jnp.int32(0), state)[1]
    infos = jax.tree.map(lambda row: jnp.repeat(row[None], length, 0), _empty(info))
    return jax.lax.fori_loop(0, steps, record, (state, infos))


def without_pool(state: State, pool: Pool | None) -> State:
    """The state as it is stored: without the pool, if all tracks share one."""
    nothing: Any = None
    return state if pool is None else state._replace(pool=nothing)


def _empty(info: StepInfo) -> StepInfo:
    """The record of a slot without a track."""

    def empty(leaf: jax.ShapeDtypeStruct) -> Array:
        return jnp.full(leaf.shape, jnp.nan if leaf.dtype.kind == "f" else 0, leaf.dtype)

    return jax.tree.map(empty, info)


def _at(tree: ColumnSums, t: Int32[Array, ""]) -> ColumnSums:
    return jax.tree.map(lambda leaf: leaf[t], tree)
