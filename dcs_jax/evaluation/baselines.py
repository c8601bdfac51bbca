"""Baselines: the trackers of OpenCV, run on the same frames.

`cv2.TrackerMIL` is in every wheel of OpenCV. The others are in the contrib wheel, which cannot be
installed together with the plain one: run them in an environment of their own, and merge the
results with `dcs-jax report DIR DIR`.
"""

from collections.abc import Callable, Iterable
from operator import attrgetter
from time import perf_counter
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from dcs_jax.evaluation.runner import Runs

# Name in the results, and name in OpenCV.
BASELINES = {
    "MIL": "TrackerMIL_create",
    "KCF": "TrackerKCF_create",
    "CSRT": "TrackerCSRT_create",
    "Boosting": "legacy.TrackerBoosting_create",
    "MedianFlow": "legacy.TrackerMedianFlow_create",
    "MOSSE": "legacy.TrackerMOSSE_create",
}


def available_baselines() -> list[str]:
    """The baselines that the installed OpenCV has."""
    return [name for name in BASELINES if _factory(name) is not None]


def select_baselines(wanted: Iterable[str]) -> list[str]:
    """The baselines of these names, each once; "opencv" stands for all that are installed.

    Raises ValueError for a name that is unknown or not installed.
    """
    names: list[str] = []
    for name in wanted:
        if name == "opencv":
            names += available_baselines()
        elif name not in BASELINES:
            raise ValueError(
                f"{name!r} is not a baseline: expected opencv or some of {', '.join(BASELINES)}"
            )
        elif _factory(name) is None:
            raise ValueError(
                f"{name} is not in this OpenCV: it comes with opencv-contrib-python-headless"
            )
        else:
            names.append(name)
    return list(dict.fromkeys(names))


def run_baseline(
    name: str,
    frames: Iterable[NDArray[np.uint8]],
    box: NDArray[np.float64],
    on_frames: Callable[[int], None] = lambda tracked: None,
) -> Runs:
    """Track a box with a tracker of OpenCV, on all its threads; where it fails, the last box stays.

    frames: [H, W, 3] uint8 RGB each.
    box: [4], x, y, w, h in pixels, of the first frame; rounded for OpenCV.
    on_frames: called with 1 after each frame.

    Raises ValueError where OpenCV raises an error of its own, as for a box outside the frame.
    """
    create = _factory(name)
    if create is None:
        raise ValueError(f"{name} is not in this OpenCV")
    tracker = create()
    boxes: list[Any] = []
    seconds = 0.0
    for frame in frames:
        bgr = cv2.cvtColor(frame, cv2.COLOR_RGB2BGR)
        started = perf_counter()
        try:
            if not boxes:
                tracker.init(bgr, tuple(round(float(side)) for side in box))
                boxes.append(box)
            else:
                found, moved = tracker.update(bgr)
                boxes.append(moved if found else boxes[-1])
        except cv2.error as error:
            raise ValueError(f"OpenCV's {name} fails at frame {len(boxes)}: {error}") from error
        seconds += perf_counter() - started
        on_frames(1)
    track = np.asarray(boxes, np.float32)[None]
    return Runs(track, np.full(track.shape[:2], np.nan, np.float32), seconds)


def _factory(name: str) -> Callable[[], Any] | None:
    try:
        return attrgetter(BASELINES[name])(cv2)
    except AttributeError:
        return None
