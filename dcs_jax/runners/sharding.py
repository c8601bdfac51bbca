"""Slots sharded over the cores of a CPU or the devices of a mesh, which run one program each.

XLA runs a program of small loops on one core of a CPU, also where halves of it are independent:
there each shard of the slots has a thread of its own. On a mesh JAX shards.

Compiled programs are kept in memory, the 32 used last; `jax.clear_caches()` lets go of all.
"""

import functools
import os
import threading
import weakref
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from time import perf_counter
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental import multihost_utils
from jax.sharding import Mesh, NamedSharding, PartitionSpec

Tree = TypeVar("Tree")
# Of the states [S, ...], what else there is for each slot [S, ...], and what there is for all: the
# new states, which take the memory of the old, and results [S, ...].
Program = Callable[[Any, Any, Any], tuple[Any, Any]]

AXIS = "batch"  # of the mesh

# One thread for the products of a step, where the cores are busy with a shard of the slots each.
_ONE_THREAD: dict[str, Any] = {"xla_cpu_multi_thread_eigen": False}


class SlotSharding:
    """The sharding of S slots.

    size: S and what is added to it, so that all shards have one size and with it one program.
    seconds: spent in programs so far, without their compilation.
    """

    def __init__(self, slots: int, mesh: Mesh | None = None) -> None:
        """Shards for the devices along the axis "batch" of a mesh, or for the cores of a CPU."""
        if mesh is not None and AXIS not in mesh.axis_names:
            raise ValueError(
                f'mesh must have an axis "{AXIS}", as jax.make_mesh((n,), ("{AXIS}",)) has, '
                f"but has {mesh.axis_names}"
            )
        self._mesh = mesh
        available = cores() if jax.default_backend() == "cpu" else 1
        self._parts = min(available, slots) if mesh is None else mesh.shape[AXIS]
        self._slots = slots
        self.size = slots + -slots % self._parts
        self.seconds = 0.0

    def shard(self, each: Tree) -> list[Tree]:
        """The shards of arrays [S, ...], those of the added slots like the last one."""
        filled = jax.tree.map(self._fill, each)
        if self._mesh is not None:
            put = functools.partial(_put, NamedSharding(self._mesh, PartitionSpec(AXIS)))
            return [jax.tree.map(put, filled)]
        length = self.size // self._parts

        def part(number: int) -> Tree:
            rows = slice(number * length, (number + 1) * length)
            return jax.tree.map(lambda leaf: jnp.asarray(leaf[rows]), filled)

        return [part(number) for number in range(self._parts)]

    def replicate(self, common: Tree) -> Tree:
        """Arrays that every shard gets whole. They may share the memory of what is given."""
        if self._mesh is None:
            # A quarter of the time of `jnp.asarray`, and none where an array is aligned.
            return jax.tree.map(jax.device_put, common)
        put = functools.partial(_put, NamedSharding(self._mesh, PartitionSpec()))
        return jax.tree.map(put, common)

    def run(
        self, program: Program, states: list[Any], each: list[Any], common: Any
    ) -> tuple[list[Any], list[Any]]:
        """Run a program on all shards at once: their new states and their results."""
        calls = [(state, one, common) for state, one in zip(states, each, strict=True)]
        # One after the other: the shards have the same program.
        options = {} if self._parts == 1 else _ONE_THREAD
        compiled = [_compiled(program, self._mesh, call, options) for call in calls]
        start = perf_counter()
        if len(calls) == 1:
            done = [compiled[0](*calls[0])]
            jax.block_until_ready(done)
        else:
            done = list(_threads().map(_run, compiled, calls))
        self.seconds += perf_counter() - start
        return [state for state, _ in done], [result for _, result in done]

    def gather(self, results: list[Tree]) -> Tree:
        """The results of all shards on the host: NumPy arrays [S, ...], in every process."""

        def whole(*leaves: Any) -> Any:
            if not leaves[0].is_fully_addressable:
                return multihost_utils.process_allgather(leaves[0], tiled=True)[: self._slots]
            return np.concatenate([np.asarray(leaf) for leaf in leaves])[: self._slots]

        return jax.tree.map(whole, *results)

    def gather_one(self, results: list[Tree], slot: int) -> Tree:
        """What `gather` has for one slot, without the others where they are in this process."""
        if self._mesh is not None:
            return jax.tree.map(lambda leaf: leaf[slot], self.gather(results))
        shard, place = divmod(slot, self.size // self._parts)
        return jax.tree.map(lambda leaf: np.array(np.asarray(leaf)[place]), results[shard])

    def _fill(self, leaf: Any) -> Any:
        if len(leaf) == self.size:
            return leaf
        return leaf[np.minimum(np.arange(self.size), len(leaf) - 1)]


def _put(sharding: NamedSharding, leaf: Any) -> jax.Array:
    """The same array, known to this process, on the devices of all processes."""
    if sharding.is_fully_addressable:
        return jax.device_put(leaf, sharding)
    if isinstance(leaf, jax.Array) and jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key):
        data = _put(sharding, jax.random.key_data(leaf))
        return jax.random.wrap_key_data(data, impl=jax.random.key_impl(leaf))
    # Unlike `device_put`, this does not have the processes compare what they have.
    values = np.asarray(leaf)
    return jax.make_array_from_callback(values.shape, sharding, lambda index: values[index])


def _run(program: Any, arguments: tuple[Any, ...]) -> Any:
    return jax.block_until_ready(program(*arguments))


@functools.cache
def _threads() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(cores(), "dcs_jax")


def cores() -> int:
    """The cores this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1


# Of each shape of a frame and of the settings, number of slots and of frames there are two.
MOST_PROGRAMS = 32


class Programs:
    """Compiled programs by what they depend on, the last used at the end, at most 32."""

    def __init__(self) -> None:
        self._kept: dict[Any, Any] = {}
        self._lock = threading.Lock()  # tracks may run in several threads

    def get(self, key: Any, compile_program: Callable[[], Any]) -> Any:
        """The program of a key, compiled where there is none."""
        with self._lock:
            found = self._kept.pop(key, None)
        if found is None:
            found = compile_program()
        with self._lock:
            self._kept[key] = found
            while len(self._kept) > MOST_PROGRAMS:
                del self._kept[next(iter(self._kept))]
        return found

    def values(self) -> list[Any]:
        """The programs that are kept."""
        with self._lock:
            return list(self._kept.values())


_present: list["weakref.ref[Programs]"] = []


def programs() -> Programs:
    """The programs of this process.

    JAX's caches own them, so that `jax.clear_caches()` frees their memory as it does that of all
    other programs: they hold the static argument of `_own`, and here is but a weak reference.
    """
    present = _present[0]() if _present else None
    if present is None:
        present = Programs()
        _own(present)
        _present[:] = [weakref.ref(present)]
    return present


@functools.partial(jax.jit, static_argnums=0)
def _own(owned: Programs) -> int:
    return 0


def _compiled(
    program: Program, mesh: Mesh | None, arguments: tuple[Any, ...], options: dict[str, Any]
) -> Any:
    """The program for arguments of these shapes, compiled once, in no thread and not on the clock.

    It holds no communication between the devices: each maps over the slots it has.
    """
    leaves, structure = jax.tree.flatten(arguments)
    key = (program, mesh, tuple(options), structure, *map(_kind, leaves))

    def compile_program() -> Any:
        function = program
        if mesh is not None:
            each, common = PartitionSpec(AXIS), PartitionSpec()
            function = jax.shard_map(
                program,
                mesh=mesh,
                in_specs=(each, each, common),
                out_specs=each,
                check_vma=False,
            )
        jitted = jax.jit(function, donate_argnums=0, compiler_options=options)
        return jitted.lower(*arguments).compile()

    return programs().get(key, compile_program)


def _kind(leaf: jax.Array) -> tuple[Any, ...]:
    """What a program depends on of an argument."""
    return leaf.shape, leaf.dtype, getattr(leaf, "weak_type", False), leaf.sharding
