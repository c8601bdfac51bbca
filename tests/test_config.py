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
        ({"lam": None}, "lam must be a number or an array of numbers, but is None"),
        ({"lam": True}, "lam must be a number or an array of numbers, but is True"),
        ({"smoothing": 1j}, "smoothing must be a number or an array of numbers, but is 1j"),
        ({"lam": [0.1]}, r"lam must be a number or an array of numbers, but is \[0\.1\]"),
        ({"lam": object()}, "lam must be a number or an array of numbers, but is <object"),
        ({"lam": np.array([])}, r"lam must not be empty, but has the shape \(0,\)"),
        ({"lam": np.array([True])}, "lam must be a number .* but has the type bool"),
        ({"lam": np.array([None])}, "lam must be a number .* but has the type object"),
        ({"lam": jnp.ones(2, complex)}, "lam must be a number .* but has the type complex64"),
        ({"lam": jax.random.key(0)}, "lam must be a number .* but has the type key"),
        ({"lam": 1e300}, r"lam must be at most 1e9, but is 1e\+300"),
        ({"lam": 10**5000}, "lam must be at most 1e9, but is a int"),
        ({"lam": np.full(9, 2e9)}, "lam must be at most 1e9, but is in part"),
        ({"parts": 5.0}, "parts must be one of 1, 5, 9, but is 5.0"),
        ({"parts": True}, "parts must be one of 1, 5, 9, but is True"),
        ({"parts": np.array([5])}, r"parts must be one of 1, 5, 9, but is array\(\[5\]\)"),
        ({"selector": np.array(["l1"])}, "selector must be one of .* but is array"),
        ({"selectors": np.array(6)}, r"selectors must be an integer .* but is array\(6\)"),
        ({"pool_size": 2**31}, "pool_size must be .* and at most 2147483647, but is 2147483648"),
        ({"pool_size": 10**6}, r"pool_size=1000000 .* are 360000000 features: .* at most 4194304"),
        ({"window_factor": "2"}, "window_factor must be finite and above 1, but is '2'"),
        ({"window_factor": jnp.float32}, "window_factor must be finite and above 1, but is <class"),
        ({"window_factor": np.array([2.0])}, "window_factor must be .* but is array"),
        ({"window_factor": jnp.float32(2)}, "window_factor must be .* but is Array"),
        ({"window_factor": 10**400}, "window_factor must be finite and above 1, but is 1000"),
        ({"window_minimum": None}, "window_minimum must be finite and not negative, but is None"),
        ({"canvas": True}, "canvas must be .* but is True"),
        ({"canvas": [20, 20]}, r"canvas must be .* but is \[20, 20\]"),
        ({"canvas": np.array([20, 20])}, r"canvas must be .* but is array"),
        ({"canvas": 10**6}, "canvas must be .* at most 4096, or two of them, but is 1000000"),
        ({"scale": np.ones(2)}, r"scale must be a dcs_jax\.ScaleFilter or None, but is array"),
        ({"scale": TranslationFilter()}, r"scale must be a dcs_jax\.ScaleFilter or None, but is T"),
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
        (ScaleFilter, {"step": np.array([1.04])}, "step must be above 1 and below 2, but is array"),
        (ScaleFilter, {"num_scales": 5.0}, r"num_scales must be an integer .* but is 5\.0"),
        (ScaleFilter, {"num_scales": 99, "step": 1.5}, "num_scales=99 with step=1.5 .* at most 10"),
        (Verification, {"patience": 2.5}, "patience must be an integer or an array of integers"),
        (Verification, {"patience": np.ones(2)}, "patience must be an integer .* type float64"),
        (Verification, {"patience": 2**32 + 1}, "patience must be at most 2147483647, but is 4"),
        (Verification, {"patience": np.array([2**32 + 1])}, "patience must be at most 2147483647"),
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
    assert config.search_grid.positions == (61, 61)


def test_fields_of_the_papers_preset_can_be_changed():
    assert Config.paper(selector="error") == dataclasses.replace(Config.paper(), selector="error")


def test_static_numbers_of_numpy_are_kept_as_those_of_python():
    config = Config(
        canvas=(np.int64(20), np.uint8(24)),
        window_factor=np.float32(2.5),
        parts=np.int32(5),
        selectors=np.int64(6),
        scale=ScaleFilter(step=np.float64(1.04)),
    )
    plain = Config(canvas=(20, 24), window_factor=2.5, parts=5, selectors=6)
    assert config == plain
    assert jax.tree.structure(config) == jax.tree.structure(plain)
    assert config.scale is not None
    assert isinstance(config.canvas, tuple)
    numbers = (*config.canvas, config.window_factor, config.parts, config.scale.step)
    assert [type(value) for value in numbers] == [int, int, float, int, float]


@pytest.mark.parametrize(
    "value", [1, 0.5, np.float64(0.5), np.float16(0.5), np.int8(1), np.array([0.1, 2]), jnp.ones(2)]
)
def test_a_number_may_be_of_any_real_type(value):
    assert Config(lam=value).lam is value


@pytest.mark.parametrize(
    "placeholder",
    [object(), None, 0, True, "batch", 1j, jax.ShapeDtypeStruct((), np.float32), np.bool_(True)],
    ids=lambda placeholder: type(placeholder).__name__,
)
def test_jax_may_put_anything_in_the_place_of_the_numbers(placeholder):
    changed = jax.tree.map(lambda _: placeholder, Config())
    assert changed.lam is placeholder
    assert changed.verification.patience is placeholder
    assert (changed.canvas, changed.scale.num_scales) == (40, 11)


def test_settings_are_a_pytree_with_names():
    config = Config(lam=0.5)
    names = [
        jax.tree_util.keystr(path, simple=True, separator=".")
        for path, _ in jax.tree_util.tree_leaves_with_path(config)
    ]
    assert {"lam", "prior", "verification.patience"} <= set(names)
    assert jax.tree.map(lambda number: number, config) == config


def test_settings_pass_jit_vmap_and_eval_shape():
    config = Config(lam=np.arange(3.0))

    def axis(path, _):
        return 0 if path[-1].name == "lam" else None

    axes = jax.tree_util.tree_map_with_path(axis, config)
    assert jax.vmap(lambda c: c.lam + c.prior, in_axes=(axes,))(config).shape == (3,)

    @jax.jit
    def changed(lam):
        return dataclasses.replace(Config(), lam=lam).lam

    assert changed(0.5) == 0.5
    shapes = jax.eval_shape(lambda c: c, Config())
    assert shapes.lam.shape == ()
    with pytest.raises(ValueError, match=r"lam must be a number .* type bool"):
        changed(True)


def test_a_window_of_too_many_cells_is_refused():
    with pytest.raises(ValueError, match=r"canvas=4000 with window_factor=4\.5 .* 4096 cells"):
        _ = Config(canvas=4000).grid
    with pytest.raises(ValueError, match=r"canvas must be .* at most 4096"):
        Config.paper().resolve((0, 0, 30, 5000))
    with pytest.raises(ValueError, match="box must be four finite numbers"):
        Config.paper().resolve((0, 0, 30))
