"""The benchmarks run: what they measure is the tracker as it is."""

import functools
import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks import ablation, growth, harder, profile_step, run
from benchmarks.common import Panel, around, median_range, take_turns
from benchmarks.compare import Comparison, main, median_interval
from dcs_jax import Config
from dcs_jax.evaluation.settings import parse_setting

ROOT = Path(__file__).parents[1]
SMALL = "default canvas=8 parts=1 selectors=2 pool_size=4 scale.num_scales=3"


@pytest.fixture
def cache_key_restored():
    """For a test of the profile, after which compiled programs are found by their usual keys."""
    yield
    jax.config.update("jax_compilation_cache_include_metadata_in_key", False)


def test_profile_of_a_step(capsys, cache_key_restored):
    # Re-detection is half of the program, and takes half of the time to compile.
    profile_step.main(["--setting", f"{SMALL} redetection=none", "--frames", "2"])
    printed = capsys.readouterr().out
    stages = set(re.findall(r"^\| ([a-zA-Z ]+) \| \d+ \| \d+% \| \d+ \|$", printed, re.MULTILINE))
    assert stages > {"window", "confidence map", "peak", "selection"}
    assert stages > {"translation", "colour", "scale", "verification"}
    [every, alone] = re.findall(r"(\d+)(?: \(.*\))? us", printed.splitlines()[-1])
    assert int(every) > 0
    assert int(alone) > 0


def test_stage_is_the_outermost_scope():
    assert profile_step.stage("jit(f)/while/body/closed_call/peak/mul") == "peak"
    assert profile_step.stage("jit(f)/while/body/eval_jaxpr/peak/mul") == "peak"  # JAX 0.12
    assert profile_step.stage("jit(f)/redetection/cond/branch_1_fun/while/body/peak/mul") == (
        "redetection"
    )
    assert profile_step.stage("jit(f)/while/body/jit(_where)/select_n") is None
    assert profile_step.stage("jit(f)/vmap()/add") is None


def test_operations_have_the_stage_of_their_scope_or_loop():
    @jax.jit
    def program(x):
        with jax.named_scope("loop"):
            x = jax.lax.fori_loop(0, 3, lambda number, x: jnp.sin(x @ x) + number, x)
        return jnp.sort(x, 0)

    compiled = program.lower(jnp.ones((8, 8))).compile()
    stages = profile_step.stages(compiled.as_text() or "")
    assert set(stages.values()) == {"loop", "other"}
    spent = profile_step.by_stage(
        profile_step.traced(functools.partial(compiled, jnp.ones((8, 8)))), stages
    )
    assert all(seconds >= 0 for seconds, _ in spent.values())
    assert spent["loop"][1] >= 3


def test_operations_count_their_median_less_what_the_profiler_adds():
    times = {"a": [1.0, 1.0, 7.0], "b": [2.0], "c": [0.5, 0.5], "a loop": [0.1], "end: a": [0.1]}
    stages = {"a": "peak", "b": "peak", "c": "window", "never run": "scale"}
    assert profile_step.by_stage(times, stages) == {"peak": (3.0, 4), "window": (0.0, 2)}


def test_ablation_of_the_default():
    changed = ablation.changes("default", ablation.ingredients("default"))
    assert changed["verification=none,redetection=none"] == (
        "default verification=none redetection=none"
    )
    configs = {choice: parse_setting(setting).config("") for choice, setting in changed.items()}
    assert configs["scale=none"] == Config(scale=None)
    assert "scale.initial_pull=0.0" in configs
    # What the base has already.
    assert not {"translation.weight=15.0", "window_factor=2.5", "selector=l1"} & changed.keys()


def test_ablation_of_the_paper_is_without_components():
    assert not set(ablation.BEYOND) & set(ablation.ingredients("paper"))
    assert "tie=error" in ablation.changes("paper", ablation.ingredients("paper"))


@pytest.fixture(scope="module")
def boxes():
    return np.arange(8, dtype=np.float32).reshape(1, 2, 4)


def test_a_checkout_has_the_boxes_of_itself(capsys):
    command = [str(ROOT), "--setting", SMALL, "--frames", "4", "--rounds", "2"]
    assert main([*command, "--tolerance", "-1"]) == 1
    printed = capsys.readouterr().out
    assert "boxes: identical, bit for bit" in printed
    assert "| this | " in printed
    assert "slower by more than -100%" in printed


def test_a_slower_checkout_is_beyond_chance(boxes):
    base = [1.0] * 9
    assert not Comparison(boxes, boxes, {"base": base, "this": base}).slower(0.0)
    seconds = {"base": base, "this": [1.0, 1.0, *[1.2] * 7]}
    assert not Comparison(boxes, boxes, seconds).slower(0.1)
    seconds["this"][0] = 1.2
    assert Comparison(boxes, boxes, seconds).slower(0.1)
    assert not Comparison(boxes, boxes, seconds).slower(0.3)


def test_boxes_in_words(boxes):
    def words(this):
        return Comparison(boxes, this, {}).boxes()

    assert words(boxes.copy()) == "identical, bit for bit"
    rounded = np.nextafter(boxes, np.float32(9))
    assert words(rounded).startswith("the same to rounding, at most ")
    assert words(boxes + np.float32(0.5)) == "NOT THE SAME, at most 0.5 px apart"


def test_neither_directory_nor_revision():
    with pytest.raises(SystemExit, match="neither a directory nor a revision"):
        main(["no such thing", "--frames", "2"])


def test_table_of_a_run(capsys):
    assert run.main(["--quick", "--only", "import"]) == 0
    printed = capsys.readouterr().out
    assert re.search(r"^\d+ cores of \d+ .*; medians of 1 ", printed)
    row = r"^\| import dcs_jax beyond jax \| (\S+) .*s \| under 1 s \|$"
    [seconds] = re.findall(row, printed, re.MULTILINE)
    assert 0 < float(seconds) < 30


def test_a_case_that_fails_does_not_end_the_run(capsys, monkeypatch):
    def broken(inputs):
        raise ValueError("no\nluck | none")
        yield

    monkeypatch.setitem(run.CASES, "single", broken)
    assert run.main(["--quick", "--only", "single,seeds"]) == 1
    rows = [line for line in capsys.readouterr().out.splitlines() if line.startswith("| ")]
    assert rows[1:] == [
        "| single | FAILED: ValueError: no luck / none |  |",
        "| 30 seeds of the sequences | skipped: no ROOT was given |  |",
    ]


def test_median_interval_is_that_of_the_order():
    assert median_interval([5, 1, 2, 3, 4, 6, 7, 8, 9]) == (2, 8)
    assert median_interval([3, 1, 2]) == (1, 3)
    assert median_interval([1]) == (1, 1)


def test_turns_go_forwards_and_backwards():
    called = []

    def call(name, seconds):
        called.append(name)
        return seconds

    calls = {"a": functools.partial(call, "a", 1.0), "b": functools.partial(call, "b", 3.0)}
    assert take_turns(calls, 3) == {"a": [1.0] * 3, "b": [3.0] * 3}
    assert called == ["a", "b", "b", "a", "a", "b"]


def test_median_range_is_median_and_range():
    assert median_range([3.0, 1.0, 2.0]) == "2.0 (1.0 to 3.0)"
    assert median_range([1.26], 1) == "1.3"


def test_targets_lie_around_the_box():
    boxes = around(np.array([10.0, 20, 30, 40]), 32)
    assert boxes.shape == (32, 4)
    np.testing.assert_array_equal(boxes[0], [10, 20, 30, 40])
    np.testing.assert_array_equal(boxes[:, 2:], np.tile([30, 40], (32, 1)))
    away = np.hypot(*(boxes[:, :2] - boxes[0, :2]).T)
    assert away.max() < 6.01
    assert len(np.unique(boxes, axis=0)) == 32


def test_growth_is_drawn(tmp_path):
    panels = [
        Panel("one", "targets", "ms", (1, 10, 100), {"a": [1.0, 1.1, 1.2]}),
        Panel("two", "frames", "ms", (32,), {"a": [2.0], "b": [30.0]}),
    ]
    growth.draw(panels, tmp_path / "new" / "growth.png")
    picture = (tmp_path / "new" / "growth.png").read_bytes()
    assert picture.startswith(b"\x89PNG")


def labelled_square(middles, side=10):
    """Black frames with a white square around each of the middles, and its box."""
    frames = np.zeros((len(middles), 100, 120, 3), np.uint8)
    corners = np.array(middles) - side // 2
    for frame, (x, y) in zip(frames, corners, strict=True):
        frame[y : y + side, x : x + side] = 255
    return harder.Clip(frames, np.pad(corners, ((0, 0), (0, 2)), constant_values=side) * 1.0)


@pytest.mark.parametrize("name", harder.CHANGES)
def test_what_is_made_harder_keeps_its_object_in_its_box(name):
    clip = labelled_square([(40 + k // 4, 60) for k in range(61)])
    changed = harder.CHANGES[name](clip)
    assert len(changed.frames) == len(changed.truth) > 20
    for frame, (x, y, w, h) in zip(changed.frames, changed.truth, strict=True):
        rows, columns = np.nonzero(frame[..., 0] > 127)
        centre = (columns.min() + columns.max() + 1) / 2, (rows.min() + rows.max() + 1) / 2
        assert abs(centre[0] - x - w / 2) < 1.6
        assert abs(centre[1] - y - h / 2) < 1.6
    assert changed.truth[:, 2].min() < 6 if name == "narrowing" else changed.truth[0, 2] == 10


def test_a_clip_goes_backward_from_its_last_label():
    clip = labelled_square([(40 + k, 60) for k in range(9)])
    clip.truth[7:] = np.nan
    np.testing.assert_array_equal(harder.backward(clip, 2).truth, clip.truth[[6, 4, 2, 0]])


def test_an_object_that_turns_out_of_the_picture_has_no_label():
    clip = labelled_square([(110, 90)] * 90)
    truth = harder.turning(clip).truth
    assert np.isfinite(truth[0]).all()
    assert np.isnan(truth[30]).all()  # the corner of a picture that is wider than high
