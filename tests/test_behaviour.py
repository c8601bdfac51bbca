"""Size, absence and parts of a pixel on clips with exact ground truth.

A few scenes of each kind; `python -m benchmarks.behaviour` runs ten.
"""

import operator

import jax
import numpy as np
import pytest

from benchmarks.behaviour import PLAIN, WITHIN, absences, centre_errors, overlaps, track_clips
from dcs_jax import Config, Verification
from dcs_jax.synthetic import render
from dcs_jax.tracker import init, step

KINDS = {
    "grows": {"zoom": (0.5, 2.0), "speed": 3},
    "shrinks": {"zoom": (2.0, 0.5), "speed": 3},
    "covered": {"covered": 40},
    "away": {"away": 40},
    "slow": {"speed": 0.7, "noise": 0.0},
}
SEEDS = range(4)


@pytest.fixture(scope="module")
def followed():
    """Clips of every kind and their tracks, in one call."""
    made = {
        kind: [render(170, (150, 200), (40, 32), seed=seed, **(PLAIN | options)) for seed in SEEDS]
        for kind, options in KINDS.items()
    }
    tracks = track_clips([clip for clips in made.values() for clip in clips], Config())
    parts = [slice(len(SEEDS) * n, len(SEEDS) * (n + 1)) for n in range(len(KINDS))]
    return {
        kind: (clips, jax.tree.map(operator.itemgetter(part), tracks))
        for part, (kind, clips) in zip(parts, made.items(), strict=True)
    }


@pytest.mark.parametrize("kind", ["grows", "shrinks"])
def test_the_box_follows_the_size(followed, kind):
    clips, track = followed[kind]
    assert overlaps(clips, track).min() > 0.7
    assert not track.lost.any()


@pytest.mark.parametrize("kind", ["covered", "away"])
def test_lost_while_absent_and_found_again(followed, kind):
    seen = absences(*followed[kind])
    assert [one.lost_before for one in seen] == [0] * len(SEEDS)
    assert np.mean([one.lost for one in seen]) > 0.6
    soon = [one.after is not None and one.after <= WITHIN for one in seen]
    assert sum(soon) >= 3


def test_parts_of_a_pixel(followed):
    assert centre_errors(*followed["slow"]).mean() < 0.3


def test_nothing_is_learned_while_lost():
    clip = render(12, (120, 160), (36, 30), **PLAIN)
    config, patience = Config(), Verification().patience
    state = jax.jit(init)(clip.frames[0], clip.boxes[0], jax.random.key(0), config)
    follow_on = jax.jit(step)
    for frame in clip.frames[1:]:
        state, info = follow_on(state, frame, config)
    assert not info.lost
    blank = np.full_like(clip.frames[0], 128)
    before = state
    for _ in range(int(patience) + 3):
        state, info = follow_on(state, blank, config)
    assert info.lost
    counts = ("num_missed", "num_rested")
    same = {name: getattr(before.verification, name) for name in counts}
    kept = state._replace(verification=state.verification._replace(**same))
    for now, then in zip(jax.tree.leaves(kept), jax.tree.leaves(before), strict=True):
        np.testing.assert_array_equal(now, then)
