"""Confidence map and peak."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from hypothesis import assume, given
from hypothesis import strategies as st
from layout import in_reference_order, reference_pool, reference_settings

from dcs_jax.config import Config
from dcs_jax.core.haar import draw_pool
from dcs_jax.core.search import ConfidenceMap, confidence_map, find_peak, parabola_peak
from dcs_jax.core.weak import init_weak
from dcs_jax.core.window import place
from dcs_jax.types import Strong

CONFIG = Config(canvas=(12, 10), parts=5, selectors=4, pool_size=3)
FRAME = (300, 300)
BOX = np.array([100, 120, 30, 24], np.float32)


@functools.partial(jax.jit, static_argnames="subcell")
def peak_of(score_map, box, config, subcell, middle=(0, 0)):
    middle = jnp.asarray(middle, jnp.int32)
    placed = place(box, config)
    return find_peak(score_map, placed, FRAME, config, subcell=subcell, middle=middle)


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
    integral = reference.integral(
        generator.integers(-99, 99, CONFIG.search_grid.window).astype(float)
    )
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
                config.search_grid,
            )
        )
    probabilities = reference.part_probabilities(np.stack(maps), smoothing)
    np.testing.assert_allclose(found.parts, probabilities, atol=1e-5)
    np.testing.assert_allclose(
        found.score_map, reference.score_map(probabilities, smoothing), rtol=1e-4, atol=1e-4
    )


def test_confidence_is_the_noisy_or_of_the_parts():
    pool, weak, strong, integral = random_classifiers(2)
    config = Config(canvas=(12, 10), parts=5, selectors=4, pool_size=3, smoothing=0.0)
    found = confidence_map(jnp.asarray(integral, jnp.float32), pool, weak, strong, config)
    for row, column in ((0, 0), (6, 5), (12, 10)):
        confidence, parts = found.at(jnp.int32(row), jnp.int32(column), config)
        noisy_or = 1 - np.prod(np.maximum(1 - np.asarray(parts, float), 1e-6))
        assert confidence == pytest.approx(noisy_or, abs=1e-6)


def test_without_any_trusted_classifier_every_position_is_as_likely():
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
    maps = jax.vmap(confidence_map, (0, 0, 0, 0, None))
    together = maps(integral, pool, weak, strong, CONFIG)
    for number, (pool, weak, strong, integral) in enumerate(cases):
        alone = confidence_map(jnp.asarray(integral, jnp.float32), pool, weak, strong, CONFIG)
        np.testing.assert_allclose(
            together.score_map[number], alone.score_map, rtol=1e-5, atol=1e-5
        )


@given(
    seed=st.integers(0, 2**31),
    levels=st.integers(2, 40),
    prior=st.sampled_from([0.0, 0.6, 5.0]),
    x=st.integers(-10, 290),
    subcell=st.booleans(),
    middle=st.tuples(st.integers(-12, 12), st.integers(-10, 10)),
)
def test_peak_is_that_of_the_reference(seed, levels, prior, x, subcell, middle):
    generator = np.random.default_rng(seed)
    # Few levels make plateaus, as hard votes do.
    score_map = generator.integers(0, levels, CONFIG.search_grid.positions).astype(float)
    box = np.array([x, *BOX[1:]], np.float32)
    config = Config(canvas=(12, 10), prior=prior)
    middle = np.array(middle)
    settings = reference_settings(config)
    reach = reference.reachable(box, FRAME, settings)
    scores = reference.with_motion_prior(score_map, box, reach, settings, middle)
    distances = reference.squared_distances(box, settings, middle)
    assume(np.isfinite(scores).any())
    expected = middle + reference.peak(scores, distances, subcell)
    found = peak_of(score_map.astype(np.float32), box, config, subcell, middle)
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_a_flat_map_is_no_motion():
    found = peak_of(
        jnp.ones(CONFIG.search_grid.positions), BOX, Config(canvas=(12, 10)), subcell=True
    )
    assert jnp.abs(found).max() < 1e-6


def test_a_plateau_gives_its_centroid_and_not_its_first_position():
    score_map = np.zeros(CONFIG.search_grid.positions, np.float32)
    score_map[2:5, 6:8] = 1
    config = Config(canvas=(12, 10), prior=0.0)
    found = peak_of(jnp.asarray(score_map), BOX, config, subcell=True)
    middle = (config.search_grid.margin_rows, config.search_grid.margin_columns)
    np.testing.assert_allclose(found, [3 - middle[0], 6.5 - middle[1]], atol=1e-6)


@pytest.mark.parametrize("smoothing", [0.0, 1.5])
def test_the_noisy_or_is_that_of_the_score_map(smoothing):
    pool, weak, strong, integral = random_classifiers(4)
    config = Config(canvas=(12, 10), parts=5, selectors=4, pool_size=3, smoothing=smoothing)
    found = confidence_map(jnp.asarray(integral, jnp.float32), pool, weak, strong, config)
    for row, column in ((0, 0), (6, 5), (12, 10)):
        noisy_or, _ = found.at(jnp.int32(row), jnp.int32(column), config)
        expected = 1 - np.exp(-np.asarray(found.score_map, float)[row, column])
        assert noisy_or == pytest.approx(expected, abs=1e-6)


def test_a_certain_position_has_a_noisy_or_of_one():
    certain = jnp.full((1, 1), 60.0)
    sure = ConfidenceMap(jnp.ones((5, 1, 1)), certain, certain)
    assert sure.at(jnp.int32(0), jnp.int32(0), CONFIG)[0] == 1


@given(peak=st.floats(-0.5, 0.5), curvature=st.floats(0.1, 50), height=st.floats(-10, 10))
def test_a_parabola_has_its_peak_found(peak, curvature, height):
    values = [jnp.float32(height - curvature * (x - peak) ** 2) for x in (-1, 0, 1)]
    assert parabola_peak(*values) == pytest.approx(peak, abs=1e-3)
    assert reference.parabola_peak(*map(float, values)) == pytest.approx(peak, abs=1e-3)


@pytest.mark.parametrize(
    "values", [(-np.inf, 1, 0), (0, 1, -np.inf), (-np.inf, 1, -np.inf), (1, 1, 1), (2, 1, 2)]
)
def test_at_an_edge_and_without_a_peak_nothing_is_added(values):
    assert parabola_peak(*map(jnp.float32, values)) == 0
    assert reference.parabola_peak(*values) == 0
