"""A fixed number of slots, each with a track or empty: what batches and streams run on."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh
from jaxtyping import Array, Float
from numpy.typing import NDArray

from dcs_jax import tracker
from dcs_jax.config import Config, number_type
from dcs_jax.core.haar import draw_pool
from dcs_jax.runners.programs import (
    InitArguments,
    ScanArguments,
    init_slots,
    scan_slots,
    without_pool,
)
from dcs_jax.runners.sharding import SlotSharding
from dcs_jax.types import Frame, ImageLike, Pool, State, StepInfo

CHUNK_FRAMES = 32
# Fewer frames a chunk where they are large. Memory of more than 32 MiB goes back to the system and
# comes as new pages: 75 frames of 1920x1080 took 2.6 times as long in chunks of 199 MB as in 31 MB.
CHUNK_BYTES = 2**25


class Records(NamedTuple):
    """What a program recorded: `Slots.rows` brings it to the host.

    infos: of each shard, the records of its slots. frames: how many of a slot's count.
    """

    infos: list[StepInfo]
    frames: int


class Slots:
    """S slots, each with a track or empty.

    One program starts tracks in any of them, another steps those in any of them through a chunk of
    frames: which ones, how many, and of how many frames compiles nothing, and a slot that is
    left out takes no time.

    size: S. grid: the cells of all objects. length: frames in a chunk, at most.
    shared: whether all tracks share one pool of features.
    sharding: of the slots over cores or devices, with the time spent.
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
        states: Sequence[State] = (),
    ) -> None:
        """Make slots, the first of them with tracks that go on from these states, the rest empty.

        frame_shape: (H, W) or (H, W, 3).
        keys: [], one key, and all tracks share one pool, unless `config.block` differs between
            them; or [S], one for each.
        config: resolved; each of its numbers one for all, or an array [S].
        videos: whether each slot has frames of its own; by default all have the same.
        length: frames in a chunk; by default 32, fewer where they have more than 32 MiB.
        states: with their pools, which are one and the same where all tracks share one.

        Raises ValueError where a state is not one of these settings.
        """
        self.size = size
        self.grid = config.grid
        frame_bytes = math.prod(frame_shape) * (size if videos else 1)
        self.length = length or max(1, min(CHUNK_FRAMES, CHUNK_BYTES // frame_bytes))
        self.shared = keys.ndim == 0 and np.ndim(config.block) == 0
        self.sharding = SlotSharding(size, mesh)
        self._videos = videos
        each_config = _spread(config, size)
        one_config = jax.tree.map(lambda numbers: numbers[0], each_config)
        state = _init.eval_shape(
            jax.ShapeDtypeStruct(frame_shape, np.uint8),
            jax.ShapeDtypeStruct((4,), np.float32),
            jax.random.key(0),
            one_config,
        )
        for number, given in enumerate(states):
            _check_state(number, given, state)
        self._pool: Pool | None = None
        self._keys: jax.Array | None = None
        if self.shared:
            pool = states[0].pool if states else draw(keys, one_config)
            self._pool = self.sharding.replicate(pool)
            state = without_pool(state, self._pool)
        else:
            self._keys = jnp.broadcast_to(keys, (size,))
        self._config = self.sharding.shard(each_config)
        empty = jax.tree.map(lambda leaf: np.zeros((size, *leaf.shape), leaf.dtype), state)
        for slot, given in enumerate(states):
            jax.tree.map(
                lambda rows, leaf, slot=slot: rows.__setitem__(slot, np.asarray(leaf)),
                empty,
                without_pool(given, self._pool),
            )
        self._states = self.sharding.shard(empty)

    def init(
        self,
        frame: ImageLike,
        boxes: NDArray[np.float32],
        new: NDArray[np.bool_],
        keys: dict[int, jax.Array] | None = None,
    ) -> Records:
        """Start tracks in the new slots: their records of this frame.

        frame: [H, W] or [H, W, 3]; or of each slot, [S, H, W] or [S, H, W, 3].
        boxes: [S, 4]. new: [S]. keys: of new slots, instead of the keys they had.
        """
        for slot, key in (keys or {}).items():
            assert self._keys is not None
            self._keys = self._keys.at[slot].set(key)
        shard = self.sharding.shard
        own, common = (frame, None) if self._videos else (None, self.sharding.replicate(frame))
        arguments: tuple[list[Any], ...] = (
            self._config,
            shard(self._mask(new)),
            shard(own),
            shard(boxes),
            shard(self._keys),
        )
        each = [InitArguments(*parts) for parts in zip(*arguments, strict=True)]
        self._states, infos = self.sharding.run(
            init_slots, self._states, each, (self._pool, common)
        )
        return Records(infos, 1)

    def scan(self, frames: ImageLike, active: NDArray[np.bool_] | None = None) -> Records:
        """Step the tracks through the next frames, a chunk or less: their records.

        frames: [n, H, W] or [n, H, W, 3]; or of each slot, [S, n, ...].
        active: [S], the slots with a track; by default all.
        """
        axis = 1 if self._videos else 0
        count = frames.shape[axis]
        frames = _filled(frames, self.length, axis)
        counts = np.full(self.size, count) if active is None else np.where(active, count, 0)
        shard = self.sharding.shard
        own, common = (frames, None) if self._videos else (None, self.sharding.replicate(frames))
        arguments: tuple[list[Any], ...] = (
            self._config,
            shard(self._mask(counts.astype(np.int32))),
            shard(own),
        )
        each = [ScanArguments(*parts) for parts in zip(*arguments, strict=True)]
        self._states, infos = self.sharding.run(
            scan_slots, self._states, each, (self._pool, common)
        )
        return Records(infos, count)

    def state(self, slot: int) -> State:
        """The state of one slot, with its pool."""
        state: State = self.sharding.gather_one(self._states, slot)
        return state if self._pool is None else state._replace(pool=self._pool)

    def rows(self, records: Records) -> StepInfo:
        """Records [S, n, ...] of all slots as NumPy arrays.

        NaN (0 in what is not a float) where a slot was left out.
        """
        infos = self.sharding.gather(records.infos)
        return jax.tree.map(lambda leaf: leaf[:, : records.frames], infos)

    def _mask(self, counts: NDArray[np.generic]) -> NDArray[np.generic]:
        """0 for the slots added to make the shards equal."""
        return np.pad(counts, (0, self.sharding.size - self.size))


def _check_state(number: int, given: State, expected: State) -> None:
    """ValueError unless it is a state of these settings; expected: its shapes."""
    shapes = jax.tree.map(lambda leaf: (leaf.shape, leaf.dtype), given)
    wanted = jax.tree.map(lambda leaf: (leaf.shape, leaf.dtype), expected)
    if shapes != wanted:
        raise ValueError(
            f"states[{number}] is not a state of these settings: expected the config that it was "
            "made with"
        )


def _filled(frames: ImageLike, length: int, axis: int) -> ImageLike:
    """The frames and blank ones after the last: chunks of one length have one program."""
    lacking = length - frames.shape[axis]
    if not lacking:
        return frames
    widths = [(0, lacking) if dim == axis else (0, 0) for dim in range(frames.ndim)]
    return np.pad(frames, widths) if isinstance(frames, np.ndarray) else jnp.pad(frames, widths)


def _spread(config: Config, size: int) -> Config:
    """The settings with an array [S] for each number; ValueError where one has another shape."""

    def spread(path: tuple[Any, ...], number: Any) -> NDArray[np.generic]:
        numbers = np.asarray(number, number_type(path))
        if numbers.shape not in ((), (size,)):
            name = jax.tree_util.keystr(path, simple=True, separator=".")
            raise ValueError(
                f"config.{name} must be one number for all tracks or [{size}], one for each, "
                f"but has the shape {numbers.shape}"
            )
        return np.broadcast_to(numbers, (size,))

    return jax.tree_util.tree_map_with_path(spread, config)


# Compiled, and traced once for their shapes.
draw = jax.jit(draw_pool)


@jax.jit
def _init(frame: Frame, box: Float[Array, "4"], key: jax.Array, config: Config) -> State:
    return tracker.init(frame, box, key, config)
