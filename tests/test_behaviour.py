"""Size, absence and parts of a pixel on clips with exact ground truth.

A few scenes of each kind; `python -m benchmarks.behaviour` runs ten.
"""

import jax
import numpy as np
import pytest

from benchmarks.behaviour import PLAIN, WITHIN, absences, centre_errors, follow, overlaps
from dcs_jax import Config
from dcs_jax.synthetic import render
from dcs_jax.tracker import init, step


def clips(seeds, **options):
    return [render(seed=seed, **PLAIN, **options) for seed in seeds]


@pytest.mark.parametrize("zoom", [(0.5, 2.0), (2.0, 0.5)])
def test_the_box_follows_the_size(zoom):
    zooming = clips(range(2), length=200, size=(150, 200), target=(40, 32), speed=3, zoom=zoom)
    track = follow(zooming, Config())
    assert overlaps(zooming, track).min() > 0.7
    assert not track.lost.any()


def test_without_scale_the_box_keeps_its_size():
    zooming = clips([0], length=30, size=(150, 200), target=(40, 32), zoom=(1.0, 1.5))
    track = follow(zooming, Config(scale=False))
    given = np.broadcast_to(zooming[0].boxes[0, 2:], (1, 30, 2))
    np.testing.assert_array_equal(track.boxes[..., 2:], given)


@pytest.mark.parametrize("option", ["covered", "away"])
def test_lost_while_absent_and_found_again(option):
    hiding = clips(range(4), length=170, **{option: 40})
    seen = absences(hiding, follow(hiding, Config()))
    assert [one.lost_before for one in seen] == [0] * 4
    assert np.mean([one.lost for one in seen]) > 0.6
    soon = [one.after is not None and one.after <= WITHIN for one in seen]
    assert sum(soon) >= 3


def test_nothing_is_learned_while_lost():
    clip = render(12, (120, 160), (36, 30), **PLAIN)
    config = Config()
    state = jax.jit(init)(clip.frames[0], clip.boxes[0], jax.random.key(0), config)
    follow_on = jax.jit(step)
    for frame in clip.frames[1:]:
        state, info = follow_on(state, frame, config)
    assert not info.lost
    blank = np.full_like(clip.frames[0], 128)
    before = state
    for _ in range(int(config.patience) + 3):
        state, info = follow_on(state, blank, config)
    assert info.lost
    kept = state._replace(extras=state.extras._replace(missing=before.extras.missing))
    for now, then in zip(jax.tree.leaves(kept), jax.tree.leaves(before), strict=True):
        np.testing.assert_array_equal(now, then)


def test_parts_of_a_pixel():
    moving = clips(range(10), length=60, size=(150, 200), speed=0.7, noise=0.0)
    assert centre_errors(moving, follow(moving, Config())).mean() < 0.3
