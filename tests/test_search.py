"""Confidence map and peak."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from hypothesis import given
from hypothesis import strategies as st
from layout import in_reference_order, reference_pool

from dcs_jax.config import Config
from dcs_jax.core.haar import draw_pool
from dcs_jax.core.search import ConfidenceMap, confidence_map, find_peak
from dcs_jax.core.weak import init_weak
from dcs_jax.types import Strong

CONFIG = Config(canvas=(12, 10), parts=5, selectors=4, pool_size=3)
FRAME = (300, 300)
BOX = np.float32([100, 120, 30, 24])


@jax.jit
def peak_of(evidence, box, config):
    return find_peak(evidence, box, FRAME, config)


def random_classifiers(seed: int, weak_rule: str = "midpoint"):
    """A pool, trained weak classifiers and strong ones, and a window to search."""
    generator = np.random.default_rng(seed)
    pool = draw_pool(jax.random.key(seed), CONFIG)
    weak = init_weak(pool, weak_rule)
    weak = weak._replace(mean=jnp.asarray(generator.normal(0, 20, weak.mean.shape), jnp.float32))
    strong = Strong(
        jnp.asarray(generator.integers(0, 3, (5, 4)), jnp.int32),
        jnp.asarray(generator.uniform(0, 3, (5, 4)), jnp.float32),
    )
    integral = reference.integral(generator.integers(-99, 99, CONFIG.grid.window).astype(float))
    return pool, weak, strong, integral


@pytest.mark.parametrize("rule", ["midpoint", "gaussian"])
@pytest.mark.parametrize("smoothing", [0.0, 0.5, 1.5])
def test_map_is_that_of_the_reference(rule, smoothing):
    pool, weak, strong, integral = random_classifiers(1, rule)
    config = Config(canvas=(12, 10), parts=5, selectors=4, pool_size=3, smoothing=smoothing)
    found = confidence_map(jnp.asarray(integral, jnp.float32), pool, weak, strong, config)
    corners, weights, _ = reference_pool(pool, config)
    mean = in_reference_order(weak.mean, config)
    sigma = None if weak.sigma is None else in_reference_order(weak.sigma, config)
    maps = []
    for k in range(5):
        chosen = (k * 4 + np.arange(4)) * 3 + np.asarray(strong.selected[k])
        maps.append(
            reference.strong_map(
                integral,
                corners[chosen],
                weights[chosen],
                mean[chosen],
                None if sigma is None else sigma[chosen],
                np.asarray(strong.alpha[k], float),
                config.grid,
            )
        )
    probabilities = reference.part_probabilities(np.stack(maps), smoothing)
    np.testing.assert_allclose(found.parts, probabilities, atol=1e-5)
    np.testing.assert_allclose(
        found.evidence, reference.evidence(probabilities, smoothing), rtol=1e-4, atol=1e-4
    )


def test_confidence_is_the_noisy_or_of_the_parts():
    pool, weak, strong, integral = random_classifiers(2)
    config = Config(canvas=(12, 10), parts=5, selectors=4, pool_size=3, smoothing=0.0)
    found = confidence_map(jnp.asarray(integral, jnp.float32), pool, weak, strong, config)
    for row, column in ((0, 0), (6, 5), (12, 10)):
        confidence, parts = found.at(jnp.int32(row), jnp.int32(column))
        noisy_or = 1 - np.prod(np.maximum(1 - np.asarray(parts, float), 1e-6))
        assert confidence == pytest.approx(noisy_or, abs=1e-6)


def test_without_any_trusted_classifier_every_place_is_as_likely():
    pool, weak, strong, integral = random_classifiers(3)
    strong = strong._replace(alpha=jnp.zeros_like(strong.alpha))
    found = confidence_map(jnp.asarray(integral, jnp.float32), pool, weak, strong, CONFIG)
    np.testing.assert_allclose(found.parts, 0.5, atol=1e-6)


def test_under_vmap_the_maps_are_the_same():
    cases = [random_classifiers(seed) for seed in range(3)]
    stacked = jax.tree.map(
        lambda *leaves: jnp.stack(
            [jnp.asarray(x, jnp.float32) if np.asarray(x).dtype == float else x for x in leaves]
        ),
        *cases,
    )
    pool, weak, strong, integral = stacked
    together = jax.vmap(lambda *case: confidence_map(*case, CONFIG))(integral, pool, weak, strong)
    for number, (pool, weak, strong, integral) in enumerate(cases):
        alone = confidence_map(jnp.asarray(integral, jnp.float32), pool, weak, strong, CONFIG)
        np.testing.assert_allclose(together.evidence[number], alone.evidence, rtol=1e-5, atol=1e-5)


@given(
    seed=st.integers(0, 2**31),
    levels=st.integers(2, 40),
    prior=st.sampled_from([0.0, 0.6, 5.0]),
    x=st.integers(-10, 290),
    extras=st.booleans(),
)
def test_peak_is_that_of_the_reference(seed, levels, prior, x, extras):
    generator = np.random.default_rng(seed)
    # Few levels make plateaus, as hard votes do.
    evidence = generator.integers(0, levels, CONFIG.grid.positions).astype(float)
    box = BOX.copy()
    box[0] = x
    config = Config(canvas=(12, 10), prior=prior, extras=extras)
    scores = reference.score_map(evidence, box, FRAME, config.grid, prior)
    expected = reference.peak(scores, reference.squared_distances(box, config.grid), extras)
    found = peak_of(evidence.astype(np.float32), box, config)
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_a_flat_map_is_no_motion():
    found = find_peak(
        jnp.ones(CONFIG.grid.positions), jnp.asarray(BOX), FRAME, Config(canvas=(12, 10))
    )
    assert jnp.abs(found).max() < 1e-6


def test_a_plateau_gives_its_centroid_and_not_its_first_place():
    evidence = np.zeros(CONFIG.grid.positions, np.float32)
    evidence[2:5, 6:8] = 1
    config = Config(canvas=(12, 10), prior=0.0)
    found = find_peak(jnp.asarray(evidence), jnp.asarray(BOX), FRAME, config)
    middle = (config.grid.margin_rows, config.grid.margin_columns)
    np.testing.assert_allclose(found, [3 - middle[0], 6.5 - middle[1]], atol=1e-6)


def test_the_evidence_of_a_certain_place_is_a_confidence_of_one():
    sure = ConfidenceMap(jnp.ones((5, 1, 1)), jnp.full((1, 1), 60.0))
    assert sure.at(jnp.int32(0), jnp.int32(0))[0] == 1
