"""`dcs-jax evaluate` and `dcs-jax report`, as a user meets them."""

import importlib.util
import signal
import sys
import time

import pytest
from data_sets import SMALL, write_otb, write_rows
from typer.testing import CliRunner

from dcs_jax.cli import app
from dcs_jax.synthetic import render

PRESETS = ("--presets", SMALL)


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    folder = tmp_path_factory.mktemp("root")
    write_otb(folder, "Deer", render(41, (120, 160), (36, 30)))
    write_otb(folder, "Toy", render(30, (120, 160), (30, 36)))
    return folder


def run(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_evaluate_writes_a_report_and_reuses_what_is_done(root, tmp_path):
    out = tmp_path / "report"
    arguments = ["evaluate", root, *PRESETS, "--seeds", 2, "--out", out]
    result = run(*arguments)
    assert result.exit_code == 0, result.output
    assert result.stderr == ""
    assert str(out / "index.html") in result.stdout
    for name in ("index.html", "results.csv", "summary.json", "summary.md"):
        assert (out / name).is_file(), name
    assert not list(out.rglob(".*"))  # no temporary file is left
    again = run(*arguments, "--set", "selector=error,lam=0.5", "--sequences", "Toy")
    assert again.exit_code == 0, again.output
    assert "1 of 2 runs reused" in again.stdout
    assert f"{SMALL} selector=error lam=0.5" in (out / "results.csv").read_text()


def test_report_merges_folders(root, tmp_path):
    for name, changes in (("one", []), ("two", ["--baselines", "MIL"])):
        options = [*PRESETS, *changes, "--seeds", 1, "--sequences", "Toy", "--no-page"]
        result = run("evaluate", root, *options, "--out", tmp_path / name)
        assert result.exit_code == 0, result.output
        assert not (tmp_path / name / "index.html").exists()
    out = tmp_path / "both"
    result = run("report", tmp_path / "one", tmp_path / "two", "--out", out)
    assert result.exit_code == 0, result.output
    page = (out / "index.html").read_text(encoding="utf-8")
    assert "OpenCV MIL" in page
    assert "is in several folders: the first one counts" in page
    only = run("report", tmp_path / "one")
    assert only.exit_code == 0, only.output
    assert "OpenCV MIL" not in (tmp_path / "one" / "index.html").read_text(encoding="utf-8")


def test_a_broken_sequence_ends_with_3_and_is_named(root, tmp_path):
    write_otb(tmp_path / "root", "Good", render(9, (120, 160), (36, 30)))
    write_otb(tmp_path / "root", "Bad", render(9, (120, 160), (36, 30)))
    write_rows(tmp_path / "root" / "Bad" / "groundtruth_rect.txt", [[1, 2, 30, 40]])
    out = tmp_path / "out"
    result = run("evaluate", tmp_path / "root", *PRESETS, "--seeds", 1, "--out", out)
    assert result.exit_code == 3
    (line,) = result.stderr.splitlines()
    assert line.startswith("skipped Bad: ")
    assert "labels 1 frames" in line
    assert (out / "index.html").is_file()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["evaluate", "nothing"], "nothing is not a folder"),
        (["evaluate", "."], "holds no sequences"),
        (["evaluate", "ROOT", "--presets", "best"], "'best' is not a preset"),
        (["evaluate", "ROOT", "--set", "selector=best"], "selector must be one of"),
        (["evaluate", "ROOT", "--sequences", "Bolt"], "Bolt not found"),
        (["evaluate", "ROOT", "--sequences", ""], "expected the name of a sequence"),
        (["evaluate", "ROOT", "--baselines", "TLD"], "'TLD' is not a baseline"),
        (["evaluate", "ROOT", "--peers", "MIL"], "--peers is now --baselines"),
        (["evaluate", "ROOT", "--seeds", "0"], "--seeds"),
        (["evaluate", "ROOT", "--protocol", "vot"], "--protocol"),
        (["evaluate", "ROOT", "--published", "."], "holds no CSV"),
        (["evaluate", "ROOT", "--published", "nothing"], "nothing is not a folder"),
        (["report", "nothing"], "nothing holds no results"),
    ],
)
def test_bad_arguments_are_one_line(root, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    result = run(*(root if argument == "ROOT" else argument for argument in arguments))
    assert result.exit_code == 2, result.output
    (line,) = result.stderr.splitlines()
    assert line.startswith("error: ")
    assert message in line
    assert not (tmp_path / "report").exists()


def test_a_missing_package_is_one_line(root, tmp_path, monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "matplotlib" else find(name)
    )
    for arguments in (["evaluate", root], ["report", tmp_path]):
        result = run(*arguments)
        assert result.exit_code == 2
        assert result.stderr == (
            "error: the page needs matplotlib: pip install 'dcs-jax[report]'\n"
        )


def test_ctrl_c_ends_cleanly_and_the_same_command_continues(tmp_path, start):
    """Interrupted in the second sequence, which is long enough for it."""
    write_otb(tmp_path / "root", "a-short", render(9, (120, 160), (36, 30)))
    write_otb(tmp_path / "root", "b-long", render(1500, (120, 160), (36, 30)))
    out = tmp_path / "out"
    options = [tmp_path / "root", *PRESETS, "--seeds", 4, "--out", out]
    code = "from dcs_jax.cli import app; app(prog_name='dcs-jax')"
    process = start([sys.executable, "-c", code, "evaluate", *options])
    deadline = time.monotonic() + 120
    while not list(out.glob("runs/a-short/*/ope.npz")) and time.monotonic() < deadline:
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    printed, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    assert errors == "interrupted: the same command continues from here\n"
    assert str(out / "index.html") in printed
    table = (out / "results.csv").read_text().splitlines()
    assert len(table) == 1 + 4
    assert not list(out.rglob(".*"))
    result = run("evaluate", *options, "--no-page")
    assert result.exit_code == 0, result.output
    assert "1 of 2 runs reused" in result.stdout
    assert len((out / "results.csv").read_text().splitlines()) == 1 + 8
