"""`dcs-jax track` beyond one box: several objects, formats, states, streams, signals."""

import http.server
import os
import signal
import subprocess
import threading
import time
from typing import Any

import cv2
import numpy as np
import pytest
from ffmpeg import EXECUTABLE, ffmpeg, raw, write_plain
from test_cli import assert_one_line, command
from typer.testing import CliRunner

from dcs_jax import formats
from dcs_jax.cli import app
from dcs_jax.cli.outputs import Outputs
from dcs_jax.io.frames import open_source
from dcs_jax.io.live import StreamSource, open_stream
from dcs_jax.runners.stream import Chunk
from dcs_jax.synthetic import render
from dcs_jax.types import Track

LENGTH = 40
SMALL = ("--set", "canvas=20,parts=5,selectors=6,pool_size=12")


@pytest.fixture(scope="module")
def clip():
    return render(LENGTH, (120, 160), (40, 32), speed=3)


@pytest.fixture(scope="module")
def video(clip, tmp_path_factory):
    return write_plain(tmp_path_factory.mktemp("clip") / "clip.mp4", clip.frames)


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments, **options):
    return CliRunner().invoke(app, ["track", *map(str, arguments), *SMALL], **options)


def good(*arguments, **options):
    result = run(*arguments, **options)
    assert result.exit_code == 0, result.output
    return result


def text(box):
    return ",".join(map(str, box))


def read(path="boxes.csv"):
    """The tracks of a table by name."""
    return {track.name: track for track in formats.read(path).objects}


def test_several_named_objects_in_one_pass(video, clip, here):
    one, two = clip.boxes[0], clip.boxes[0] + np.float32(4)
    result = good(video, "--box", f"car={text(one)}", "--box", f"a man={text(two)}")
    assert result.stdout == f"{LENGTH} frames tracked, boxes in boxes.csv\n"
    assert (here / "boxes.csv").read_text().splitlines()[0].startswith("id,frame,x,y,w,h,conf")
    found = read()
    assert list(found) == ["car", "a man"]
    for name, box in (("car", one), ("a man", two)):
        good(video, "--box", text(box), "--out", "single.csv")
        (single,) = read("single.csv").values()
        np.testing.assert_allclose(found[name].boxes, single.boxes, atol=0.05)
        np.testing.assert_allclose(found[name].confidence, single.confidence, atol=0.01)


def test_objects_without_names_are_numbered(video, clip, here):
    good(video, "--box", text(clip.boxes[0]), "--box", text(clip.boxes[0] + 3), "--end", 3)
    assert list(read()) == ["1", "2"]


def test_boxes_of_a_file_start_where_they_are(video, clip, here):
    (here / "start.csv").write_text(
        "id,frame,x,y,w,h\n"
        + "".join(f"{name},{t},{text(clip.boxes[t])}\n" for name, t in (("a", 2), ("b", 11)))
    )
    good(video, "--boxes", "start.csv")
    found = read()
    assert {name: (track.start, track.end) for name, track in found.items()} == {
        "a": (2, LENGTH),
        "b": (11, LENGTH),
    }
    np.testing.assert_allclose(found["b"].boxes[0], clip.boxes[11], atol=1e-4)
    good(video, "--box", text(clip.boxes[11]), "--start", 11, "--out", "own.csv")
    np.testing.assert_allclose(found["b"].boxes, read("own.csv")["own"].boxes, atol=0.05)


@pytest.mark.parametrize("format", ["otb", "mot", "cvat", "coco", "yolo"])
def test_results_in_any_format(video, clip, here, format):
    options = (video, "--box", f"1={text(clip.boxes[0])}")
    good(*options)
    out = here / f"out{formats.FORMATS[format].suffix}"
    result = good(*options, "--out", out, "--format", format)
    assert str(out) in result.stdout
    (found,) = formats.read(out).objects
    (table,) = read().values()
    kept = table.visible
    np.testing.assert_allclose(found.boxes[kept], table.boxes[kept], atol=1e-3)


def test_the_suffix_says_the_format(video, clip, here):
    good(video, "--box", text(clip.boxes[0]), "--end", 3, "--out", "out.xml")
    assert formats.sniff(here / "out.xml") == "cvat"
    tracks = formats.read(here / "out.xml")
    assert (tracks.size, tracks.length) == ((160, 120), LENGTH)
    good(video, "--box", text(clip.boxes[0]), "--end", 3, "--format", "coco")
    assert formats.sniff(here / "boxes.json") == "coco"
    good(video, "--box", text(clip.boxes[0]), "--end", 3, "--format", "mot")
    assert formats.sniff(here / "boxes.txt") == "mot"


def test_a_track_goes_on_in_the_next_part(video, clip, here):
    boxes = ("--box", f"a={text(clip.boxes[0])}", "--box", f"b={text(clip.boxes[0] + 4)}")
    good(video, *boxes, "--out", "whole.csv")
    good(video, *boxes, "--end", 17, "--save", "track.npz", "--out", "first.csv")
    arguments = ("track", str(video), "--start", "17", "--resume", "track.npz")
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    for name, whole in read("whole.csv").items():
        parts = [read("first.csv")[name], read("boxes.csv")[name]]
        assert parts[1].start == 17
        joined = np.concatenate([part.boxes for part in parts])
        np.testing.assert_allclose(joined, whole.boxes, atol=0.01)


def test_an_overlay_of_several(video, clip, here):
    boxes = ("--box", f"a={text(clip.boxes[0])}", "--box", f"b={text(clip.boxes[0] + 4)}")
    good(video, *boxes, "--overlay", "out.mp4", "--max-frames", 6)
    plain = list(open_source(video, 0, 6))
    drawn = list(open_source("out.mp4"))
    assert len(drawn) == 6
    assert all(np.abs(a.astype(int) - b).max() > 80 for a, b in zip(plain, drawn, strict=True))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--box", "a=1,2,30,40", "--box", "a=5,6,30,40"], "the name 'a' is there twice"),
        (["--box", "=1,2,30,40"], "expected a name before the ="),
        (["--box", "a=1,2,30"], "--box is 'a=1,2,30': expected four numbers X,Y,W,H"),
        (["--boxes", "nothing.csv"], "nothing.csv"),
        (["--boxes", "empty.csv"], "empty.csv"),
        (["--box", "1,2,30,40", "--format", "best"], "--format is 'best': expected one of csv"),
        (["--box", "1,2,30,40", "--out", "a.mp4", "--overlay", "a.mp4"], "are the same file"),
        (["--box", "1,2,30,40", "--out", "a.npz", "--save", "a.npz"], "are the same file"),
        (["--resume", "nothing.npz"], "cannot be changed: nothing.npz has its own settings"),
        (["--box", "1,2,30,40", "--box", "5,6,30,40", "--out", "a.txt"], "would hold 2 objects"),
        (
            ["--box", "A=1,2,30,40", "--box", "a=5,6,30,40", "--out", "o", "--format", "otb"],
            "'a' and 'A' would be one file",
        ),
        (["--box", "a\x07=1,2,30,40", "--out", "a.xml"], "without control characters"),
        (["--box", "1,2,30,40", "--out", "full", "--format", "yolo"], "full is there already and"),
        (["--box", "1,2,30,40", "--out", "full", "--format", "otb"], "full is there already and"),
        (["--box", "1,2,30,40", "--raw", "10x10"], "--raw is for standard input and pipes"),
        (["--box", "1,2,30,40", "--max-frames", "0"], "--max-frames"),
    ],
)
def test_bad_arguments(video, here, arguments, message):
    (here / "empty.csv").write_text("")
    (here / "full" / "inner").mkdir(parents=True)
    assert_one_line(run(video, *arguments), message)
    assert not (here / "boxes.csv").exists()


def test_resuming_from_no_such_file(video, here):
    (here / "no.npz").write_bytes(b"nothing")
    result = CliRunner().invoke(app, ["track", str(video), "--resume", "no.npz"])
    assert_one_line(result, "no.npz is no file of dcs_jax.save")
    result = CliRunner().invoke(app, ["track", str(video), "--resume", "missing.npz"])
    assert_one_line(result, "missing.npz: No such file")


def folder_with_labels(path, clip, labels):
    (path / "img").mkdir(parents=True)
    for t in range(4):
        image = cv2.cvtColor(clip.frames[t], cv2.COLOR_RGB2BGR)
        cv2.imwrite(str(path / "img" / f"{t}.png"), image)
    (path / "groundtruth_rect.txt").write_text(labels)
    return path


@pytest.mark.parametrize(
    ("labels", "message"),
    [
        ("1,2,30,40\n" * 3, "has 3 lines, but there are 4 images"),
        ("1,2,30,40,5,6,7,8\n" * 4, "line 1"),
        ("nothing\n" * 4, "line 1 is 'nothing'"),
        ("", "is empty"),
    ],
)
def test_labels_that_cannot_be_used_are_a_warning_where_there_is_a_box(clip, here, labels, message):
    folder = folder_with_labels(here / "data", clip, labels)
    result = good(folder, "--box", text(clip.boxes[0]))
    (line,) = result.stderr.splitlines()
    assert line.startswith("warning: labels are not used: ")
    assert message in line
    assert_one_line(run(folder), message)


@pytest.mark.parametrize("nothing", ["0,0,0,0", "1,1,-1,-1", "NaN,NaN,NaN,NaN"])
def test_labels_of_absence_are_none(clip, here, nothing):
    labels = f"{nothing}\n{text(clip.boxes[1])}\n{nothing}\n{text(clip.boxes[3])}\n"
    result = good(folder_with_labels(here / "data", clip, labels))
    assert "(2 labelled frames)" in result.stdout
    assert read()["boxes"].start == 1


@pytest.fixture
def long(clip, tmp_path):
    return write_plain(tmp_path / "long.mp4", np.concatenate([clip.frames] * 40))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("format", ["csv", "mot"])
def test_a_signal_keeps_what_was_tracked(long, clip, here, start, number, format):
    """In the table, in a file of another format, in the overlay, and to go on from."""
    box = ("--box", f"1={text(clip.boxes[0])}")
    outputs = ("--out", "out.txt", "--format", format, "--overlay", "out.mkv", "--save", "s.npz")
    process = start(command("track", long, *box, *outputs, *SMALL), cwd=here)
    deadline = time.monotonic() + 120
    while not (here / "out.mkv").exists() or (here / "out.mkv").stat().st_size < 30_000:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.01)
    process.send_signal(number)
    printed, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    assert printed == ""
    (track,) = formats.read(here / "out.txt", format).objects
    tracked = track.end
    assert errors == f"interrupted: {tracked} frames tracked, boxes in out.txt\n"
    assert 0 < tracked < 40 * LENGTH
    assert len(list(open_source(here / "out.mkv"))) == tracked
    assert not list(here.glob(".*.part"))
    arguments = ["track", str(long), "--resume", "s.npz", "--start", str(tracked)]
    result = CliRunner().invoke(app, [*arguments, "--max-frames", "2"])
    assert result.exit_code == 0, result.output


def test_two_runs_do_not_write_one_table(long, clip, here, start):
    box = ("--box", text(clip.boxes[0]))
    process = start(command("track", long, *box, *SMALL), cwd=here)
    deadline = time.monotonic() + 120
    while not (here / "boxes.csv").exists():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.01)
    result = run(long, *box)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=60)
    assert_one_line(result, "boxes.csv is being written by another run")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no disk that is always full")
@pytest.mark.parametrize("option", ["--out", "--overlay"])
def test_a_full_disk_is_said(video, clip, here, option):
    name = {"--out": "full.csv", "--overlay": "full.mp4"}[option]
    (here / name).symlink_to("/dev/full")
    result = run(video, "--box", text(clip.boxes[0]), option, name)
    assert_one_line(result, "No space left on device")
    if option == "--overlay":
        assert len((here / "boxes.csv").read_text().splitlines()) > 1


def test_without_a_home(video, clip, here, start):
    environment = {k: v for k, v in os.environ.items() if k not in ("HOME", "XDG_CACHE_HOME")}
    process = start(
        command("track", video, "--box", text(clip.boxes[0]), "--end", 3, *SMALL),
        cwd=here,
        env=environment,
    )
    printed, errors = process.communicate(timeout=120)
    assert (printed, errors) == ("3 frames tracked, boxes in boxes.csv\n", "")


# Streams


def piped(clip, *codec):
    """What ffmpeg makes of the clip, as bytes."""
    frames = np.ascontiguousarray(clip.frames)
    arguments = [EXECUTABLE, "-v", "error", *map(str, [*raw(frames), *codec]), "-"]
    return subprocess.run(arguments, input=frames.tobytes(), check=True, capture_output=True).stdout


def tracked_like(path, expected):
    (track,) = read(path).values()
    assert len(track.boxes) == len(expected.boxes)
    # While something passes in front the box is a guess, which depends on the compression.
    seen = expected.confidence > 0.5
    assert seen.mean() > 0.8
    np.testing.assert_allclose(track.boxes[seen], expected.boxes[seen], atol=2)


@pytest.fixture(scope="module")
def expected(video, clip, tmp_path_factory):
    out = tmp_path_factory.mktemp("expected") / "boxes.csv"
    good(video, "--box", text(clip.boxes[0]), "--out", out)
    (track,) = read(out).values()
    return track


@pytest.mark.parametrize(
    ("codec", "options"),
    [
        (("-c:v", "libx264", "-crf", 8, "-f", "mpegts"), ()),
        (("-c:v", "ffv1", "-f", "matroska"), ()),
        (("-pix_fmt", "yuv444p", "-f", "yuv4mpegpipe"), ()),
        (("-f", "rawvideo", "-pix_fmt", "rgb24"), ("--raw", "160x120")),
        (("-f", "rawvideo", "-pix_fmt", "yuv420p"), ("--raw", "160x120:yuv420p")),
    ],
    ids=["mpegts", "matroska", "y4m", "rgb", "yuv"],
)
def test_standard_input(clip, expected, here, start, codec, options):
    box = ("--box", text(clip.boxes[0]))
    process = start(
        command("track", "-", *box, *options, *SMALL),
        stdin=subprocess.PIPE,
        text=False,
        cwd=here,
    )
    printed, errors = process.communicate(piped(clip, *codec), timeout=120)
    assert process.returncode == 0, errors
    assert printed.decode() == f"{LENGTH} frames tracked, boxes in boxes.csv\n"
    tracked_like("boxes.csv", expected)


def test_a_named_pipe_is_opened_once(clip, expected, here):
    os.mkfifo(here / "pipe")
    content = piped(clip, "-c:v", "libx264", "-crf", 8, "-f", "mpegts")
    writer = threading.Thread(target=lambda: (here / "pipe").write_bytes(content))
    writer.start()
    good("pipe", "--box", text(clip.boxes[0]))
    writer.join()
    tracked_like("boxes.csv", expected)


PORT = 18_400 + os.getpid() % 1000


def test_a_server_is_read_to_its_end(video, clip, expected, here, start):
    """Nothing is dropped: it waits for its reader."""
    address = f"http://127.0.0.1:{PORT}"
    serve = ("-i", video, "-c", "copy", "-f", "mpegts", "-listen", 1, address)
    start([EXECUTABLE, "-v", "error", *serve])
    time.sleep(1)
    good(address, "--box", text(clip.boxes[0]))
    tracked_like("boxes.csv", expected)


def test_a_server_that_hangs_up_too_early(video, clip, here):
    """What has come is tracked, also what the decoder still held, and the error is said."""
    sent = video.with_suffix(".ts")
    ffmpeg("-i", video, "-c", "copy", sent)

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Length", str(sent.stat().st_size + 1000))
            self.end_headers()
            self.wfile.write(sent.read_bytes())

        def log_message(self, *arguments):
            pass

    with http.server.HTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{server.server_port}"
        result = run(address, "--box", text(clip.boxes[0]))
        server.shutdown()
    assert result.exit_code == 3
    assert f"breaks off after {LENGTH} frames" in result.stderr
    assert len(np.loadtxt("boxes.csv", delimiter=",", skiprows=1)) == LENGTH


def send(start, video, port, loops):
    """Have ffmpeg send the clip in real time, so often."""
    codec = ("-c:v", "libx264", "-g", 5, "-tune", "zerolatency", "-f", "mpegts")
    source = ("-re", "-stream_loop", loops - 1, "-i", video)
    return start([EXECUTABLE, "-v", "error", *source, *codec, f"udp://127.0.0.1:{port}"])


def test_a_stream_ends_after_so_many_frames(video, clip, here, start):
    send(start, video, PORT + 1, 30)
    address = f"udp://127.0.0.1:{PORT + 1}"
    result = good(address, "--box", text(clip.boxes[0]), "--max-frames", 20, "--overlay", "o.mkv")
    assert result.stdout.startswith("20 frames tracked")
    frames = np.loadtxt("boxes.csv", delimiter=",", skiprows=1)[:, 0]
    assert len(frames) == 20
    assert frames[0] == 0
    assert (np.diff(frames) >= 1).all()
    assert len(list(open_source("o.mkv"))) == 20


def test_a_stream_that_stops_says_so_after_its_frames(video, start):
    process = send(start, video, PORT + 2, 2)
    source = open_stream(f"udp://127.0.0.1:{PORT + 2}", patience=2)
    taken: list[np.ndarray] = []
    with pytest.raises(ValueError, match=r"breaks off after \d+ frames: no .* for 2 s"):
        taken.extend(source)
    assert len(taken) > 5
    assert process.wait(10) == 0


class Gaps(StreamSource):
    """A camera of which the second and third frame were dropped."""

    live, shape, fps = True, (120, 160, 3), 25.0

    def __init__(self):
        super().__init__("gaps", None, 1)
        self.positions.extend((0, 3, 4))

    def _arrive(self):
        raise NotImplementedError


@pytest.mark.parametrize("format", ["csv", "mot", "cvat", "otb"])
def test_frames_that_a_camera_dropped_have_no_box_in_any_format(here, format):
    boxes = np.arange(12, dtype=np.float32).reshape(1, 3, 4) + 5
    sure, lost = np.ones((1, 3), np.float32), np.zeros((1, 3), bool)
    track: Any = Track(boxes, sure, sure, sure[..., None], lost, sure[..., None])
    chunk = Chunk(0, np.zeros((3, 120, 160, 3), np.uint8), track, np.ones(1, bool))
    out = here / f"out{formats.FORMATS[format].suffix}"
    with Outputs(Gaps(), ["1"], out, format, None, None) as outputs:
        outputs.write(chunk)
    assert outputs.count == 3
    (found,) = formats.read(out, format).objects
    shown = found.start + np.flatnonzero(found.visible)
    np.testing.assert_array_equal(shown, [0, 3, 4])
    np.testing.assert_allclose(found.boxes[found.visible], boxes[0], atol=1e-3)


def test_a_stream_without_data_is_named():
    with pytest.raises(ValueError, match=r"udp://127\.0\.0\.1:\d+ .*no data for 1 s"):
        open_stream(f"udp://127.0.0.1:{PORT + 4}", patience=1)


def test_late_frames_are_dropped_and_counted(video, start):
    send(start, video, PORT + 3, 30)
    source = open_stream(f"udp://127.0.0.1:{PORT + 3}", most=6)
    started = time.monotonic()
    for _ in source:
        time.sleep(0.4)  # ten frames come meanwhile
    # Six frames of a stream that waited would be as many frames later, not as many seconds.
    behind = (time.monotonic() - started) * 25 - source.positions[-1]
    assert source.dropped > 25
    assert list(np.diff(source.positions) > 4) == [True] * 5
    assert behind < 20
    with pytest.raises(ValueError, match="can be read once only"):
        next(iter(source))


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("97", "camera 97 cannot be opened"),
        ("http://127.0.0.1:9/a", "cannot be read as a video (Connection refused)"),
        ("nonsense://a", "cannot be read as a video (Protocol not found)"),
    ],
)
def test_streams_that_are_not_there(here, source, message):
    assert_one_line(run(source, "--box", "1,2,30,40"), message)


def test_a_stream_starts_when_it_does(here):
    assert_one_line(run("rtsp://a", "--box", "1,2,30,40", "--start", 3), "which starts at 0")
