"""Re-detection: the search windows, and which candidate is taken."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from hypothesis import given
from hypothesis import strategies as st
from layout import reference_settings

from dcs_jax.config import Config, Redetection
from dcs_jax.core.window import place
from dcs_jax.extensions import redetection
from dcs_jax.types import Candidate, VerificationState

SHAPE = (240, 320)
CONFIG = Config()
BOX = jnp.array([100.0, 80.0, 40.0, 30.0])
REACHED = place(BOX, CONFIG).shown[2:] * (CONFIG.window_factor - 1)
LOOK = jax.tree_util.Partial(lambda box, angle: box)
RESTS = jax.tree_util.Partial(lambda candidate: jnp.array(False))


def candidate(box: jax.Array, confidence: jax.Array) -> Candidate:
    return Candidate(box, confidence, confidence, jnp.ones(9))


def missed(frames: int, verified: jax.Array = BOX) -> VerificationState:
    """That of an object that was verified there so many frames ago."""
    nothing = jnp.zeros(20)
    return VerificationState(nothing, nothing, nothing, verified, jnp.int32(frames), jnp.int32(0))


def search(
    localise: jax.tree_util.Partial,
    rests: jax.tree_util.Partial,
    known: VerificationState,
    config: Config,
) -> tuple[Candidate, Any]:
    return redetection.search(LOOK, localise, rests, BOX, BOX[2:], None, known, SHAPE, config)


def test_the_search_windows_cover_the_frame():
    boxes = np.array(
        [redetection.search_window(BOX, jnp.int32(number), SHAPE, REACHED) for number in range(100)]
    )
    np.testing.assert_allclose(boxes[:, 2:], np.tile(BOX[2:], (100, 1)))
    distinct = np.unique(boxes, axis=0)
    # The canvas shows 37.2 x 32.2: 320 / (1.5 * 37.2) and 240 / (1.5 * 32.2), rounded up.
    assert len(distinct) == 6 * 5
    centres = boxes[:, :2] + boxes[:, 2:] / 2
    for point in np.random.default_rng(0).uniform(0, (320, 240), (50, 2)):
        assert (np.abs(centres - point) <= np.asarray(REACHED) / 2 + 1e-3).all(1).any()


@given(
    box=st.tuples(*[st.integers(0, 200)] * 2, *[st.integers(9, 90)] * 2),
    num_missed=st.integers(1, 50),
    windows=st.integers(1, 4),
)
def test_the_search_windows_of_a_frame_are_those_of_the_reference(box, num_missed, windows):
    box = np.float32(box)
    config = dataclasses.replace(CONFIG, redetection=Redetection(windows=windows))
    settings = reference_settings(config)
    reached = place(jnp.asarray(box), config).shown[2:] * (config.window_factor - 1)
    expected = reference.redetection.search_windows(box, num_missed, SHAPE, settings)
    numbers = windows * num_missed + np.arange(windows)
    found = [
        redetection.search_window(jnp.asarray(box), jnp.int32(number), SHAPE, reached)
        for number in numbers
    ]
    np.testing.assert_allclose(found, expected, atol=1e-3)


@pytest.mark.parametrize(
    ("num_missed", "here", "there", "taken"),
    [
        (0, 0.1, 0.99, False),  # held: nothing else is searched
        (1, 0.1, 0.99, True),
        (3, 0.1, 0.85, False),  # not above accept_above
        (3, 0.95, 0.93, False),  # not better than what is there
        (3, 0.95, 0.96, True),
    ],
)
def test_a_better_candidate_is_taken_where_the_object_was_missed(num_missed, here, there, taken):
    def best(confidences: jax.Array, box: jax.Array, seen: jax.Array, _: jax.Array) -> Candidate:
        return candidate(box, jnp.where((seen == BOX).all(), *confidences))

    localise = jax.tree_util.Partial(best, jnp.array([here, there]))
    found, seen = search(localise, RESTS, missed(num_missed), CONFIG)
    # What is seen is that around the candidate, to learn from.
    np.testing.assert_array_equal(seen, found.box)
    assert bool((found.box != BOX).any()) == taken
    assert found.confidence == pytest.approx(there if taken else here)


@pytest.mark.parametrize("num_missed", [0, 3])
def test_what_is_not_learned_from_is_not_looked_at(num_missed):
    def best(box: jax.Array, *_: jax.Array) -> Candidate:
        return candidate(box + 1, jnp.where((box == BOX).all(), 0.95, 0.1))

    sure = jax.tree_util.Partial(lambda candidate: candidate.confidence > 0.9)
    localise = jax.tree_util.Partial(best)
    found, seen = search(localise, sure, missed(num_missed), CONFIG)
    np.testing.assert_array_equal(found.box, BOX + 1)
    assert (seen != found.box).any()


def test_the_windows_of_a_frame_follow_those_of_the_last():
    def here_only(target: jax.Array, box: jax.Array, *_: jax.Array) -> Candidate:
        return candidate(box, jnp.where(jnp.abs(box - target).max() < 1, 0.95, 0.1))

    config = Config(redetection=Redetection(windows=2))
    target = redetection.search_window(BOX, jnp.int32(7), SHAPE, REACHED)
    localise = jax.tree_util.Partial(here_only, target)
    found = [search(localise, RESTS, missed(frames), config)[0] for frames in range(1, 6)]
    assert [there.confidence > 0.9 for there in found] == [False, False, True, False, False]


@pytest.mark.parametrize("settings", [Redetection(), None])
@pytest.mark.parametrize(
    ("num_missed", "here", "there", "taken"),
    [
        (0, 0.1, 0.99, False),
        (1, 0.1, 0.69, False),  # not sure
        (1, 0.1, 0.71, True),
        (9, 0.1, 0.71, True),
        (9, 0.8, 0.75, False),  # not better than what is followed
    ],
)
def test_what_is_sure_where_it_was_verified_last_is_taken(num_missed, here, there, taken, settings):
    def best(confidences: jax.Array, box: jax.Array, *_: jax.Array) -> Candidate:
        return candidate(box, jnp.select([box[0] == BOX[0], box[0] == verified[0]], confidences, 0))

    verified = BOX + jnp.array([91.0, -41.0, 3.0, 2.0])
    localise = jax.tree_util.Partial(best, list(jnp.array([here, there])))
    config = Config(redetection=settings)
    known = missed(num_missed, verified)
    found, seen = search(localise, RESTS, known, config)
    np.testing.assert_array_equal(found.box, verified if taken else BOX)
    np.testing.assert_array_equal(seen, found.box)


@pytest.mark.parametrize(
    ("num_missed", "here", "by_first", "taken"),
    [
        (0, 0.4, 0.71, True),
        (0, 0.4, 0.69, False),  # not sure
        (0, 0.51, 0.99, False),  # recognised: not looked for again
        (2, 0.51, 0.99, True),  # missed before
    ],
)
def test_what_is_not_recognised_is_looked_for_by_the_first_frame(num_missed, here, by_first, taken):
    def best(confidences: jax.Array, box: jax.Array, _: jax.Array, first: jax.Array) -> Candidate:
        moved = box + jnp.where(first, 5, 0)
        return candidate(moved, jnp.where((box == BOX).all(), confidences[first.astype(int)], 0))

    localise = jax.tree_util.Partial(best, jnp.array([here, by_first]))
    elsewhere = missed(num_missed, BOX + 50)
    found, seen = search(localise, RESTS, elsewhere, CONFIG)
    np.testing.assert_array_equal(found.box, BOX + 5 if taken else BOX)
    np.testing.assert_array_equal(seen, found.box)


def test_without_a_filter_there_is_no_other_look_by_the_first_frame():
    def best(box: jax.Array, _: jax.Array, first: jax.Array) -> Candidate:
        return candidate(box, jnp.where(first, 0.99, 0.1))

    config = Config(translation=None)
    localise = jax.tree_util.Partial(best)
    found, _ = search(localise, RESTS, missed(0), config)
    assert found.confidence == pytest.approx(0.1)
