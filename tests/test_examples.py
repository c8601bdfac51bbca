"""The examples run, on rendered input, and do what they say."""

import json
import runpy
from pathlib import Path

import numpy as np
import pytest
from ffmpeg import write_plain
from settings import SMALL_DEFAULT

from dcs_jax.synthetic import render

EXAMPLES = Path(__file__).parents[1] / "examples"


def main_of(name):
    return runpy.run_path(str(EXAMPLES / f"{name}.py"))["main"]


def test_first_track(capsys):
    assert main_of("first_track")(SMALL_DEFAULT, 40) > 0.8
    assert "success" in capsys.readouterr().out


def test_live_camera(tmp_path, capsys):
    clip = render(12)
    video = write_plain(tmp_path / "clip.mp4", clip.frames)
    assert main_of("live_camera")(str(video), clip.boxes[0].tolist(), SMALL_DEFAULT) == 12
    assert len(capsys.readouterr().out.splitlines()) == 11


def test_batch_videos(tmp_path):
    clip = render(12)
    write_plain(tmp_path / "clip.mp4", clip.frames)
    box = ",".join(f"{side:g}" for side in clip.boxes[0])
    manifest = tmp_path / "manifest.csv"
    manifest.write_text(f'source,box\nclip.mp4,"{box}"\ngone.mp4,"{box}"\n')
    assert main_of("batch_videos")(manifest, tmp_path / "out", SMALL_DEFAULT) == 1
    assert len(list((tmp_path / "out" / "boxes").iterdir())) == 1


def test_select_noisy_labels():
    assert main_of("select_noisy_labels")() >= 0.75


def test_sweep_seeds():
    by_seed, by_prior = main_of("sweep_seeds")(SMALL_DEFAULT, 3, 20)
    assert len(by_seed) == len(by_prior) == 3
    assert np.all(np.array(by_seed + by_prior) < 20)


def test_the_notebook(capsys):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    notebook = json.loads((EXAMPLES / "look_at_a_track.ipynb").read_text())
    known: dict[str, object] = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            assert not cell["outputs"]  # they would be pictures in the repository
            exec("".join(cell["source"]), known)
    overlaps = known["overlaps"]
    assert isinstance(overlaps, np.ndarray)
    assert (overlaps.mean(1) > 0.8).all()
    assert "each seed" in capsys.readouterr().out
