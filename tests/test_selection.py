"""The four selectors against the reference."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from hypothesis import given
from hypothesis import strategies as st

from dcs_jax.config import Config
from dcs_jax.core.selection import select
from dcs_jax.solvers.ties import first_maximum

PARTS, SELECTORS, POOL_SIZE = 2, 6, 30
SAMPLES = [0, 0, 0, 0, 1, 2, 3, 4]  # of the L = 8 training samples, the R = 5 patches


def random_votes(seed: int, reliability: float) -> tuple[np.ndarray, np.ndarray]:
    """Votes [R, M, K, N] that are right with this probability, and errors [M, K, N]."""
    generator = np.random.default_rng(seed)
    shape = (POOL_SIZE, PARTS, SELECTORS)
    right = generator.random((5, *shape)) < reliability
    votes = np.where(right, 1.0, -1.0) * np.array([1, -1, -1, -1, -1]).reshape(5, 1, 1, 1)
    return votes, generator.uniform(0.05, 0.95, shape)


@pytest.mark.parametrize("selector", ["l1", "error", "mil", "first"])
@given(seed=st.integers(0, 2**31), reliability=st.sampled_from([0.5, 0.7, 0.9]))
def test_selected_columns_are_those_of_the_reference(selector, seed, reliability):
    votes, errors = random_votes(seed, reliability)
    phi = votes[SAMPLES].transpose(2, 3, 0, 1)  # [K, N, L, M]
    expected = {
        "l1": lambda: reference.select_l1(phi, reference.LABELS, 0.01, 30),
        "error": lambda: reference.select_error(errors.transpose(1, 2, 0)),
        "mil": lambda: reference.select_mil(phi, reference.LABELS),
        "first": lambda: reference.select_first(phi, reference.LABELS),
    }[selector]()
    config = Config(
        parts=1, selectors=SELECTORS, pool_size=POOL_SIZE, selector=selector, iterations=30
    )
    selected, _ = jax.jit(select)(votes.astype(np.float32), errors.astype(np.float32), config)
    np.testing.assert_array_equal(selected, expected)


@given(seed=st.integers(0, 2**31))
def test_a_tie_may_go_to_the_least_error(seed):
    votes, errors = random_votes(seed, 0.9)
    phi = votes[SAMPLES].transpose(2, 3, 0, 1)
    by_selector = errors.transpose(1, 2, 0)
    expected = reference.select_l1(phi, reference.LABELS, 0.01, 30, by_selector)
    config = Config(parts=1, selectors=SELECTORS, pool_size=POOL_SIZE, iterations=30, tie="error")
    selected, _ = jax.jit(select)(votes.astype(np.float32), errors.astype(np.float32), config)
    np.testing.assert_array_equal(selected, expected)


def test_a_lambda_that_leaves_no_classifier_selects_the_best_correlated():
    votes, errors = (jnp.asarray(x, jnp.float32) for x in random_votes(0, 0.7))
    none, _ = select(votes, errors, Config(lam=100.0))
    np.testing.assert_array_equal(none, select(votes, errors, Config(selector="first"))[0])


def test_lambda_can_be_swept_in_one_call():
    votes, errors = (jnp.asarray(x, jnp.float32) for x in random_votes(0, 0.7))
    lams = jnp.array([0.01, 100.0])
    swept = jax.vmap(lambda lam: select(votes, errors, Config(lam=lam))[0])(lams)
    for selected, lam in zip(swept, lams, strict=True):
        np.testing.assert_array_equal(selected, select(votes, errors, Config(lam=lam))[0])


@given(seed=st.integers(0, 2**31), reliability=st.sampled_from([0.5, 0.7, 0.9]))
def test_label_noise_is_that_of_the_reference(seed, reliability):
    votes, errors = random_votes(seed, reliability)
    phi = votes[SAMPLES].transpose(2, 3, 0, 1)
    config = Config(parts=1, selectors=SELECTORS, pool_size=POOL_SIZE, iterations=30)
    _, noise = jax.jit(select)(votes.astype(np.float32), errors.astype(np.float32), config)
    expected = reference.label_noise(phi, reference.LABELS, 0.01, 30)
    np.testing.assert_allclose(noise, expected, atol=1e-4)


@pytest.mark.parametrize("selector", ["error", "mil", "first"])
def test_without_the_l1_model_no_label_is_corrected(selector):
    votes, errors = (jnp.asarray(x, jnp.float32) for x in random_votes(0, 0.7))
    _, noise = select(votes, errors, Config(selector=selector))
    assert not noise.any()


@pytest.mark.parametrize(
    ("scores", "expected"),
    [([1.0, 2.0, 2.0], 1), ([1.999, 2.0], 0), ([1.99, 2.0], 1), ([-2.0, -1.0], 1), ([0.0, 0.0], 0)],
)
def test_first_maximum_takes_the_first_up_to_rounding(scores, expected):
    assert first_maximum(jnp.array(scores)) == expected
