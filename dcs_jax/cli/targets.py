"""What `dcs-jax track` follows: boxes of the command line, of a file, of the labels, or states."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dcs_jax import formats
from dcs_jax.io.annotations import ANNOTATION_NAME, find_annotation, read_boxes
from dcs_jax.io.frames import FrameSource, StoredSource


class Target(NamedTuple):
    """One object to follow.

    name: None where it is the only one and has none. box: x, y, w, h in pixels, in the frame
    `frame`, counted from 0 in the whole source.
    """

    name: str | None
    box: tuple[float, float, float, float]
    frame: int


class Labels(NamedTuple):
    """The labels of a folder of images.

    truth: [T, 4] of all its images, NaN where unlabelled; None where there are none that can be
    used. path: of the file, None where there is none. problem: why they cannot be used, or "".
    """

    truth: NDArray[np.float64] | None
    path: Path | None
    problem: str


def parse_boxes(texts: Sequence[str], frame: int) -> list[Target]:
    """The targets of X,Y,W,H or NAME=X,Y,W,H each; ValueError where one is something else.

    Several without a name are called 1, 2, ...
    """
    targets = []
    for number, text in enumerate(texts, 1):
        name, equals, numbers = text.rpartition("=")
        try:
            x, y, w, h = map(float, numbers.split(","))
        except ValueError:
            raise ValueError(
                f"--box is {text!r}: expected four numbers X,Y,W,H, or NAME=X,Y,W,H"
            ) from None
        if equals and not name.strip():
            raise ValueError(f"--box is {text!r}: expected a name before the =")
        unnamed = None if len(texts) == 1 else str(number)
        targets.append(Target(name.strip() if equals else unnamed, (x, y, w, h), frame))
    return targets


def read_targets(path: Path, start: int, end: int | None) -> list[Target]:
    """The first box from frame `start` on of each object in a file of any format.

    Raises ValueError where the file is damaged, or has no box from start to end.
    """
    last = math.inf if end is None else end
    targets = []
    for track in formats.read(path).objects:
        shown = track.start + np.flatnonzero(track.visible)
        there = shown[(shown >= start) & (shown < last)]
        if there.size:
            x, y, w, h = track.boxes[there[0] - track.start].tolist()
            targets.append(Target(track.name, (x, y, w, h), int(there[0])))
    if not targets:
        raise ValueError(f"{path} has no box from frame {start} on")
    return targets


def check_names(names: Sequence[str | None]) -> None:
    """ValueError where two objects have one name."""
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"the name {name!r} is there twice: every object needs its own")


def read_labels(source: str, frames: FrameSource) -> Labels:
    """The labels that lie with a folder of images."""
    path = find_annotation(source) if isinstance(frames, StoredSource) else None
    if path is None or not isinstance(frames, StoredSource):
        return Labels(None, None, "")
    try:
        truth = read_boxes(path)
    except ValueError as error:
        return Labels(None, path, str(error))
    if len(truth) != frames.total:
        problem = (
            f"{path} has {len(truth)} lines, but there are {frames.total} images: "
            "expected one line per image"
        )
        return Labels(None, path, problem)
    return Labels(truth, path, "")


def first_labelled(labels: Labels, source: str, start: int, end: int | None) -> Target:
    """The object of the labels, in the first frame from start to end that has one.

    Raises ValueError where there is none.
    """
    if labels.problem:
        raise ValueError(labels.problem)
    if labels.truth is None:
        raise ValueError(f"--box is missing, and {source} has no {ANNOTATION_NAME}")
    labelled = np.flatnonzero(~np.isnan(labels.truth[start:end]).any(axis=1))
    if not labelled.size:
        raise ValueError(f"--box is missing, and no frame from {start} on is labelled")
    frame = start + int(labelled[0])
    x, y, w, h = labels.truth[frame].tolist()
    return Target(None, (x, y, w, h), frame)
