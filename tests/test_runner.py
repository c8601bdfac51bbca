"""Seeds in one call give the tracks that each gives alone."""

import jax
import numpy as np
import pytest
from settings import SMALL

import dcs_jax
from dcs_jax.evaluation.runner import run_seeds
from dcs_jax.runners import slots
from dcs_jax.synthetic import render


@pytest.fixture(scope="module")
def clip():
    return render(21, (120, 160), (36, 30))


@pytest.mark.parametrize("chunk", [32, 6])
def test_seeds_are_those_of_track_sequence(clip, monkeypatch, chunk):
    monkeypatch.setattr(slots, "CHUNK_FRAMES", chunk)
    counted: list[int] = []
    box = clip.boxes[0].astype(float)
    runs = run_seeds(iter(clip.frames), box, [0, 1, 5], SMALL, counted.append)
    assert runs.boxes.shape == (3, 21, 4)
    assert runs.confidence.shape == (3, 21)
    assert sum(counted) == 3 * 21
    assert runs.seconds > 0
    for seed, boxes, confidence in zip((0, 1, 5), runs.boxes, runs.confidence, strict=True):
        track = dcs_jax.track_sequence(clip.frames, box, jax.random.key(seed), SMALL)
        np.testing.assert_array_equal(boxes, track.boxes)
        np.testing.assert_allclose(confidence, track.confidence, atol=1e-6)


def test_the_native_grid_and_one_frame(clip):
    config = dcs_jax.Config.paper(selectors=2, pool_size=4, window_minimum=0.0)
    runs = run_seeds(clip.frames[:1], clip.boxes[0].astype(float), [3], config)
    np.testing.assert_array_equal(runs.boxes, clip.boxes[None, :1])
