"""How far a track is from the annotation, frame by frame and as one number.

Boxes are x, y, w, h in pixels, (x, y) the top-left corner. A row of the annotation with a NaN is
unlabelled: the per-frame functions give NaN there and the summaries leave it out.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray


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
