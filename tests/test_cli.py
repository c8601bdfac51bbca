"""The command line as a user sees it: files, short results, one-line errors, exit codes."""

import os
import signal
import subprocess
import sys
import time

import cv2
import jax
import numpy as np
import pytest
from typer.testing import CliRunner

import dcs_jax
from dcs_jax.cli import app
from dcs_jax.compilation import cache
from dcs_jax.evaluation.metrics import mean_centre_error
from dcs_jax.io.frames import open_source
from dcs_jax.io.overlay import VideoWriter
from dcs_jax.synthetic import render

# Several chunks and a part of one, so that padding is exercised. The frames are as large as those
# of the demonstration, so that all tests share the same two compiled programs.
LENGTH = 70


def cache_directory():
    return jax.config.values["jax_compilation_cache_dir"]


def test_compiled_programs_are_kept_in_the_users_cache(monkeypatch, tmp_path):
    before = cache_directory()
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = cache()
    kept = cache_directory()
    jax.config.update("jax_compilation_cache_dir", before)
    assert kept == str(folder) == str(tmp_path / "dcs_jax")


def test_compiled_programs_are_kept_in_a_folder_of_ones_own(tmp_path):
    before = cache_directory()
    folder = cache(tmp_path)
    kept = cache_directory()
    jax.config.update("jax_compilation_cache_dir", before)
    assert kept == str(folder) == str(tmp_path)


def test_a_cache_that_is_set_is_kept():
    before = cache_directory()
    cache()
    assert cache_directory() == before


@pytest.fixture(scope="module")
def clip():
    return render(LENGTH, speed=3)


@pytest.fixture(scope="module")
def sequence(clip, tmp_path_factory):
    """NAME/img/*.png with NAME/groundtruth_rect.txt, whose first two frames are unlabelled."""
    folder = tmp_path_factory.mktemp("data") / "card"
    (folder / "img").mkdir(parents=True)
    for t, frame in enumerate(clip.frames):
        cv2.imwrite(str(folder / "img" / f"{t}.png"), cv2.cvtColor(frame, cv2.COLOR_RGB2BGR))
    truth = clip.boxes.astype(float)
    truth[:2] = np.nan
    np.savetxt(folder / "groundtruth_rect.txt", truth, fmt="%.4f", delimiter=",")
    return folder


@pytest.fixture(scope="module")
def video(clip, tmp_path_factory):
    path = tmp_path_factory.mktemp("data") / "card.avi"
    with VideoWriter(path, clip.frames[0].shape) as writer:
        for frame in clip.frames:
            writer.write(frame)
    return path


def run(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def command(*arguments):
    code = "from dcs_jax.cli import app; app(prog_name='dcs-jax')"
    return [sys.executable, "-c", code, *map(str, arguments)]


def run_process(*arguments, cwd):
    """As from a shell, both streams piped."""
    return subprocess.run(command(*arguments), cwd=cwd, capture_output=True, text=True, check=False)


def box_of(clip, t=0):
    return ",".join(map(str, clip.boxes[t]))


def read(path):
    return np.loadtxt(path, delimiter=",", skiprows=1)


def test_track_with_annotation_starts_at_the_first_label(sequence, clip, tmp_path):
    out, overlay = tmp_path / "boxes.csv", tmp_path / "out.mp4"
    result = run("track", sequence, "--out", out, "--overlay", overlay)
    assert result.exit_code == 0, result.output
    table = read(out)
    np.testing.assert_array_equal(table[:, 0], np.arange(2, LENGTH))
    np.testing.assert_allclose(table[0, 1:5], clip.boxes[2], atol=1e-3)
    error = mean_centre_error(table[:, 1:5], clip.boxes[2:])
    assert error < 6
    assert f"centre error {error:.1f} px" in result.stdout
    assert "(68 labelled frames)" in result.stdout
    assert result.stderr == ""
    assert open_source(overlay).length == LENGTH - 2


def test_track_gives_the_boxes_of_track_sequence(sequence, clip, tmp_path):
    """Chunks, padding and the file do not change the boxes."""
    out = tmp_path / "boxes.csv"
    arguments = ("track", sequence / "img", "--box", box_of(clip), "--seed", 3, "--out", out)
    result = run(*arguments)
    assert result.exit_code == 0, result.output
    track = dcs_jax.track_sequence(clip.frames, clip.boxes[0], key=jax.random.key(3))
    table = read(out)
    np.testing.assert_allclose(table[:, 1:5], track.boxes, atol=1e-3)
    np.testing.assert_allclose(table[:, 5], track.confidence, atol=1e-4)


def test_start_gives_frame_numbers_of_the_source(video, clip, tmp_path):
    out = tmp_path / "boxes.csv"
    result = run("track", video, "--box", box_of(clip, 4), "--start", 4, "--end", 69, "--out", out)
    assert result.exit_code == 0, result.output
    np.testing.assert_array_equal(read(out)[:, 0], np.arange(4, 69))


def test_broken_video_keeps_what_was_tracked(video, clip, tmp_path):
    cut = tmp_path / "cut.avi"
    whole = video.read_bytes()
    cut.write_bytes(whole[: len(whole) * 3 // 4])
    result = run_process("track", cut, "--box", box_of(clip), cwd=tmp_path)
    assert result.returncode == 3
    (line,) = result.stderr.splitlines()
    frames = read(tmp_path / "boxes.csv")[:, 0]
    assert 10 < len(frames) < LENGTH
    np.testing.assert_array_equal(frames, np.arange(len(frames)))
    assert f"frame {len(frames)} cannot be decoded" in line
    assert "boxes.csv" in line


def test_ctrl_c_keeps_what_was_tracked(clip, tmp_path, start):
    with VideoWriter(tmp_path / "long.avi", clip.frames[0].shape) as writer:
        for _ in range(30):
            for frame in clip.frames:
                writer.write(frame)
    out = tmp_path / "boxes.csv"
    process = start(command("track", tmp_path / "long.avi", "--box", box_of(clip), "--out", out))
    deadline = time.monotonic() + 120
    while not (out.exists() and len(out.read_text().splitlines()) > 34):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    printed, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert printed == ""
    tracked = len(read(out))
    assert 33 <= tracked < 30 * LENGTH
    assert errors == f"interrupted: {tracked} frames tracked, boxes in {out}\n"


@pytest.fixture
def bad(tmp_path, clip):
    """Bad sources, by name."""
    (tmp_path / "notes.txt").write_text("no video")
    (tmp_path / "empty").mkdir()
    for name in ("odd", "annotated"):
        (tmp_path / name).mkdir()
        for t in range(3):
            cv2.imwrite(str(tmp_path / name / f"{t}.png"), clip.frames[t])
    cv2.imwrite(str(tmp_path / "odd" / "2.png"), clip.frames[0, :-8])
    (tmp_path / "annotated" / "groundtruth_rect.txt").write_text("1,2,30,40\nnonsense\n")
    return tmp_path


@pytest.mark.parametrize(
    ("source", "box", "message"),
    [
        ("nothing", "1,2,30,40", "nothing does not exist"),
        ("notes.txt", "1,2,30,40", "notes.txt cannot be read as a video"),
        ("empty", "1,2,30,40", "empty holds no images"),
        ("odd", "1,2,30,40", "2.png has 320 x 232 pixels"),
        ("annotated", None, "groundtruth_rect.txt, line 2 is 'nonsense'"),
    ],
)
def test_bad_source(bad, source, box, message):
    out = bad / "boxes.csv"
    result = run("track", bad / source, *(["--box", box] if box else []), "--out", out)
    assert_one_line(result, message)
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--box", "1,2,3"], "--box is '1,2,3': expected four numbers"),
        (["--box", "a,b,c,d"], "--box is 'a,b,c,d'"),
        (["--box", "1,2,-30,40"], "positive width and height"),
        (["--box", "nan,2,30,40"], "finite numbers"),
        (["--box", "1,2,3,3"], "at least 4 pixels"),
        (["--box", "500,2,30,40"], "wholly outside"),
        (["--box", "-90,2,30,40"], "wholly outside"),
        (["--start", "70"], "has 70 frames, but the start is 70"),
        (["--end", "71"], "has 70 frames, but the range is 0 to 71"),
        (["--end", "2"], "no frame from 0 on is labelled"),
        (["--preset", "best"], "--preset"),
        (["--seed", "-1"], "--seed"),
        (["--overlay", "out.gif"], "out.gif must end in one of"),
        (["--overlay", "no/folder/out.mp4"], "out.mp4: No such file or directory"),
        (["--out", "no/folder/boxes.csv"], "No such file or directory"),
        (["--frames", "3"], "No such option"),
    ],
)
def test_bad_argument(sequence, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert_one_line(run("track", sequence, *arguments), message)
    assert not (tmp_path / "boxes.csv").exists()


def test_box_is_needed_without_annotation(video, tmp_path):
    result = run("track", video, "--out", tmp_path / "boxes.csv")
    assert_one_line(result, "--box is missing")


def test_annotation_of_another_length(sequence, tmp_path):
    (tmp_path / "img").symlink_to(sequence / "img")
    (tmp_path / "groundtruth_rect.txt").write_text("1,2,30,40\n" * 5)
    result = run("track", tmp_path, "--out", tmp_path / "boxes.csv")
    assert_one_line(result, "has 5 lines, but there are 70 images")


def test_the_source_is_never_overwritten(video, clip):
    before = video.read_bytes()
    for option in ("--out", "--overlay"):
        assert_one_line(run("track", video, "--box", box_of(clip), option, video), "is the source")
    assert video.read_bytes() == before


def assert_one_line(result, message):
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    assert line.startswith("error: ")
    assert message in line


def test_error_of_the_process_is_one_line(tmp_path):
    (tmp_path / "broken.avi").write_bytes(b"RIFF\x00\x00\x00\x00AVI LIST" + os.urandom(500))
    result = run_process("track", "broken.avi", "--box", "1,2,30,40", cwd=tmp_path)
    assert result.returncode == 2
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    assert line.startswith("error: broken.avi cannot be read as a video")


def test_version_and_help():
    assert run("--version").stdout == f"dcs-jax {dcs_jax.__version__}\n"
    for arguments in ([], ["--help"], ["track", "--help"], ["demo", "-h"]):
        result = run(*arguments)
        assert result.exit_code == 0
        assert "Usage" in result.stdout


def test_demo_writes_its_files_and_reports_them(tmp_path):
    result = run("demo", "--out", tmp_path / "demo")
    assert result.exit_code == 0, result.output
    for name in ("film-strip.png", "overlay.mp4", "boxes.csv"):
        assert str(tmp_path / "demo" / name) in result.stdout
    assert open_source(tmp_path / "demo" / "overlay.mp4").length == 150
    strip = cv2.imread(str(tmp_path / "demo" / "film-strip.png"))
    assert strip is not None
    assert strip.shape[1] == 1200
    assert len(read(tmp_path / "demo" / "boxes.csv")) == 150
    for measure in ("mean centre error", "success rate", "frames/s", "compiling"):
        assert measure in result.stdout
