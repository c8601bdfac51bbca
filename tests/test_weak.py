"""Weak classifiers against the sequential filter of the reference."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from hypothesis import given
from hypothesis import strategies as st

from dcs_jax.core.strong import combine
from dcs_jax.core.weak import error, init_weak, update_weak, vote
from dcs_jax.types import Pool

FEATURES = 30
POOL = Pool(
    jnp.zeros((9, FEATURES), jnp.uint16),
    jnp.zeros((9, FEATURES), jnp.int8),
    jnp.ones(FEATURES),
    jnp.arange(FEATURES, dtype=jnp.int32) % 3 + 2,
)
update = jax.jit(update_weak)
SAMPLES = [0, 0, 0, 0, 1, 2, 3, 4]  # of the L = 8 training samples, the R = 5 patches


@pytest.mark.parametrize("rule", ["midpoint", "gaussian"])
@given(seed=st.integers(0, 2**31), updates=st.integers(1, 4))
def test_updates_are_those_of_the_sequential_filter(rule, seed, updates):
    generator = np.random.default_rng(seed)
    weak = init_weak(POOL, rule)
    means, variance = np.zeros((FEATURES, 2)), np.full(2, 1000.0)
    sigma = reference.first_sigma(np.asarray(POOL.boxes)) if rule == "gaussian" else None
    correct = wrong = np.ones(FEATURES)
    for _ in range(updates):
        values = generator.normal(0, 40, (FEATURES, 5)).astype(np.float32)
        weak, votes = update(weak, jnp.asarray(values.T))
        samples = values[:, SAMPLES].astype(float)
        means, sigma, variance = reference.kalman_update(
            samples, reference.LABELS, means, sigma, variance
        )
        expected = reference.votes(samples, means, sigma)
        correct, wrong = reference.count(expected, reference.LABELS, correct, wrong)
        np.testing.assert_array_equal(votes.T, expected[:, [0, 4, 5, 6, 7]])
    np.testing.assert_allclose(weak.mean.T, means, rtol=1e-4, atol=1e-3)
    np.testing.assert_allclose(weak.variance, variance[0], rtol=1e-4)
    np.testing.assert_array_equal(weak.correct, correct)
    np.testing.assert_array_equal(weak.wrong, wrong)
    if sigma is not None:
        assert weak.sigma is not None
        np.testing.assert_allclose(weak.sigma.T, sigma, rtol=1e-4)
    np.testing.assert_allclose(error(weak), reference.error(correct, wrong), rtol=1e-6)


def test_the_gain_falls_to_its_floor():
    weak = init_weak(POOL, "midpoint")
    zeros, ones = jnp.zeros((5, FEATURES)), jnp.ones((5, FEATURES))
    for _ in range(300):
        weak, _ = update(weak, zeros)
    weak, _ = update(weak, ones)
    np.testing.assert_allclose(weak.mean, 1 - (1 - 0.001) ** 4, rtol=1e-4)


def test_a_tie_is_a_vote_for_the_object():
    assert vote(jnp.zeros(3), jnp.zeros((2, 3)), None).tolist() == [1, 1, 1]


@given(seed=st.integers(0, 2**31))
def test_alpha_is_the_log_odds_of_being_right(seed):
    generator = np.random.default_rng(seed)
    errors = generator.uniform(0.01, 0.99, (4, 2, 3)).astype(np.float32)
    selected = generator.integers(0, 4, (2, 3)).astype(np.int32)
    strong = combine(jnp.asarray(selected), jnp.asarray(errors))
    chosen = np.take_along_axis(errors.astype(float), selected[None], 0)[0]
    np.testing.assert_allclose(strong.alpha, reference.voting_weight(chosen), rtol=1e-5, atol=1e-6)
    assert (strong.alpha[chosen >= 0.5] == 0).all()
