"""Does the confidence say how often a box is right, and does it tell when the target is lost?

    python -m benchmarks.reliability ROOT --seeds 10

ROOT is a folder of sequences as for `dcs-jax evaluate`. All labelled frames of all sequences and
seeds count, except the first one of each; a box is right where its IoU is above 0.5. Where a
sequence has labels with size for every frame, `groundtruth_every_frame.txt`, those are used, and
the first of them is where a track starts: another annotator's box has other margins. Where
all labels have one size, they say nothing about the object's, and the box of the initial size is
compared (`output_size="initial"`), unless --estimated. Prints Markdown; --plot also draws the
reliability diagram. Of the boxes with an IoU below 0.3, "sure" is the share with a confidence above
0.5.
"""

import argparse
import dataclasses
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit, logit
from scipy.stats import rankdata

from dcs_jax.compilation import cache
from dcs_jax.evaluation.datasets import find_sequences
from dcs_jax.evaluation.metrics import overlap
from dcs_jax.evaluation.runner import run_seeds
from dcs_jax.evaluation.settings import parse_setting
from dcs_jax.io.annotations import read_boxes

BINS = 10
RIGHT = 0.5  # IoU above which a box is right
FAR = 0.3  # IoU below which a box is beside the object
SURE = 0.5  # confidence above which it should not be
FITTED = ("middle", "slope")
EVERY_FRAME = "groundtruth_every_frame.txt"

Numbers = NDArray[np.float64]


class Bin(NamedTuple):
    """Frames of similar confidence: number, mean confidence, and the share that is right."""

    frames: int
    confidence: float
    right: float


def main() -> None:
    """Track everything, and print how reliable the confidence is."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("root", type=Path)
    parser.add_argument("--setting", default="default", help="as for dcs-jax evaluate")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--sequences", help="names with commas between (default: all)")
    parser.add_argument(
        "--estimated", action="store_true", help="the estimated size, whatever the labels"
    )
    parser.add_argument("--plot", type=Path, help="file for the diagram, PNG or SVG")
    arguments = parser.parse_args()
    cache()
    names = arguments.sequences.split(",") if arguments.sequences else None
    confidences: list[Numbers] = []
    overlaps: list[Numbers] = []
    config = parse_setting(arguments.setting).config("")
    if config.verification is None:
        parser.error(f"{arguments.setting} has no verification, which is what the confidence is of")
    print(
        f"| sequence | frames | right | mean confidence | ECE | AUC | IoU < {FAR} | of these sure |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for entry in find_sequences(arguments.root, names):
        sequence = entry.load()
        truth = _every_frame(arguments.root / entry.name, sequence.truth)
        compared = config
        if have_one_size(truth) and not arguments.estimated:
            compared = dataclasses.replace(config, output_size="initial")
        runs = run_seeds(sequence.frames, truth[0], range(arguments.seeds), compared)
        found = np.array([overlap(boxes, truth) for boxes in runs.boxes])[:, 1:]
        labelled = ~np.isnan(found)
        confidences.append(runs.confidence[:, 1:][labelled].astype(np.float64))
        overlaps.append(found[labelled])
        print(_row(entry.name, confidences[-1], overlaps[-1]), flush=True)
    confidence, all_overlaps = np.concatenate(confidences), np.concatenate(overlaps)
    print(_row("**all**", confidence, all_overlaps))
    right = (all_overlaps > RIGHT).astype(np.float64)
    print("\n| confidence | frames | mean confidence | right |\n|---|---|---|---|")
    filled = bins(confidence, right)
    for number, one in enumerate(filled):
        span = f"{number / BINS:.1f} to {(number + 1) / BINS:.1f}"
        print(f"| {span} | {one.frames} | {one.confidence:.3f} | {one.right:.3f} |")
    # With a translation filter the confidence is of more than the similarity.
    prefix = "response_" if config.translation is not None else ""
    known = {name: float(getattr(config.verification, prefix + name)) for name in FITTED}
    evidence = logit(np.clip(confidence, 1e-6, 1 - 1e-6)) / known["slope"] + known["middle"]
    for label, weights in (
        ("each frame with the same weight", np.ones(len(right))),
        ("each sequence", np.concatenate([np.full(len(o), 1 / len(o)) for o in overlaps])),
    ):
        middle, slope = fit(evidence, right, weights)
        error = calibration_error(expit(slope * (evidence - middle)), right)
        print(
            f"\nProposed, {label}: verification.{prefix}middle={middle:.3f} "
            f"verification.{prefix}slope={slope:.2f} (ECE {error:.3f} on the same tracks)"
        )
    if arguments.plot:
        draw(filled, arguments.plot)


def have_one_size(labels: Numbers) -> bool:
    """Whether all boxes, [T, 4] with rows of NaN where there is none, have one width and height."""
    sizes = labels[~np.isnan(labels).any(1), 2:]
    return bool((np.ptp(sizes, axis=0) < 1).all())


def bins(confidence: Numbers, right: Numbers) -> list[Bin]:
    """The frames in `BINS` intervals of confidence of the same width; NaN where one is empty."""
    numbers = np.minimum((confidence * BINS).astype(int), BINS - 1)
    found = []
    for number in range(BINS):
        here = numbers == number
        means = (confidence[here].mean(), right[here].mean()) if here.any() else (np.nan, np.nan)
        found.append(Bin(int(here.sum()), *map(float, means)))
    return found


def calibration_error(confidence: Numbers, right: Numbers) -> float:
    """Expected calibration error: mean distance of confidence and share right, over the bins."""
    found = [one for one in bins(confidence, right) if one.frames]
    return sum(b.frames * abs(b.confidence - b.right) for b in found) / len(confidence)


def failure_auc(confidence: Numbers, right: Numbers) -> float:
    """Area under the ROC curve of low confidence for detecting failure: NaN without any.

    The probability that a box that is right has more confidence than one that is not; equal
    confidences count half.
    """
    of_right, pairs = int(right.sum()), right.sum() * (1 - right).sum()
    if not pairs:
        return float("nan")
    return float((rankdata(confidence)[right > 0].sum() - of_right * (of_right + 1) / 2) / pairs)


def fit(similarity: Numbers, right: Numbers, weights: Numbers) -> tuple[float, float]:
    """Middle and slope of the logistic function of the greatest likelihood.

    A ridge of 1e-6 keeps the slope finite where similarity separates right from wrong.
    """
    signs, weights = 2 * right - 1, weights / weights.sum()

    def cost(theta: Numbers) -> tuple[float, Numbers]:
        margin = signs * (theta[0] + theta[1] * similarity)
        pull = -weights * signs * expit(-margin)
        gradient = np.array([pull.sum(), pull @ similarity]) + 1e-6 * theta
        return float(weights @ np.logaddexp(0, -margin) + 5e-7 * theta @ theta), gradient

    offset, slope = minimize(cost, np.zeros(2), jac=True, tol=1e-9).x
    return float(-offset / slope), float(slope)


def draw(found: list[Bin], path: Path) -> None:
    """The reliability diagram: share right over confidence, and how many frames."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4, 5), layout="constrained")
    upper, lower = figure.subplots(2, sharex=True, height_ratios=(3, 1))
    upper.plot([0, 1], [0, 1], color="grey", linewidth=1)
    full = [one for one in found if one.frames]
    upper.plot([one.confidence for one in full], [one.right for one in full], marker="o")
    upper.set(ylabel=f"share with IoU > {RIGHT}", ylim=(0, 1))
    middles = (np.arange(BINS) + 0.5) / BINS
    lower.bar(middles, [one.frames for one in found], width=0.9 / BINS)
    lower.set(xlabel="confidence", ylabel="frames", yscale="log", xlim=(0, 1))
    figure.savefig(path)


def _row(name: str, confidence: Numbers, overlaps: Numbers) -> str:
    right, far = (overlaps > RIGHT).astype(np.float64), overlaps < FAR
    sure = (confidence[far] > SURE).mean() if far.any() else np.nan
    numbers = (calibration_error(confidence, right), failure_auc(confidence, right))
    return (
        f"| {name} | {len(right)} | {right.mean():.3f} | {confidence.mean():.3f} | "
        + " | ".join(f"{number:.3f}" for number in (*numbers, far.mean(), sure))
        + " |"
    )


def _every_frame(folder: Path, truth: Numbers) -> Numbers:
    """The labels with size of every frame, where the sequence's folder has them."""
    path = folder / EVERY_FRAME
    if not path.exists():
        return truth
    labels = read_boxes(path)
    if len(labels) < len(truth):
        raise ValueError(f"{path} labels {len(labels)} of {len(truth)} frames")
    return labels[len(labels) - len(truth) :]  # a sequence starts at its first label


if __name__ == "__main__":
    main()
