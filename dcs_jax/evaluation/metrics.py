"""How far a track is from the annotation, for each frame and as one number.

Boxes are x, y, w, h in pixels, (x, y) the top-left corner. A row of the annotation with a NaN is
unlabelled: the functions of frames give NaN there, and the summaries leave it out. The conventions
are those of OTB (Wu et al., TPAMI 2015) and of the GOT-10k toolkit:

    centre error        plain (unsquared) distance of the centres in pixels
    success             overlap strictly above the threshold: a box of half the area fails at 0.5
    success curve       success rate at the 21 thresholds 0, 0.05, ..., 1; its mean is the AUC
    precision curve     fraction of frames with a centre error of at most 0, 1, ..., 50 pixels (51
                        thresholds); P@20 is its value at 20 pixels
    normalised          the same with the error's x and y in sides of the annotated box, at most
    precision           0, 0.01, ..., 0.5 (51 thresholds); its mean is the AUC (TrackingNet)
    failures            hysteresis: a failure begins at an overlap of at most 0.1 and ends at one
                        above 0.5

The first frame, whose box is the label itself, counts like any other.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

OVERLAP_THRESHOLDS = np.linspace(0, 1, 21)
PIXEL_THRESHOLDS = np.arange(51)
SIDE_THRESHOLDS = np.linspace(0, 0.5, 51)
PRECISION_AT = 20  # pixels, and the index of that threshold
LOST, HELD = 0.1, 0.5  # overlaps at which a failure begins and ends


def centre_error(boxes: ArrayLike, truth: ArrayLike) -> NDArray[np.float64]:
    """Distance between the centres of the boxes [T, 4] and the annotation [T, 4]: [T], pixels."""
    boxes, truth = _paired(boxes, truth)
    offset = (boxes[:, :2] + boxes[:, 2:] / 2) - (truth[:, :2] + truth[:, 2:] / 2)
    return np.hypot(offset[:, 0], offset[:, 1])


def overlap(boxes: ArrayLike, truth: ArrayLike) -> NDArray[np.float64]:
    """Intersection over union of the boxes [T, 4] and the annotation [T, 4]: [T] in [0, 1]."""
    boxes, truth = _paired(boxes, truth)
    top_left = np.maximum(boxes[:, :2], truth[:, :2])
    bottom_right = np.minimum(boxes[:, :2] + boxes[:, 2:], truth[:, :2] + truth[:, 2:])
    intersection = np.prod(np.maximum(bottom_right - top_left, 0), axis=1)
    return intersection / (boxes[:, 2:].prod(1) + truth[:, 2:].prod(1) - intersection)


def mean_centre_error(boxes: ArrayLike, truth: ArrayLike) -> float:
    """Mean centre error over the labelled frames, pixels."""
    return float(np.nanmean(centre_error(boxes, truth)))


def success_rate(boxes: ArrayLike, truth: ArrayLike, threshold: float = 0.5) -> float:
    """Fraction of the labelled frames whose overlap is above the threshold (strictly)."""
    overlaps = overlap(boxes, truth)
    return float(np.mean(overlaps[~np.isnan(overlaps)] > threshold))


def success_curve(boxes: ArrayLike, truth: ArrayLike) -> NDArray[np.float64]:
    """Success rate at each of `OVERLAP_THRESHOLDS`: [21]. Its mean is the area under the curve."""
    overlaps = overlap(boxes, truth)
    return np.mean(overlaps[~np.isnan(overlaps), None] > OVERLAP_THRESHOLDS, axis=0)


def precision_curve(boxes: ArrayLike, truth: ArrayLike) -> NDArray[np.float64]:
    """Fraction of frames with a centre error of at most each of `PIXEL_THRESHOLDS`: [51]."""
    errors = centre_error(boxes, truth)
    return np.mean(errors[~np.isnan(errors), None] <= PIXEL_THRESHOLDS, axis=0)


def normalised_precision_curve(boxes: ArrayLike, truth: ArrayLike) -> NDArray[np.float64]:
    """Fraction of frames with a centre error of at most each of `SIDE_THRESHOLDS`: [51].

    The error is in sides of the annotated box, its x in widths and its y in heights.
    """
    boxes, truth = _paired(boxes, truth)
    offset = (boxes[:, :2] + boxes[:, 2:] / 2) - (truth[:, :2] + truth[:, 2:] / 2)
    errors = np.linalg.norm(offset / truth[:, 2:], axis=1)
    return np.mean(errors[~np.isnan(errors), None] <= SIDE_THRESHOLDS, axis=0)


def failures(boxes: ArrayLike, truth: ArrayLike) -> list[int]:
    """The frames at which the target was lost.

    A failure begins at a labelled frame with an overlap of at most `LOST`. The next failure can
    only begin after a labelled frame with an overlap above `HELD`.
    """
    frames, held = [], True
    for t, value in enumerate(overlap(boxes, truth)):
        if held and value <= LOST:
            frames.append(t)
            held = False
        elif value > HELD:
            held = True
    return frames


class Scores(NamedTuple):
    """One run as numbers.

    centre_error: mean over the labelled frames, pixels.
    success_rate: in [0, 1], overlap above 0.5.
    auc: in [0, 1], area under the success curve.
    precision: in [0, 1], P@20.
    normalised_precision: in [0, 1], area under its curve.
    failures: number of times that the target was lost.
    """

    centre_error: float
    success_rate: float
    auc: float
    precision: float
    normalised_precision: float
    failures: float


def scores(boxes: ArrayLike, truth: ArrayLike) -> Scores:
    """All summaries of the boxes [T, 4] of one run, with the annotation [T, 4]."""
    return Scores(
        mean_centre_error(boxes, truth),
        success_rate(boxes, truth),
        float(success_curve(boxes, truth).mean()),
        float(precision_curve(boxes, truth)[PRECISION_AT]),
        float(normalised_precision_curve(boxes, truth).mean()),
        float(len(failures(boxes, truth))),
    )


def _paired(boxes: ArrayLike, truth: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Both as float64 [T, 4]; ValueError where their shapes differ or no frame is labelled."""
    boxes, truth = np.asarray(boxes, np.float64), np.asarray(truth, np.float64)
    if boxes.shape != truth.shape or boxes.ndim != 2 or boxes.shape[1] != 4:
        raise ValueError(
            f"boxes and annotation must both be [T, 4], but are {boxes.shape} and {truth.shape}"
        )
    if np.isnan(truth).any(axis=1).all():
        raise ValueError("the annotation labels no frame: every row has a NaN")
    return boxes, truth
