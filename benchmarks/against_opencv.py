"""Frames per second beside `cv2.TrackerMIL`, in one run, with the accuracy each reaches.

    python -m benchmarks.against_opencv [SEQUENCE] [--rounds 5]

SEQUENCE is a folder NAME with NAME/img/* and NAME/groundtruth_rect.txt; without it a rendered clip
is tracked. The two take turns, so that a machine whose speed drifts treats them alike. Times are
of tracking alone, the frames in memory and everything compiled; OpenCV runs on all its threads.
"""

import argparse
import functools
import os
from collections.abc import Callable
from pathlib import Path

import cv2
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

import dcs_jax
from benchmarks.timing import clocked, ratios, spread, take_turns
from dcs_jax.evaluation.metrics import mean_centre_error, success_rate
from dcs_jax.io.annotations import find_annotation, read_boxes
from dcs_jax.io.frames import open_source
from dcs_jax.synthetic import render


def main() -> None:
    """Time each tracker in turn and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("sequence", nargs="?", type=Path)
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    frames, truth = load(arguments.sequence)
    on_device = jnp.asarray(frames)
    bgr = [np.ascontiguousarray(frame[..., ::-1]) for frame in frames]
    trackers: dict[str, Callable[[], NDArray[np.float32]]] = {
        "cv2.TrackerMIL": lambda: track_opencv(bgr, truth[0]),
        "dcs_jax, default": lambda: track_jax(on_device, truth[0], dcs_jax.Config()),
        "dcs_jax, paper": lambda: track_jax(on_device, truth[0], dcs_jax.Config.paper()),
    }
    boxes: dict[str, NDArray[np.float32]] = {}

    def keep(name: str) -> None:
        boxes[name] = trackers[name]()

    calls = {name: clocked(functools.partial(keep, name)) for name in trackers}
    seconds = take_turns(calls, arguments.rounds)

    cores = len(os.sched_getaffinity(0))
    size = f"{frames.shape[2]}x{frames.shape[1]}, box of {truth[0][2]:g}x{truth[0][3]:g}"
    print(f"{len(frames)} frames of {size}, {cores} cores; median (range) of {arguments.rounds}\n")
    print("| tracker | frames/s | times cv2.TrackerMIL | centre error, px | success rate |")
    print("|---|---|---|---|---|")
    base = seconds["cv2.TrackerMIL"]
    for name, times in seconds.items():
        rates = [len(frames) / t for t in times]
        print(
            f"| {name} | {spread(rates, 0)} | {spread(ratios(base, times))} "
            f"| {mean_centre_error(boxes[name], truth):.1f} "
            f"| {success_rate(boxes[name], truth):.2f} |"
        )


def track_jax(
    frames: jax.Array, box: NDArray[np.float64], config: dcs_jax.Config
) -> NDArray[np.float32]:
    """Boxes [T, 4] of one track of dcs_jax, seed 0."""
    return np.asarray(dcs_jax.track_sequence(frames, box, jax.random.key(0), config).boxes)


def track_opencv(bgr: list[NDArray[np.uint8]], box: NDArray[np.float64]) -> NDArray[np.float32]:
    """Boxes [T, 4] of one track of OpenCV's MIL; the last box stays where it fails."""
    tracker = cv2.TrackerMIL_create()
    tracker.init(bgr[0], tuple(round(float(side)) for side in box))
    boxes = [box]
    for frame in bgr[1:]:
        found, moved = tracker.update(frame)
        boxes.append(np.array(moved) if found else boxes[-1])
    return np.array(boxes, np.float32)


def load(sequence: Path | None) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """Frames [T, H, W, 3] and annotation [T, 4]."""
    if sequence is None:
        clip = render()
        return clip.frames, clip.boxes.astype(np.float64)
    annotation = find_annotation(sequence)
    if annotation is None:
        raise SystemExit(f"{sequence}: there is no annotation beside its images")
    return np.stack(list(open_source(sequence))), read_boxes(annotation)


if __name__ == "__main__":
    main()
