"""Many tracks that go through their frames together: what batches, streams and seeds run on.

Track by track, each through a block of frames: its classifiers then stay in the cache. Measured
against the step vmapped over the tracks in benchmarks/README.md.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh
from jaxtyping import Array, Bool, Float, Int32
from numpy.typing import NDArray

from dcs_jax import tracker
from dcs_jax.config import Config
from dcs_jax.core.haar import draw_pool
from dcs_jax.core.window import ColumnSums, column_sums
from dcs_jax.runners.sequence import Frames
from dcs_jax.runners.sharding import Shares
from dcs_jax.types import Frame, ImageLike, Pool, State, StepInfo

CHUNK_FRAMES = 32
CHUNK_BYTES = 2**28  # fewer frames a chunk where they are very large
# So many frames' column sums are held at a time: they take 8 bytes a pixel.
_BLOCK = 4


class Records(NamedTuple):
    """What a program recorded: `Slots.rows` brings it to the host.

    infos: of each share, the records of its slots. frames: how many of a slot's count.
    """

    infos: list[StepInfo]
    frames: int


class Slots:
    """S places for tracks, each with a track or empty.

    One program starts tracks in any of them, another follows those in any of them through a chunk
    of frames: which ones, how many, and of how many frames compiles nothing, and a slot that is
    left out takes no time.

    size: S. grid: the cells of all objects. length: frames in a chunk, at most.
    shared: whether all tracks share one pool of features.
    shares: how the slots are dealt out to cores or devices, with the time spent.
    """

    def __init__(
        self,
        size: int,
        frame_shape: tuple[int, ...],
        keys: jax.Array,
        config: Config,
        mesh: Mesh | None = None,
        videos: bool = False,
        length: int | None = None,
    ) -> None:
        """Make empty slots.

        frame_shape: (H, W) or (H, W, 3).
        keys: [], one key, and all tracks share one pool, unless `config.block` differs between
            them; or [S], one for each.
        config: resolved; each of its numbers one for all, or an array [S].
        videos: whether each slot has frames of its own; by default all have the same.
        length: frames in a chunk; by default 32, fewer where frames are very large.
        """
        self.size = size
        self.grid = config.grid
        frame_bytes = math.prod(frame_shape) * (size if videos else 1)
        self.length = length or max(1, min(CHUNK_FRAMES, CHUNK_BYTES // frame_bytes))
        self.shared = keys.ndim == 0 and np.ndim(config.block) == 0
        self.shares = Shares(size, mesh)
        self._videos = videos
        each_config = _for_each(config, size)
        one_config = jax.tree.map(lambda numbers: numbers[0], each_config)
        state = _begin.eval_shape(
            jax.ShapeDtypeStruct(frame_shape, np.uint8),
            jax.ShapeDtypeStruct((4,), np.float32),
            jax.random.key(0),
            one_config,
        )
        self._pool: Pool | None = None
        self._keys: jax.Array | None = None
        if self.shared:
            self._pool = self.shares.to_all(_draw(keys, one_config))
            state = _stored(state, self._pool)
        else:
            self._keys = jnp.broadcast_to(keys, (size,))
        self._config = self.shares.deal(each_config)
        self._states = self.shares.deal(
            jax.tree.map(lambda leaf: np.zeros((size, *leaf.shape), leaf.dtype), state)
        )

    def start(
        self,
        frame: ImageLike,
        boxes: NDArray[np.float32],
        new: NDArray[np.bool_],
        keys: dict[int, jax.Array] | None = None,
    ) -> Records:
        """Start tracks in the new slots: their records of this frame.

        frame: [H, W] or [H, W, 3]; or of each slot, [S, H, W] or [S, H, W, 3].
        boxes: [S, 4]. new: [S]. keys: of a new slot, in place of the key it had.
        """
        for slot, key in (keys or {}).items():
            assert self._keys is not None
            self._keys = self._keys.at[slot].set(key)
        deal = self.shares.deal
        own, common = (frame, None) if self._videos else (None, self.shares.to_all(frame))
        given: tuple[list[Any], ...] = (
            self._config,
            deal(self._mask(new)),
            deal(own),
            deal(boxes),
            deal(self._keys),
        )
        each = [_Start(*parts) for parts in zip(*given, strict=True)]
        self._states, infos = self.shares.run(_start, self._states, each, (self._pool, common))
        return Records(infos, 1)

    def follow(self, frames: ImageLike, active: NDArray[np.bool_] | None = None) -> Records:
        """Follow the tracks through the next frames, a chunk or less: their records.

        frames: [n, H, W] or [n, H, W, 3]; or of each slot, [S, n, ...].
        active: [S], the slots with a track; by default all.
        """
        axis = 1 if self._videos else 0
        count = frames.shape[axis]
        frames = _filled(frames, self.length, axis)
        counts = np.full(self.size, count) if active is None else np.where(active, count, 0)
        deal = self.shares.deal
        own, common = (frames, None) if self._videos else (None, self.shares.to_all(frames))
        given: tuple[list[Any], ...] = (
            self._config,
            deal(self._mask(counts.astype(np.int32))),
            deal(own),
        )
        each = [_Follow(*parts) for parts in zip(*given, strict=True)]
        self._states, infos = self.shares.run(_follow, self._states, each, (self._pool, common))
        return Records(infos, count)

    def rows(self, records: Records) -> StepInfo:
        """Records [S, n, ...] of all slots as NumPy arrays.

        NaN (0 in what is no float) where a slot was left out.
        """
        infos = self.shares.collect(records.infos)
        return jax.tree.map(lambda leaf: leaf[:, : records.frames], infos)

    def _mask(self, counts: NDArray[np.generic]) -> NDArray[np.generic]:
        """0 for the slots added to make the shares equal."""
        return np.pad(counts, (0, self.shares.size - self.size))


class _Start(NamedTuple):
    """What `_start` is given for each slot: [S, ...] each, or None.

    frame: None where all have the same. key: None where all share a pool.
    """

    config: Config
    new: Bool[Array, " S"]
    frame: Any
    box: Float[Array, "S 4"]
    key: Any


class _Follow(NamedTuple):
    """What `_follow` is given for each slot: [S, ...] each.

    steps: frames to follow. frames: None where all have the same.
    """

    config: Config
    steps: Int32[Array, " S"]
    frames: Any


def _start(
    states: State, each: _Start, common: tuple[Pool | None, Frame | None]
) -> tuple[State, StepInfo]:
    """`init` and `score` of the new slots; the others keep their state. Records [S, 1, ...]."""
    pool, frame = common
    shared_sums = None if frame is None else column_sums(frame)

    def start(slot: tuple[State, _Start]) -> tuple[State, StepInfo]:
        old, (config, new, frame, box, key) = slot
        sums = column_sums(frame) if shared_sums is None else shared_sums
        features = key if pool is None else pool

        def begin() -> tuple[State, StepInfo]:
            state = tracker.init(sums, box, features, config)
            return _stored(state, pool), tracker.score(state, sums, config)

        blank = _blank(jax.eval_shape(begin)[1])
        state, info = jax.lax.cond(new, begin, lambda: (old, blank))
        return state, jax.tree.map(lambda leaf: leaf[None], info)

    return jax.lax.map(start, (states, each))


def _follow(
    states: State, each: _Follow, common: tuple[Pool | None, Frames | None]
) -> tuple[State, StepInfo]:
    """`step` of each slot through its number of frames. Records [S, T, ...], NaN after them."""
    pool, frames = common
    if frames is None:

        def through_own(slot: tuple[State, _Follow]) -> tuple[State, StepInfo]:
            state, (config, steps, frames) = slot
            length = len(frames)
            return _walk(state, pool, config, lambda t: column_sums(frames[t]), length, steps)

        return jax.lax.map(through_own, (states, each))

    block = math.gcd(len(frames), _BLOCK)

    def through_block(states: State, first: Int32[Array, ""]) -> tuple[State, StepInfo]:
        sums = jax.lax.map(column_sums, jax.lax.dynamic_slice_in_dim(frames, first, block))

        def through(slot: tuple[State, _Follow]) -> tuple[State, StepInfo]:
            state, (config, steps, _) = slot
            steps = jnp.clip(steps - first, 0, block)
            return _walk(state, pool, config, lambda t: _at(sums, t), block, steps)

        return jax.lax.map(through, (states, each))

    firsts = jnp.arange(0, len(frames), block, dtype=jnp.int32)
    states, infos = jax.lax.scan(through_block, states, firsts)  # [T / block, S, block, ...]

    def in_a_row(leaf: Array) -> Array:
        leaf = jnp.moveaxis(leaf, 0, 1)
        return leaf.reshape(len(leaf), len(frames), *leaf.shape[3:])

    return states, jax.tree.map(in_a_row, infos)


def _walk(
    state: State,
    pool: Pool | None,
    config: Config,
    sums_of: Callable[[Int32[Array, ""]], ColumnSums],
    length: int,
    steps: Int32[Array, ""],
) -> tuple[State, StepInfo]:
    """One track through the first `steps` of `length` frames; its records [length, ...]."""

    def step(t: Int32[Array, ""], state: State) -> tuple[State, StepInfo]:
        full = state if pool is None else state._replace(pool=pool)
        state, info = tracker.step(full, sums_of(t), config)
        return _stored(state, pool), info

    def advance(t: Int32[Array, ""], carry: tuple[State, StepInfo]) -> tuple[State, StepInfo]:
        state, infos = carry
        state, info = step(t, state)
        return state, jax.tree.map(lambda rows, row: rows.at[t].set(row), infos, info)

    info = jax.eval_shape(step, jnp.int32(0), state)[1]
    infos = jax.tree.map(lambda row: jnp.repeat(row[None], length, 0), _blank(info))
    return jax.lax.fori_loop(0, steps, advance, (state, infos))


def _stored(state: State, pool: Pool | None) -> State:
    """What is stored of a state: not the pool, if all tracks share one."""
    nothing: Any = None
    return state if pool is None else state._replace(pool=nothing)


def _blank(info: StepInfo) -> StepInfo:
    """The record of nothing."""

    def blank(leaf: jax.ShapeDtypeStruct) -> Array:
        return jnp.full(leaf.shape, jnp.nan if leaf.dtype.kind == "f" else 0, leaf.dtype)

    return jax.tree.map(blank, info)


def _at(tree: ColumnSums, t: Int32[Array, ""]) -> ColumnSums:
    return jax.tree.map(lambda leaf: leaf[t], tree)


def _filled(frames: ImageLike, length: int, axis: int) -> ImageLike:
    """Frames that nobody looks at added after the last: chunks of one length have one program."""
    missing = length - frames.shape[axis]
    if not missing:
        return frames
    widths = [(0, missing) if dim == axis else (0, 0) for dim in range(frames.ndim)]
    return np.pad(frames, widths) if isinstance(frames, np.ndarray) else jnp.pad(frames, widths)


def _for_each(config: Config, size: int) -> Config:
    """The settings with an array [S] for each number; ValueError where one has another shape."""

    def spread(name: str) -> NDArray[np.generic]:
        numbers = np.asarray(getattr(config, name), np.asarray(getattr(Config(), name)).dtype)
        if numbers.shape not in ((), (size,)):
            raise ValueError(
                f"config.{name} must be one number for all tracks or [{size}], one for each, "
                f"but has the shape {numbers.shape}"
            )
        kind = jax.dtypes.canonicalize_dtype(numbers.dtype)
        return np.broadcast_to(numbers.astype(kind), (size,))

    fields = (f.name for f in dataclasses.fields(config) if not f.metadata.get("static"))
    numbers: dict[str, Any] = {name: spread(name) for name in fields}
    return dataclasses.replace(config, **numbers)


# Compiled, and traced once for their shapes.
_draw = jax.jit(draw_pool)


@jax.jit
def _begin(frame: Frame, box: Float[Array, "4"], key: jax.Array, config: Config) -> State:
    return tracker.init(frame, box, key, config)
