"""JAX's own settings, which a program around the tracker may need, change no box."""

import os
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest
from settings import SMALL_DEFAULT

from dcs_jax.config import number_type, single_precision

# What a process of its own runs, as JAX reads the settings when it starts. It saves the boxes of
# every entry point to its argument.
SCRIPT = """
import dataclasses, sys
import jax
import numpy as np
import dcs_jax
from dcs_jax.synthetic import render
from settings import SMALL, SMALL_DEFAULT

clip = render(5, (60, 80), (24, 20))
key = jax.random.key(1)
rules = {"weak": "gaussian"}, {"selector": "mil"}, {"selector": "error"}, {"tie": "error"}
for changes in rules:
    for base in (SMALL, SMALL_DEFAULT):
        config = dataclasses.replace(base, **changes)
        state = jax.eval_shape(dcs_jax.init, clip.frames[0], clip.boxes[0], key, config)
        jax.eval_shape(dcs_jax.step, state, clip.frames[1], config)

config, box = SMALL_DEFAULT, clip.boxes[0]
state = dcs_jax.init(clip.frames[0], tuple(box.tolist()), key, config)
first = dcs_jax.score(state, clip.frames[0], config)
after, second = dcs_jax.step(state, clip.frames[1], config)
_, rest = dcs_jax.track_chunk(after, clip.frames[2:], config)
sequence = dcs_jax.track_sequence(clip.frames, box, key, config)
batch = dcs_jax.track_batch(clip.frames, box[None], key, config)
chunks = [chunk.track for chunk in dcs_jax.track_stream(clip.frames, box[None], key, config)]
results = {
    "single": np.concatenate([first.box[None], second.box[None], rest.box]),
    "sequence": sequence.boxes,
    "batch": batch.boxes[0],
    "stream": np.concatenate([chunk.boxes[0] for chunk in chunks]),
}
for leaf in jax.tree.leaves((state, first, after, second, rest, sequence, batch, chunks)):
    assert leaf.dtype.name not in ("float64", "int64"), leaf.dtype

generator = np.random.default_rng(0)
votes = generator.choice([-1.0, 1.0], (3, 12, 9)).astype(np.float32)
labels = generator.choice([-1.0, 1.0], (3, 12)).astype(np.float32)
for solver in ("interior", "apg", "projected_gradient"):
    found = dcs_jax.select_classifiers(votes, labels, 0.5, solver=solver)
    assert found.beta.dtype == np.float32
    results[solver] = found.index
np.savez(sys.argv[1], **results)
"""
SETTINGS = [
    {},
    {"JAX_ENABLE_X64": "1"},
    {"JAX_ENABLE_X64": "1", "JAX_NUMPY_DTYPE_PROMOTION": "strict"},
    {"JAX_NUMPY_RANK_PROMOTION": "raise", "JAX_NUMPY_DTYPE_PROMOTION": "strict"},
]


def run(settings, path):
    """What the script saves in a process with these settings."""
    tests = Path(__file__).parent
    kept = {name: value for name, value in os.environ.items() if "PROMOTION" not in name}
    paths = {"PYTHONPATH": os.pathsep.join(map(str, (tests, tests.parent)))}
    command = [sys.executable, "-c", SCRIPT, str(path)]
    done = subprocess.run(
        command, env=kept | paths | settings, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stderr
    return np.load(path)


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    return run({}, tmp_path_factory.mktemp("boxes") / "plain.npz")


@pytest.mark.parametrize("settings", SETTINGS[1:], ids=lambda settings: " ".join(settings))
def test_settings_of_jax_change_no_box(expected, tmp_path, settings):
    found = run(settings, tmp_path / "found.npz")
    for name in expected:
        # The size of a box is a sum, which every compiled program rounds in its own way.
        np.testing.assert_allclose(found[name], expected[name], atol=1e-3)


def test_numbers_of_the_settings_are_float32_or_int32():
    with jax.enable_x64(True):
        config = single_precision(jax.tree.map(np.float64, SMALL_DEFAULT))
        traced = jax.eval_shape(single_precision, SMALL_DEFAULT)
    for found in (config, traced):
        for path, leaf in jax.tree_util.tree_leaves_with_path(found):
            assert leaf.dtype == number_type(path)
            assert leaf.dtype in (np.float32, np.int32)
    assert config.verification is not None
    assert np.asarray(config.verification.patience).dtype == np.int32
