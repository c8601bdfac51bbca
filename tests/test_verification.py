"""Verification: similarity, confidence, and what counts as missed and lost."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
import reference
from hypothesis import given
from hypothesis import strategies as st
from reference import verification as expected

from dcs_jax.config import Verification
from dcs_jax.extensions import verification
from dcs_jax.types import VerificationState

SETTINGS = Verification()


@given(seed=st.integers(0, 2**31))
def test_similarity_and_confidence_are_those_of_the_reference(seed):
    generator = np.random.default_rng(seed)
    first, recent, now = generator.normal(size=(3, 20)).astype(np.float32)
    first, now = (vector / np.linalg.norm(vector) for vector in (first, now))
    state = VerificationState(jnp.asarray(first), jnp.asarray(recent), jnp.int32(0))
    alike = verification.similarity(state, jnp.asarray(now), SETTINGS)
    settings = reference.Verification(**dataclasses.asdict(SETTINGS))
    wanted = expected.similarity(expected.VerificationState(first, recent, 0), now, settings)
    assert alike == pytest.approx(wanted, abs=1e-5)
    assert verification.score(alike, SETTINGS) == pytest.approx(
        expected.score(wanted, settings), abs=1e-4
    )


@given(confidence=st.floats(0, 1, width=32), num_missed=st.integers(0, 9))
def test_num_missed_is_that_of_the_reference(confidence, num_missed):
    settings = reference.Verification(**dataclasses.asdict(SETTINGS))
    template = jnp.zeros(20)
    state = VerificationState(template, template, jnp.int32(num_missed))
    found = verification.step(state, jnp.float32(confidence), SETTINGS)
    last = expected.VerificationState(np.zeros(20), np.zeros(20), num_missed)
    wanted = expected.step(last, confidence, settings)
    assert found.num_missed == wanted.num_missed
    assert verification.is_lost(found, SETTINGS) == expected.is_lost(wanted, settings)


def unit(seed: int) -> np.ndarray:
    vector = np.random.default_rng(seed).normal(size=20).astype(np.float32)
    return vector / np.linalg.norm(vector)


def test_what_was_learned_is_similar_and_kept_in_the_online_template():
    one, other = unit(1), unit(2)
    state = verification.init(jnp.asarray(one))
    assert verification.similarity(state, jnp.asarray(one), SETTINGS) == pytest.approx(1, abs=1e-4)
    later = verification.update(state, jnp.asarray(other), SETTINGS)
    np.testing.assert_array_equal(later.initial, one)
    wanted = one + np.float32(SETTINGS.template_rate) * (other - one)
    np.testing.assert_allclose(later.online, wanted, atol=1e-6)


def test_an_object_is_missed_lost_and_recovered_by_its_confidence():
    settings = Verification(lost_below=0.5, recover_above=0.9, patience=3)
    state = verification.init(jnp.asarray(unit(1)))
    counts, lost = [], []
    for confidence in (0.4, 0.6, 0.5, 0.2, 0.1, 0.6, 0.89, 0.95, 0.6):
        state = verification.step(state, jnp.float32(confidence), settings)
        counts.append(int(state.num_missed))
        lost.append(bool(verification.is_lost(state, settings)))
    # 0.6 holds an object that is not lost; one that is lost needs more than 0.9.
    assert counts == [1, 0, 1, 2, 3, 4, 5, 0, 0]
    assert lost == [count >= 3 for count in counts]
