"""Settings: what they accept, and what is static."""

import dataclasses
import re
from operator import attrgetter

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from dcs_jax import Config, Redetection, ScaleFilter, TranslationFilter, Verification
from dcs_jax.config import COMPONENTS, RENAMED


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
        ({"translation": 1}, r"translation must be a dcs_jax\.TranslationFilter or None, but is 1"),
        ({"output_size": "same"}, "output_size must be one of 'estimated', 'initial'"),
        ({"verification": None}, "redetection needs verification"),
        ({"lam": "much"}, "lam must be a number or an array of numbers, but is 'much'"),
    ],
)
def test_values_out_of_range_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        Config(**changes)


@pytest.mark.parametrize(
    ("group", "changes", "message"),
    [
        (ScaleFilter, {"num_scales": 16}, "num_scales must be odd, .* in the middle, but is 16"),
        (ScaleFilter, {"num_scales": 1}, "num_scales must be an integer of at least 3, but is 1"),
        (ScaleFilter, {"step": 1.0}, r"step must be above 1 and below 2, but is 1\.0"),
        (ScaleFilter, {"initial_pull": 1.5}, r"initial_pull must be from 0 to 1, but is 1\.5"),
        (
            TranslationFilter,
            {"first_frame": -0.1},
            r"first_frame must be from 0 to 1, but is -0\.1",
        ),
        (TranslationFilter, {"weight": -1.0}, "weight must be finite and not negative"),
        (Verification, {"patience": 0}, "patience must be at least 1, but is 0"),
        (Verification, {"learn_above": 1.5}, r"learn_above must be from 0 to 1, but is 1\.5"),
        (Verification, {"middle": 2.0}, r"middle must be from -1 to 1, but is 2\.0"),
        (Redetection, {"windows": 0}, "windows must be an integer of at least 1, but is 0"),
        (Redetection, {"accept_above": np.ones(2) * 2}, "accept_above must be from 0 to 1"),
    ],
)
def test_values_out_of_range_are_refused_in_groups(group, changes, message):
    with pytest.raises(ValueError, match=message):
        group(**changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"extras": False}, "extras is now translation, scale, verification and redetection, each"),
        ({"scale": False}, "scale=False is now output_size='initial'"),
        ({"scale": True}, "scale=True is now output_size='estimated'"),
        ({"found_above": 0.8}, r"now verification\.recover_above and redetection\.accept_above"),
    ],
)
def test_old_names_are_refused_with_the_new_one(changes, message):
    for make in (Config, Config.paper, lambda **old: dataclasses.replace(Config(), **old)):
        with pytest.raises(ValueError, match=message):
            make(**changes)


def test_every_new_name_of_an_old_one_is_a_field():
    for new in RENAMED.values():
        for name in re.findall(r"\w+\.\w+", new):
            assert attrgetter(name)(Config()) is not None


def test_the_numbers_are_the_leaves():
    config = Config(lam=0.5, prior=2.0, verification=Verification(patience=7))
    numbers = [
        getattr(settings, field.name)
        for settings in (config, *(getattr(config, name) for name in COMPONENTS))
        for field in dataclasses.fields(settings)
        if not field.metadata.get("static") and field.name not in COMPONENTS
    ]
    assert {0.5, 2.0, 7, 15.0} <= set(numbers)
    assert sorted(jax.tree.leaves(config)) == sorted(numbers)


def test_static_fields_are_part_of_the_structure():
    structure = jax.tree.structure
    assert structure(Config(lam=0.5)) == structure(Config(lam=0.1))
    assert structure(Config(selector="mil")) != structure(Config())
    assert structure(Config(canvas=30)) != structure(Config())
    assert structure(Config(scale=ScaleFilter(step=1.03))) != structure(Config())
    assert structure(Config(translation=None)) != structure(Config())


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
