"""The commands `dcs-jax label` and `dcs-jax export`, as they are called."""

import re
import signal
import socket
import sys
import urllib.request

import pytest
from ffmpeg import ffmpeg, raw, write_plain

from dcs_jax import formats
from dcs_jax.annotate import Editor, Project, fingerprint, save
from dcs_jax.synthetic import render

COMMAND = [sys.executable, "-c", "from dcs_jax.cli import app; app()"]
LENGTH = 20


@pytest.fixture(scope="module")
def frames():
    return render(LENGTH, (96, 128), (40, 32), seed=2).frames


@pytest.fixture
def clip(frames, tmp_path):
    return write_plain(tmp_path / "clip.mp4", frames)


@pytest.fixture
def failing(start):
    def failing(*arguments):
        process = start([*COMMAND, *arguments])
        _, errors = process.communicate(timeout=60)
        assert process.returncode == 2
        assert errors.count("\n") == 1, errors
        return errors

    return failing


def test_the_address_opens_the_page_and_ctrl_c_ends_it(start, clip):
    process = start([*COMMAND, "label", clip, "--no-browser", "--set", "canvas=20,parts=5"])
    line = process.stdout.readline()
    address = re.search(r"http://127\.0\.0\.1:\d+/\?token=\S+", line)
    assert address, line
    opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
    assert b"dcs-jax label" in opener.open(address.group()).read()
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=20)
    assert process.returncode == 0


def test_a_port_that_is_taken(failing, clip):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        says = failing("label", clip, "--no-browser", "--port", port)
    assert f"127.0.0.1:{port} cannot be listened on" in says


def test_a_project_that_another_server_has(start, failing, clip):
    process = start([*COMMAND, "label", clip, "--no-browser"])
    assert "http://" in process.stdout.readline()
    assert "is open in another dcs-jax label" in failing("label", clip, "--no-browser")
    process.kill()  # which lets it go
    process.wait()
    process = start([*COMMAND, "label", clip, "--no-browser"])
    assert "http://" in process.stdout.readline()


def test_what_another_host_means_is_said(start, clip):
    process = start([*COMMAND, "label", clip, "--no-browser", "--host", "0.0.0.0"])
    assert "can be reached from other machines" in process.stderr.readline()


def test_a_clip_that_is_gone(failing, tmp_path):
    assert "does not exist" in failing("label", tmp_path / "gone.mp4", "--no-browser")


def test_boxes_that_are_none(failing, clip, tmp_path):
    (tmp_path / "boxes.csv").write_text("no boxes at all\n")
    says = failing("label", clip, "--no-browser", "--boxes", tmp_path / "boxes.csv")
    assert "boxes.csv" in says


def test_what_a_clip_that_breaks_off_has_can_be_labelled(start, frames, tmp_path):
    path = tmp_path / "clip.mkv"
    ffmpeg(*raw(frames), "-c:v", "libx264", "-g", 5, path, frames=frames)
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 6 // 10])
    process = start([*COMMAND, "label", path, "--no-browser"])
    assert re.search(r"breaks off: its \d+ frames can be labelled", process.stderr.readline())
    assert "http://" in process.stdout.readline()


@pytest.fixture
def project(clip):
    editor = Editor(Project(str(clip), fingerprint(clip), (128, 96), LENGTH, 25.0))
    editor.add_object(0, (10, 10, 40, 30), "one")
    editor.add_object(5, (20, 10, 40, 30), "two")
    save(clip.with_name("clip.mp4.dcs.json"), editor.project)
    return clip.with_name("clip.mp4.dcs.json")


@pytest.mark.parametrize("format", formats.NAMES)
def test_a_project_is_exported(start, project, format):
    process = start([*COMMAND, "export", project, "--format", format])
    output, errors = process.communicate(timeout=60)
    assert process.returncode == 0, errors
    path = re.fullmatch(rf"2 objects in (\S+) \({format}\)\n", output)
    assert path, output
    assert len(formats.read(path.group(1), format).objects) == 2


def test_an_export_to_a_place_that_is_given(start, project, tmp_path):
    out = tmp_path / "out.xml"
    process = start([*COMMAND, "export", project, "--format", "cvat", "--out", out])
    process.communicate(timeout=60)
    assert {track.name for track in formats.read(out).objects} == {"one", "two"}


def test_exports_that_cannot_be(failing, project, tmp_path):
    assert "format must be one of" in failing("export", project, "--format", "docx")
    assert "would be overwritten" in failing("export", project, "--format", "csv", "--out", project)
    project.write_bytes(project.read_bytes()[:-30])
    assert "cut short" in failing("export", project, "--format", "csv")
    assert "gone.json" in failing("export", tmp_path / "gone.json", "--format", "csv")
