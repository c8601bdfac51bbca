"""dcs_jax behind the interfaces of other software: the same boxes as its own."""

import io
import subprocess
import sys

import cv2
import numpy as np
import pytest
from data_sets import write_otb
from settings import SMALL_DEFAULT

import dcs_jax
from dcs_jax.adapters import trax
from dcs_jax.synthetic import render

LENGTH = 6


@pytest.fixture(scope="module")
def clip():
    return render(LENGTH, (120, 160), (40, 32), speed=4)


@pytest.fixture(scope="module")
def images(clip, tmp_path_factory):
    """Without loss, in a folder whose name has to be quoted."""
    folder = tmp_path_factory.mktemp('a "b" c')
    for t, frame in enumerate(clip.frames):
        cv2.imwrite(str(folder / f"{t}.png"), cv2.cvtColor(frame, cv2.COLOR_RGB2BGR))
    return [folder / f"{t}.png" for t in range(LENGTH)]


@pytest.fixture(scope="module")
def boxes(clip):
    tracker = dcs_jax.Tracker(SMALL_DEFAULT)
    tracker.init(clip.frames[0], clip.boxes[0])
    return [tracker.result.box] + [tracker.update(frame)[1] for frame in clip.frames[1:]]


def test_got10k_runs_and_reports(clip, tmp_path):
    experiments = pytest.importorskip("got10k.experiments.otb")
    from dcs_jax.adapters.got10k import GOT10kTracker

    # It downloads each sequence that has no folder; those without an annotation it leaves out.
    for name in experiments.OTB._OTB__version_dict[2013]:
        (tmp_path / "data" / name).mkdir(parents=True)
    write_otb(tmp_path / "data", "Deer", clip)
    write_otb(tmp_path / "data", "Boy", clip)
    experiment = experiments.ExperimentOTB(
        str(tmp_path / "data"), 2013, str(tmp_path / "results"), str(tmp_path / "reports")
    )
    experiment.run(GOT10kTracker("small", SMALL_DEFAULT))
    results = tmp_path / "results" / "OTB2013" / "small"
    found = [np.loadtxt(results / f"{name}.txt", delimiter=",") for name in ("Deer", "Boy")]
    np.testing.assert_array_equal(found[0], found[1])
    tracker = dcs_jax.Tracker(SMALL_DEFAULT)
    decoded = [
        cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB)
        for path in sorted((tmp_path / "data" / "Deer" / "img").iterdir())
    ]
    tracker.init(decoded[0], clip.boxes[0])
    for frame, box in zip(decoded[1:], found[0][1:], strict=True):
        # The file has three digits, and PIL and OpenCV may decode a JPEG in different ways.
        np.testing.assert_allclose(tracker.update(frame)[1], box, atol=0.5)


def region(box):
    return ",".join(map(str, np.asarray(box).tolist()))


def quoted(path):
    return '"file://' + str(path).replace('"', '\\"') + '"'


def talk(*messages):
    """What the server says to these messages."""
    out = io.StringIO()
    tracker = dcs_jax.Tracker(SMALL_DEFAULT, order="bgr")
    try:
        trax.serve(tracker, [f"{message}\n" for message in messages], out)
    except ValueError:
        assert "@@TRAX:quit" in out.getvalue()
    return out.getvalue().splitlines()


def test_trax_states_are_the_boxes_of_the_tracker(clip, images, boxes):
    frames = [f"@@TRAX:frame {quoted(path)}" for path in images[1:]]
    start = f"@@TRAX:initialize {quoted(images[0])} {region(clip.boxes[0])} a.property=3"
    # A client may start again, and its own output is between the messages.
    hello, *states = talk(start, *frames, "noise", start, frames[0], "@@TRAX:quit", frames[1])
    assert hello.startswith('@@TRAX:hello "trax.version=1"')
    found = []
    for state in states:
        name, arguments = trax.parse(state)
        assert (name, len(arguments)) == ("state", 2)
        assert 0 <= float(arguments[1].removeprefix("confidence=")) <= 1
        found.append([float(side) for side in arguments[0].split(",")])
    np.testing.assert_allclose(found, boxes + boxes[:2], atol=1e-3)


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        ("@@TRAX:frame", "frame with 0 arguments: expected initialize with an image"),
        ("@@TRAX:hello", "hello with 0 arguments"),
        ('@@TRAX:frame "a', "cannot be read"),
        ("@@TRAX:initialize /none.png 1,2,3,4", "/none.png cannot be read as an image"),
        ("@@TRAX:initialize IMAGE 1,2,3", "region is '1,2,3': expected a rectangle"),
        ("@@TRAX:initialize IMAGE 1,2,3,0", "box must have a positive width"),
        ("@@TRAX:frame IMAGE", "the tracker has no track"),
    ],
)
def test_trax_says_why_it_ends(images, message, reason):
    _, answer = talk(message.replace("IMAGE", quoted(images[0])), "@@TRAX:frame")
    name, (argument,) = trax.parse(answer)
    assert name == "quit"
    assert argument.startswith("trax.reason=")
    assert reason in argument


@pytest.mark.parametrize(
    ("line", "arguments"),
    [
        ("@@TRAX:frame a b\n", ["a", "b"]),
        ('@@TRAX:frame "a b" "c=\\"d\\\\e\\nf"\r\n', ["a b", 'c="d\\e\nf']),
        ("@@TRAX:frame\n", []),
        ('@@TRAX:frame "" x\n', ["", "x"]),
    ],
)
def test_trax_arguments(line, arguments):
    assert trax.parse(line) == ("frame", arguments)


def test_trax_over_pipes(start):
    """Nothing but messages is on the standard output, and the end of the input is the end."""
    command = [sys.executable, "-m", "dcs_jax.adapters.trax"]
    server = start(command, stdin=subprocess.PIPE)
    assert server.stdout.readline().startswith("@@TRAX:hello ")
    server.stdin.write("@@TRAX:initialize /none.png 1,2,3,4\n")
    server.stdin.flush()
    expected = '@@TRAX:quit "trax.reason=/none.png cannot be read as an image"\n'
    assert server.stdout.readline() == expected
    server.stdin.close()
    assert server.wait(timeout=60) == 1
    assert server.stderr.read().endswith("error: /none.png cannot be read as an image\n")
