"""The benchmarks run: what they measure is the tracker as it is."""

import functools
import re
from pathlib import Path

import jax
import numpy as np
import pytest

from benchmarks import growth, profile_step, run
from benchmarks.compare import around, main, median_interval
from benchmarks.material import Panel
from benchmarks.timing import spread, take_turns
from dcs_jax import Config
from dcs_jax.synthetic import render

ROOT = Path(__file__).parents[1]
SMALL = "canvas=8 parts=1 selectors=2 pool_size=4 sizes=3"


@pytest.mark.parametrize("extras", [True, False])
def test_stages_of_the_profile_are_the_step(extras):
    config = Config(canvas=8, parts=1, selectors=2, pool_size=4, sizes=3, extras=extras)
    clip = render(4, (60, 80), (16, 16))
    frame, state = profile_step.prepare(clip.frames, clip.boxes[0], config)
    table = profile_step.stages(config)
    made = jax.jit(functools.partial(profile_step.run, table))(frame, state, config)
    profile_step.check(made, frame, state, config)
    last = "extras, learning" if extras else "strong"
    wrong = jax.tree.map(lambda leaf: leaf + 1, made[last])
    with pytest.raises(RuntimeError, match="no longer those"):
        profile_step.check(made | {last: wrong}, frame, state, config)


def test_a_checkout_is_as_fast_as_itself(capsys):
    command = [str(ROOT), "--setting", f"default {SMALL}", "--frames", "4", "--rounds", "2"]
    # The times of so little are those of starting it.
    assert main([*command, "--tolerance", "50"]) == 0
    printed = capsys.readouterr().out
    assert "boxes: the same, at most 0 px apart" in printed
    assert "| this | " in printed


def test_a_slower_checkout_fails(capsys):
    command = [str(ROOT), "--setting", f"default {SMALL}", "--frames", "4", "--rounds", "2"]
    assert main([*command, "--tolerance", "-1"]) == 1
    assert "slower by more than -100%" in capsys.readouterr().out


def test_neither_directory_nor_revision():
    with pytest.raises(SystemExit, match="no directory and no revision"):
        main(["no such thing", "--frames", "2"])


def test_table_of_a_run(capsys):
    assert run.main(["--quick", "--only", "import"]) == 0
    printed = capsys.readouterr().out
    assert re.search(r"^\d+ cores of \d+ .*; medians of 1 ", printed)
    row = r"^\| import dcs_jax beyond jax \| (\S+) .*s \| under 1 s \|$"
    [seconds] = re.findall(row, printed, re.MULTILINE)
    assert 0 < float(seconds) < 30


def test_a_case_that_fails_does_not_end_the_run(capsys, monkeypatch):
    def broken(material):
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


def test_spread_is_median_and_range():
    assert spread([3.0, 1.0, 2.0]) == "2.0 (1.0 to 3.0)"
    assert spread([1.26], 1) == "1.3"


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
