"""Settings: what they accept, and what is static."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from dcs_jax import Config


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"parts": 4}, "parts must be one of 1, 5, 9, but is 4"),
        ({"selector": "l2"}, "selector must be one of 'l1', 'error', 'mil', 'first', but is 'l2'"),
        ({"weak": "stump"}, "weak must be one of 'midpoint', 'gaussian', but is 'stump'"),
        ({"selectors": 0}, "selectors must be an integer of at least 1, but is 0"),
        ({"pool_size": 2.5}, r"pool_size must be an integer of at least 1, but is 2\.5"),
        ({"iterations": True}, "iterations must be an integer"),
        ({"canvas": 3}, 'canvas must be "native", an integer of at least 4 .* but is 3'),
        ({"canvas": (40, 40, 40)}, r"canvas .* but is \(40, 40, 40\)"),
        ({"canvas": "pixels"}, "canvas .* but is 'pixels'"),
        ({"window_factor": 1.0}, r"window_factor must be finite and above 1, but is 1\.0"),
        ({"window_minimum": -1.0}, "window_minimum must be finite and not negative"),
        ({"lam": -0.1}, r"lam must be finite and not negative, but is -0\.1"),
        ({"lam": np.array([0.1, np.nan])}, "lam must be finite and not negative"),
        ({"prior": jnp.array([-1.0])}, "prior must be finite and not negative"),
        ({"smoothing": float("inf")}, "smoothing must be finite and not negative, but is inf"),
        ({"extras": 1}, "extras must be True or False, but is 1"),
        ({"sizes": 16}, "sizes must be odd, so that the last size is in the middle, but is 16"),
        ({"patience": 0}, "patience must be at least 1, but is 0"),
        ({"size_pull": 1.5}, r"size_pull must be from 0 to 1, but is 1\.5"),
        ({"anchor": -0.1}, r"anchor must be from 0 to 1, but is -0\.1"),
        ({"size_step": 1.0}, r"size_step must be above 1 and below 2, but is 1\.0"),
        ({"learn_above": 1.5}, r"learn_above must be from 0 to 1, but is 1\.5"),
        ({"lam": "much"}, "lam must be a number or an array of numbers, but is 'much'"),
    ],
)
def test_values_out_of_range_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        Config(**changes)


def test_the_numbers_are_the_leaves():
    config = Config(lam=0.5, prior=2.0, patience=7)
    numbers = [f.name for f in dataclasses.fields(Config) if not f.metadata.get("static")]
    assert {"lam", "prior", "place_weight", "patience", "found_above"} <= set(numbers)
    assert sorted(jax.tree.leaves(config)) == sorted(getattr(config, name) for name in numbers)


def test_static_fields_are_part_of_the_structure():
    structure = jax.tree.structure
    assert structure(Config(lam=0.5)) == structure(Config(lam=0.1))
    assert structure(Config(selector="mil")) != structure(Config())
    assert structure(Config(canvas=30)) != structure(Config())


def test_the_papers_preset_takes_its_shapes_from_the_box():
    config = Config.paper().resolve((10, 10, 30, 62))
    assert config.canvas == (62, 30)
    assert config.window_factor == pytest.approx(100 / 30)
    assert config.grid.window == (62 + 2 * 72, 30 + 2 * 35)


def test_a_canvas_does_not_depend_on_the_box():
    config = Config()
    assert config.resolve((10, 10, 30, 62)) is config
    assert config.grid.positions == (61, 61)


def test_fields_of_the_papers_preset_can_be_changed():
    assert Config.paper(selector="error") == dataclasses.replace(Config.paper(), selector="error")
