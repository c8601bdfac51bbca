"""How well are sequences tracked that are made harder: faster, backward, turning, changing shape?

    python -m benchmarks.harder ROOT... --settings 'default,default prior=0.3' --seeds 3

ROOT is a folder of sequences as for `dcs-jax evaluate`. What is tuned on a few sequences is tuned
for them; here are six clips of each that are unlike it. With them `verification.learn_above`,
`translation.first_frame`, `rotation.gain_above` and the settings of `aspect` were chosen:

    second, third      every second or third frame: it moves and changes faster
    backward           from the last label to the first, and every second frame of that
    turning            the picture turns by 1.5 degrees a frame, of 240 frames at most
    narrowing          it is squeezed to 0.45 of its width and back within 120 frames, of 240

The box of an object that turns is that of the ellipse in its own box. Prints Markdown: mean success
AUC by kind and over all, the difference to the first setting with its standard error over clips,
and what the confidence was where the overlap was small.
"""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.annotator import entries
from benchmarks.reliability import RIGHT, failure_auc
from dcs_jax.compilation import cache
from dcs_jax.config import Config
from dcs_jax.evaluation.metrics import overlap, success_curve
from dcs_jax.evaluation.runner import run_seeds
from dcs_jax.evaluation.settings import parse_setting

FRAMES = 240  # of a clip whose picture is changed
DEGREES = 1.5  # by which it turns in a frame
NARROWEST, PERIOD = 0.45, 120  # share of the width, and frames until it is whole again
FAR, SURE = 0.3, 0.5  # overlap below which a box is elsewhere, and confidence from which it is sure


class Clip(NamedTuple):
    """frames: [T, H, W, 3] uint8. truth: [T, 4], x, y, w, h in pixels, NaN where unlabelled."""

    frames: NDArray[np.uint8]
    truth: NDArray[np.float64]

    def part(self, frames: slice) -> "Clip":
        return Clip(np.ascontiguousarray(self.frames[frames]), self.truth[frames])


class Result(NamedTuple):
    """Of one clip: success AUC, mean over the seeds; overlap and confidence of labelled boxes."""

    auc: float
    overlaps: NDArray[np.float64]
    confidence: NDArray[np.float64]


def backward(clip: Clip, every: int = 1) -> Clip:
    """The clip from its last label to its first frame."""
    last = int(np.flatnonzero(np.isfinite(clip.truth[:, 0]))[-1])
    return clip.part(slice(last, None, -every))


def turning(clip: Clip) -> Clip:
    """The picture turns around its middle; an object whose centre leaves it has no label."""
    frames, truth = clip.part(slice(FRAMES))
    height, width = frames.shape[1:3]
    angles = DEGREES * np.arange(len(frames))
    middle = width / 2, height / 2
    maps = [np.asarray(cv2.getRotationMatrix2D(middle, a, 1.0), np.float64) for a in angles]
    cos, sin = np.cos(np.deg2rad(angles)), np.sin(np.deg2rad(angles))
    w, h = truth[:, 2:].T
    sides = np.stack([np.hypot(w * cos, h * sin), np.hypot(w * sin, h * cos)], 1)
    centres = truth[:, :2] + truth[:, 2:] / 2
    centres = np.array([m[:, :2] @ c + m[:, 2] for m, c in zip(maps, centres, strict=True)])
    seen = ((centres >= 0) & (centres <= [width, height])).all(1, keepdims=True)
    boxes = np.concatenate([centres - sides / 2, sides], 1)
    return Clip(_warped(frames, maps), np.where(seen, boxes, np.nan))


def narrowing(clip: Clip) -> Clip:
    """The picture is squeezed towards its middle column, and widens again."""
    frames, truth = clip.part(slice(FRAMES))
    middle = frames.shape[2] / 2
    waves = (1 + np.cos(2 * np.pi * np.arange(len(frames)) / PERIOD)) / 2
    shares = NARROWEST + (1 - NARROWEST) * waves
    maps = [np.array([[share, 0, middle * (1 - share)], [0, 1.0, 0]]) for share in shares]
    boxes = truth.copy()
    boxes[:, 0] = middle + shares * (truth[:, 0] - middle)
    boxes[:, 2] *= shares
    return Clip(_warped(frames, maps), boxes)


def _warped(frames: NDArray[np.uint8], maps: list[NDArray[np.float64]]) -> NDArray[np.uint8]:
    """Each frame by its map [2, 3]; what comes in from outside is as the edge."""
    size = frames.shape[2], frames.shape[1]
    edge = cv2.BORDER_REPLICATE
    warped = [
        cv2.warpAffine(frame, by, size, borderMode=edge)
        for frame, by in zip(frames, maps, strict=True)
    ]
    return np.stack(warped).astype(np.uint8)


CHANGES: dict[str, Callable[[Clip], Clip]] = {
    "second": lambda clip: clip.part(slice(None, None, 2)),
    "third": lambda clip: clip.part(slice(None, None, 3)),
    "backward": backward,
    "backward, second": lambda clip: backward(clip, 2),
    "turning": turning,
    "narrowing": narrowing,
}


def main() -> None:
    """Track every clip with every setting, and print what became of it."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("roots", type=Path, nargs="+")
    parser.add_argument("--settings", default="default", help="as for dcs-jax evaluate, with ,")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--sequences", help="names with commas between (default: all)")
    arguments = parser.parse_args()
    cache()
    names = arguments.sequences.split(",") if arguments.sequences else None
    settings = arguments.settings.split(",")
    configs = {setting: parse_setting(setting).config("") for setting in settings}
    results: dict[str, dict[str, list[Result]]] = {s: {c: [] for c in CHANGES} for s in settings}
    for _, entry in entries(arguments.roots, names):
        sequence = entry.load()
        frames = np.stack(list(sequence.frames))
        clip = Clip(frames, np.asarray(sequence.truth, np.float64))
        for name, change in CHANGES.items():
            harder = change(clip)
            for setting, config in configs.items():
                results[setting][name].append(tracked(harder, range(arguments.seeds), config))
    if not results[settings[0]]["second"]:
        roots = ", ".join(map(str, arguments.roots))
        parser.error(f"{roots} has no sequences {arguments.sequences or ''}")
    print("| setting |", " | ".join(CHANGES), "| all | difference | below 0.3 | sure | ROC |")
    print("|---" * (len(CHANGES) + 6) + "|")
    base = _aucs(results[settings[0]])
    for setting in settings:
        print(_row(setting, results[setting], base), flush=True)


def tracked(clip: Clip, seeds: range, config: Config) -> Result:
    """What became of the clip from its first box."""
    runs = run_seeds(clip.frames, clip.truth[0], seeds, config)
    overlaps = np.array([overlap(boxes, clip.truth) for boxes in runs.boxes])
    labelled = np.isfinite(overlaps)
    auc = np.mean([success_curve(boxes, clip.truth).mean() for boxes in runs.boxes])
    confidence = np.asarray(runs.confidence, np.float64)[labelled]
    return Result(float(auc), overlaps[labelled], confidence)


def _aucs(results: dict[str, list[Result]]) -> NDArray[np.float64]:
    """[changes, sequences]."""
    return np.array([[one.auc for one in row] for row in results.values()])


def _row(setting: str, results: dict[str, list[Result]], base: NDArray[np.float64]) -> str:
    found = _aucs(results)
    difference = (found - base).ravel()
    error = difference.std() / np.sqrt(difference.size)
    every = [one for row in results.values() for one in row]
    overlaps = np.concatenate([one.overlaps for one in every])
    confidence = np.concatenate([one.confidence for one in every])
    far = overlaps < FAR
    # Without verification there is no confidence.
    known = far.any() and np.isfinite(confidence).all()
    sure = (confidence[far] > SURE).mean() if known else np.nan
    cells = [
        f"`{setting}`",
        *(f"{mean:.3f}" for mean in (*found.mean(1), found.mean())),
        f"{difference.mean():+.4f} ± {error:.4f}",
        f"{far.mean():.1%}",
        f"{sure:.1%}",
        f"{failure_auc(confidence, (overlaps > RIGHT).astype(np.float64)):.3f}",
    ]
    return "| " + " | ".join(cells) + " |"


if __name__ == "__main__":
    main()
