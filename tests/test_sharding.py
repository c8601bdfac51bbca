"""The batch on several devices and in several processes: the boxes of one device."""

import os
import socket
import sys
from pathlib import Path

import jax
import numpy as np
import pytest
from settings import SMALL

import dcs_jax
from dcs_jax.runners import sharding
from dcs_jax.synthetic import render

# What a process of its own runs, as the number of devices is fixed when JAX starts. Its arguments:
# where to save, devices of a process, processes, number of this process, port of the first.
SCRIPT = """
import re, sys
import jax
out, devices, processes, number, port = sys.argv[1], *map(int, sys.argv[2:])
jax.config.update("jax_num_cpu_devices", devices)
if processes > 1:
    jax.distributed.initialize(f"127.0.0.1:{port}", processes, number)
import jax.numpy as jnp
import numpy as np
import dcs_jax
from dcs_jax.runners import sharding
from settings import SMALL
from test_sharding import BOXES, clip_frames

mesh = jax.make_mesh((devices * processes,), ("batch",))
one = dcs_jax.track_batch(clip_frames(), BOXES, config=SMALL, mesh=mesh)
keys = jax.vmap(jax.random.key)(jnp.arange(len(BOXES)))
videos = np.stack([clip_frames()] * len(BOXES))
many = dcs_jax.track_batch(videos, BOXES, keys, SMALL, mesh=mesh)
programs = [program.as_text() for program in sharding.programs().values()]
names = "all-reduce|all-gather|all-to-all|collective|reduce-scatter"
collectives = re.findall(names, "".join(programs))
np.savez(out, one=one.boxes, many=many.boxes, scores=one.noisy_or,
         programs=len(programs), collectives=np.array(collectives, dtype=str))
"""
BOXES = np.array([(20, 30, 30, 36), (40, 32, 24, 30), (60, 50, 36, 30)], np.float32)


def clip_frames():
    return render(12, (120, 160), (36, 30)).frames


def run(start, tmp_path, devices, processes):
    """The files that the processes have saved."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    tests = Path(__file__).parent
    path = os.pathsep.join(map(str, (tests, tests.parent)))
    environment = os.environ | {"PYTHONPATH": path, "JAX_PLATFORMS": "cpu"}
    paths = [tmp_path / f"{number}.npz" for number in range(processes)]
    running = [
        start(
            [sys.executable, "-c", SCRIPT, path, devices, processes, number, port],
            env=environment,
        )
        for number, path in enumerate(paths)
    ]
    failures = []
    for process in running:
        _, errors = process.communicate(timeout=300)
        failures.append(errors if process.returncode else "")
    assert not any(failures), "\n".join(failures)
    return [np.load(path) for path in paths]


@pytest.mark.parametrize(("devices", "processes"), [(2, 1), (4, 1), (1, 2)])
def test_a_sharded_batch_has_the_same_boxes(start, tmp_path, devices, processes):
    one = dcs_jax.track_batch(clip_frames(), BOXES, config=SMALL)
    singles = [
        dcs_jax.track_sequence(clip_frames(), box, jax.random.key(seed), SMALL).boxes
        for seed, box in enumerate(BOXES)
    ]
    for saved in run(start, tmp_path, devices, processes):
        np.testing.assert_array_equal(saved["one"], one.boxes)
        np.testing.assert_allclose(saved["scores"], one.noisy_or, atol=1e-6)
        np.testing.assert_array_equal(saved["many"], singles)
        assert saved["programs"] == 4
        assert not saved["collectives"].size  # no communication between the devices


def double(states, each, common):
    """The smallest of programs."""
    return states + common, 2 * each


def kept_after(lengths):
    """Number of programs that are kept after runs on arrays of these lengths."""
    slots = sharding.SlotSharding(1)
    for length in lengths:
        states, ones = (slots.shard(np.ones((1, length), np.float32)) for _ in range(2))
        states, results = slots.run(double, states, ones, slots.replicate(np.float32(3)))
        np.testing.assert_array_equal(states[0], np.full((1, length), 4))
        np.testing.assert_array_equal(results[0], np.full((1, length), 2))
    return len(sharding.programs().values())


def test_the_number_of_programs_that_are_kept_is_bounded():
    assert kept_after(range(1, 41)) == sharding.MOST_PROGRAMS == 32
    newest = sharding.programs().values()
    kept_after([20])
    assert sharding.programs().values()[-1] is newest[20 - 41]  # it was not compiled again


def test_they_go_with_the_caches_of_jax():
    kept_after([2, 3])
    client = jax.devices()[0].client
    before = len(client.live_executables())
    jax.clear_caches()
    assert not sharding.programs().values()
    assert len(client.live_executables()) < before
    assert kept_after([2]) == 1
