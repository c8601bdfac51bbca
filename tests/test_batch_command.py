"""`dcs-jax batch` as a user sees it: many targets in many videos, whatever happens."""

import csv
import importlib.util
import os
import re
import signal
import sys
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest
from data_sets import write_images, write_otb, write_video
from ffmpeg import write_plain
from typer.testing import CliRunner

import dcs_jax
from dcs_jax import formats
from dcs_jax.cli import app
from dcs_jax.io.frames import open_source
from dcs_jax.synthetic import render

# A setting that is compiled and run in a moment.
FIELDS: dict[str, Any] = {"canvas": 20, "parts": 5, "selectors": 6, "pool_size": 12}
SMALL = [word for name, value in FIELDS.items() for word in ("--set", f"{name}={value}")]
LENGTH = 70
SHAPE = (120, 160)
COMMAND = "from dcs_jax.cli import app; app(prog_name='dcs-jax')"


@pytest.fixture(scope="module")
def clip():
    return render(LENGTH, SHAPE, (36, 30))


@pytest.fixture(scope="module")
def videos(clip, tmp_path_factory):
    """card.avi and the folder toy/img, with frames of one shape, and flat, with smaller ones."""
    folder = tmp_path_factory.mktemp("videos")
    write_video(folder / "card.avi", clip)
    write_otb(folder, "toy", render(40, SHAPE, (30, 36)))
    write_otb(folder, "flat", render(20, (96, 160), (30, 36)))
    return folder


def row(source, box, start="", end="", id=""):
    text = ",".join(map(str, np.asarray(box).tolist()))
    return f'{source},"{text}",{start},{end},{id}'


def write_manifest(path, *rows):
    path.write_text("\n".join(["source,box,start,end,id", *rows, ""]))
    return path


@pytest.fixture
def manifest(videos, clip, tmp_path):
    """Five targets in three videos; those of card.avi have different ranges."""
    return write_manifest(
        tmp_path / "manifest.csv",
        row(videos / "card.avi", clip.boxes[0], id="card"),
        row(videos / "toy", (60, 40, 36, 30), id="toy"),
        row(videos / "card.avi", clip.boxes[41], 41, 60, id="late"),
        row(videos / "card.avi", clip.boxes[0] + [4, 2, 5, 3], 0, 50, id="other"),
        row(videos / "flat", (60, 40, 36, 30), id="flat"),
    )


def run(*arguments):
    return CliRunner().invoke(app, ["batch", *map(str, arguments)])


@pytest.fixture
def start_process(start):
    def start_process(*arguments, **environment):
        command = [sys.executable, "-c", COMMAND, "batch", *arguments]
        return start(command, env=os.environ | environment)

    return start_process


def rows_of(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def results(out):
    """The rows of every id in the index; all rows of the files belong to an id in it."""
    index = {entry["id"]: entry["file"] for entry in rows_of(out / "results.csv")}
    found: dict[str, list[list[float]]] = {}
    for name in set(index.values()):
        for entry in rows_of(out / name):
            assert index[entry["id"]] == name
            found.setdefault(entry["id"], []).append([float(v) for v in list(entry.values())[1:]])
    assert found.keys() == index.keys()
    assert {f"boxes/{path.name}" for path in (out / "boxes").iterdir()} == set(index.values())
    return {name: np.array(table) for name, table in found.items()}


def test_results_are_those_of_single_tracks(manifest, videos, clip, tmp_path):
    out = tmp_path / "out"
    result = run(manifest, "--out", out, "--seed", 3, *SMALL)
    assert result.exit_code == 0, result.output
    assert result.stderr == ""
    assert result.stdout == f"5 targets finished, boxes by {out / 'results.csv'}\n"
    assert not (out / "failed.csv").exists()
    found = results(out)
    for name, box, start, end in (
        ("card", clip.boxes[0], 0, LENGTH),
        ("late", clip.boxes[41], 41, 60),
        ("other", clip.boxes[0] + [4, 2, 5, 3], 0, 50),
    ):
        frames = open_source(videos / "card.avi", start, end)
        key, config = jax.random.key(3), dcs_jax.Config(**FIELDS)
        chunks = list(dcs_jax.track_stream(frames, box[None], key, config))
        np.testing.assert_array_equal(found[name][:, 0], np.arange(start, end))
        for columns, expected in (
            (found[name][:, 1:5], [chunk.track.boxes[0] for chunk in chunks]),
            (found[name][:, 5], [chunk.track.confidence[0] for chunk in chunks]),
        ):
            np.testing.assert_array_equal(columns.astype(np.float32), np.concatenate(expected))


def test_boxes_of_several_sizes_on_their_own_grid(videos, tmp_path):
    """Each size has a program of its own; the targets of a video still share its frames."""
    manifest = write_manifest(
        tmp_path / "manifest.csv",
        row(videos / "toy", (60, 40, 36, 30), end=20, id="a"),
        row(videos / "toy", (50, 40, 24, 20), end=20, id="b"),
    )
    options = (*SMALL, "--set", "canvas=native,parts=1")
    result = run(manifest, "--out", tmp_path / "out", *options)
    assert result.exit_code == 0, result.output
    assert {name: len(table) for name, table in results(tmp_path / "out").items()} == {
        "a": 20,
        "b": 20,
    }


def test_what_is_finished_is_skipped_and_what_has_changed_is_tracked_again(
    manifest, clip, tmp_path
):
    out = tmp_path / "out"
    assert run(manifest, "--out", out, *SMALL).exit_code == 0
    before = {path: path.stat().st_mtime_ns for path in (out / "boxes").iterdir()}
    again = run(manifest, "--out", out, *SMALL)
    assert again.exit_code == 0, again.output
    assert again.stdout.startswith("3 of 3 videos finished before\n5 targets finished")
    assert {path: path.stat().st_mtime_ns for path in (out / "boxes").iterdir()} == before

    # A row of one video: its box, its start, its end, its name.
    for old, new in (
        (",41,60,late", ",40,60,late"),
        (",40,60,late", ",40,59,late"),
        ("60,40,36,30", "61,40,36,30"),
        (",toy\n", ",doll\n"),
    ):
        manifest.write_text(manifest.read_text().replace(old, new, 1))
        changed = run(manifest, "--out", out, *SMALL)
        assert "2 of 3 videos finished before, 1 tracked again" in changed.stdout, changed.output
    found = results(out)
    assert found["late"][[0, -1], 0].tolist() == [40, 58]
    assert found["doll"][0, 1:5].tolist() == [61, 40, 36, 30]

    # A setting, or the seed: of all.
    for change in (["--set", "lam=0.5"], ["--seed", 1]):
        changed = run(manifest, "--out", out, *SMALL, *change)
        assert changed.stdout.startswith("3 tracked again"), changed.output
    assert len(results(out)) == 5


def test_files_of_boxes_in_another_format(manifest, videos, tmp_path):
    out = tmp_path / "out"
    assert run(manifest, "--out", out, *SMALL).exit_code == 0
    tables = results(out)
    for format in ("mot", "cvat", "yolo"):
        result = run(manifest, "--out", tmp_path / format, "--format", format, *SMALL)
        assert result.exit_code == 0, result.output
        index = {row["id"]: row["file"] for row in rows_of(tmp_path / format / "results.csv")}
        assert index.keys() == tables.keys()
        found = formats.read(tmp_path / format / index["toy"], format)
        (track,) = found.objects
        held = tables["toy"][:, 6] == 0
        np.testing.assert_allclose(track.boxes[0], tables["toy"][held][0, 1:5], atol=1e-3)
        again = run(manifest, "--out", tmp_path / format, "--format", format, *SMALL)
        assert "5 targets finished" in again.stdout


def test_names_of_any_length_and_encoding(clip, tmp_path):
    names = [os.fsencode("字" * 83) + b".mp4", b"vid\xe9o.mp4", b"2024-11-14T10:30:00.mp4"]
    write_plain(tmp_path / "plain.mp4", clip.frames[:5])
    rows = [b"source,box"]
    for name in names:
        path = os.fsencode(tmp_path) + b"/" + name
        with open(path, "wb") as file:
            file.write((tmp_path / "plain.mp4").read_bytes())
        rows.append(name + b',"%s"' % ",".join(map(str, clip.boxes[0].tolist())).encode())
    (tmp_path / "manifest.csv").write_bytes(b"\n".join(rows))
    result = run(tmp_path / "manifest.csv", "--out", tmp_path / "out", *SMALL)
    assert result.exit_code == 0, result.output
    files = list((tmp_path / "out" / "boxes").iterdir())
    assert len(files) == 3
    assert all(len(file.read_text().splitlines()) == 6 for file in files)
    assert b"vid\xe9o.mp4" in (tmp_path / "out" / "results.csv").read_bytes()
    again = run(tmp_path / "manifest.csv", "--out", tmp_path / "out", *SMALL)
    assert "3 targets finished" in again.stdout


def test_what_is_finished_is_in_the_index_after_sigkill(clip, tmp_path, start_process):
    """And the next run clears away what the killed one had begun, and finishes."""
    for number in range(12):
        write_plain(tmp_path / f"{number}.mp4", np.concatenate([clip.frames] * 2))
    rows = [row(f"{number}.mp4", clip.boxes[0], id=str(number)) for number in range(12)]
    manifest = write_manifest(tmp_path / "manifest.csv", *rows)
    out = tmp_path / "out"
    process = start_process(str(manifest), "--out", str(out), "--workers", "1", *SMALL)

    def finished():
        return len(rows_of(out / "results.csv")) if (out / "results.csv").exists() else 0

    wait_for(lambda: finished() >= 3, process)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    index = rows_of(out / "results.csv")
    assert 3 <= len(index) < 12
    assert {f"boxes/{p.name}" for p in (out / "boxes").glob("*.csv")} >= {r["file"] for r in index}
    (out / "boxes" / ".half.part").write_text("half")
    (out / "boxes" / ".folder.part" / "labels").mkdir(parents=True)
    result = run(manifest, "--out", out, *SMALL)
    assert result.exit_code == 0, result.output
    assert results(out).keys() == set(map(str, range(12)))
    assert not list(out.rglob("*.part"))


def test_a_folder_has_one_run(clip, tmp_path, start_process):
    write_plain(tmp_path / "long.mp4", np.concatenate([clip.frames] * 40))
    manifest = write_manifest(tmp_path / "manifest.csv", row("long.mp4", clip.boxes[0]))
    process = start_process(str(manifest), "--out", str(tmp_path / "out"), *SMALL)
    wait_for(lambda: (tmp_path / "out" / "results.csv").exists(), process)
    result = run(manifest, "--out", tmp_path / "out", "--seed", 3, *SMALL)
    process.send_signal(signal.SIGTERM)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "the same command continues" in errors
    assert result.exit_code == 2
    assert "is in use by another run" in result.stderr


def test_a_new_file_of_the_same_name_is_tracked_again(clip, tmp_path):
    write_video(tmp_path / "a.avi", clip)
    manifest = write_manifest(tmp_path / "manifest.csv", row("a.avi", clip.boxes[0], end=9))
    out = tmp_path / "out"
    assert run(manifest, "--out", out, *SMALL).exit_code == 0
    before = results(out)["1"]
    write_video(tmp_path / "a.avi", clip._replace(frames=clip.frames[::-1]))
    changed = run(manifest, "--out", out, *SMALL)
    assert changed.stdout.startswith("1 tracked again"), changed.output
    assert (results(out)["1"] != before).any()


def test_what_fails_is_tried_again_then_listed_and_the_rest_is_finished(videos, clip, tmp_path):
    whole = (videos / "card.avi").read_bytes()
    cut = tmp_path / "cut.avi"
    cut.write_bytes(whole[: len(whole) * 3 // 4])
    write_images(tmp_path / "torn", clip.frames[:3], ["0.png", "1.png", "2.png"])
    torn = (tmp_path / "torn" / "1.png").read_bytes()
    (tmp_path / "torn" / "1.png").write_bytes(torn[: len(torn) // 2])
    card = videos / "card.avi"
    manifest = write_manifest(
        tmp_path / "manifest.csv",
        row("gone.mp4", (1, 2, 30, 40), id="gone"),
        row("cut.avi", clip.boxes[0], id="cut"),
        row("torn", clip.boxes[0], id="torn"),
        row(card, (500, 2, 30, 40), id="outside"),
        row(card, clip.boxes[0], 0, 900, id="too long"),
        row(card, clip.boxes[0], 0, 9, id="good"),
    )
    out = tmp_path / "out"
    result = run(manifest, "--out", out, "--retries", 1, *SMALL)
    assert result.exit_code == 3, result.output
    assert result.stdout.splitlines()[0] == "tried again: 3"  # gone, cut and torn
    assert list(results(out)) == ["good"]
    failed = {entry["id"]: entry["reason"] for entry in rows_of(out / "failed.csv")}
    assert list(failed) == ["gone", "cut", "torn", "outside", "too long"]
    for name, message in (
        ("gone", "gone.mp4 does not exist"),
        ("cut", "cut.avi breaks off"),
        ("torn", "1.png (frame 1) is cut off"),
        ("outside", "is wholly outside"),
        ("too long", "the range is 0 to 900"),
    ):
        assert message in failed[name]
        assert f"failed {name}: {failed[name]}" in result.stderr.splitlines()

    # The one video with a good row is finished, though its bad rows are checked again; what has
    # been repaired is no longer listed.
    cut.write_bytes(whole)
    again = run(manifest, "--out", out, "--retries", 0, *SMALL)
    assert again.exit_code == 3, again.output
    assert again.stdout.startswith("1 of 4 videos finished before\n")
    assert set(results(out)) == {"cut", "good"}
    assert "cut" not in {entry["id"] for entry in rows_of(out / "failed.csv")}
    good = [line for line in manifest.read_text().splitlines() if "good" in line or "cut" in line]
    last = run(write_manifest(manifest, *good), "--out", out, *SMALL)
    assert last.exit_code == 0, last.output
    assert last.stdout.startswith("2 of 2 videos finished before\n")
    assert not (out / "failed.csv").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nothing.csv"], "nothing.csv: No such file"),
        (["wrong.csv"], "wrong.csv, line 2, column box is '1,2,3': expected four numbers x,y,w,h"),
        (["good.csv", "--set", "selector=best"], "selector must be one of"),
        (["good.csv", "--set", "speed=9"], "'speed=9' is not a change of a field"),
        (["good.csv", "--engine", "slurm"], "--engine"),
        (["good.csv", "--workers", "0"], "--workers"),
    ],
)
def test_bad_input_is_one_line(tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    write_manifest(tmp_path / "good.csv", row("a.mp4", (1, 2, 30, 40)))
    write_manifest(tmp_path / "wrong.csv", row("a.mp4", (1, 2, 3)))
    result = run(*arguments)
    assert result.exit_code == 2, result.output
    (line,) = result.stderr.splitlines()
    assert line.startswith("error: ")
    assert message in line
    assert not (tmp_path / "batch").exists()


def test_missing_ray_is_one_line(manifest, tmp_path, monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "ray" else find(name)
    )
    result = run(manifest, "--engine", "ray", "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert result.stderr == (
        "error: the engine ray needs the package ray: pip install 'dcs-jax[ray]'\n"
    )


def wait_for(condition, process, seconds=120):
    deadline = time.monotonic() + seconds
    while not (found := condition()):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline, "timed out"
        time.sleep(0.005)
    return found


def test_ctrl_c_ends_cleanly_and_the_same_command_continues(videos, tmp_path, start_process):
    """Interrupted in the second video, which is long enough for that."""
    write_video(tmp_path / "long.avi", render(1500, SHAPE, (36, 30)))
    manifest = write_manifest(
        tmp_path / "manifest.csv",
        row(videos / "toy", (60, 40, 36, 30), id="toy"),
        *(row("long.avi", (60 + n, 40, 36, 30), id=f"long{n}") for n in range(6)),
    )
    out = tmp_path / "out"
    process = start_process(manifest, "--out", out, "--workers", 2, *SMALL)
    wait_for(lambda: list((out / "boxes").glob("toy-*.csv")), process)
    process.send_signal(signal.SIGINT)
    printed, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    assert errors == "interrupted: the same command continues from here\n"
    assert printed == f"1 targets finished, boxes by {out / 'results.csv'}\n"
    assert list(results(out)) == ["toy"]  # and no temporary file is left
    again = run(manifest, "--out", out, *SMALL)
    assert again.exit_code == 0, again.output
    assert again.stdout.startswith("1 of 2 videos finished before\n")
    assert {name: len(table) for name, table in results(out).items()} == {
        "toy": 40,
        **{f"long{n}": 1500 for n in range(6)},
    }


def busy_workers(parent):
    """The processes below `parent` that run a task of Ray, by their titles."""
    parents, titles = {}, {}
    for path in Path("/proc").glob("[0-9]*"):
        try:
            status = (path / "stat").read_text()
            titles[int(path.name)] = (path / "cmdline").read_bytes()
        except OSError:
            continue  # it has ended
        parents[int(path.name)] = int(status.rpartition(")")[2].split()[1])

    def is_below(process):
        while process in parents and process != parent:
            process = parents[process]
        return process == parent

    return [
        n
        for n, title in titles.items()
        if title.startswith(b"ray::_values_and_frames") and is_below(n)
    ]


@pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="Ray is not installed")
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="the worker is looked up in /proc")
def test_a_killed_worker_loses_no_row_and_doubles_none(videos, clip, tmp_path, start_process):
    """Two workers of a local Ray cluster; one is killed while it tracks."""
    for n in range(8):
        (tmp_path / f"card{n}.avi").symlink_to(videos / "card.avi")
    rows = [
        row(f"card{n}.avi", clip.boxes[0] + [k, 0, 0, 0], id=f"{n} {k}")
        for n in range(8)
        for k in range(12)
    ]
    manifest = write_manifest(tmp_path / "manifest.csv", *rows, row("gone", (1, 2, 30, 40)))
    out = tmp_path / "out"
    options = ("--workers", 2, "--retries", 1, *SMALL)
    local = run(manifest, "--out", tmp_path / "local", *options)
    process = start_process(
        manifest, "--out", out, "--engine", "ray", *options, RAY_ADDRESS="local"
    )
    wait_for(lambda: list((out / "boxes").glob("card*.csv")), process)
    os.kill(wait_for(lambda: busy_workers(process.pid), process)[0], signal.SIGKILL)
    printed, errors = process.communicate(timeout=120)
    assert process.returncode == local.exit_code == 3, errors
    retried = re.search(r"tried again: (\d+)", printed)
    assert retried is not None
    assert int(retried[1]) >= 2, printed  # gone, and the killed
    (line,) = errors.splitlines()
    assert line.startswith("failed 97: ")
    assert line.endswith("gone does not exist: expected a video file or a folder of images")
    found, expected = results(out), results(tmp_path / "local")
    assert set(found) == {f"{n} {k}" for n in range(8) for k in range(12)}
    assert all(len(table) == LENGTH for table in found.values())
    for name, table in found.items():
        np.testing.assert_allclose(table, expected[name], atol=1e-3)
