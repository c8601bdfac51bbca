"""How many boxes does a person have to draw until all frames of a clip are labelled well?

    python -m benchmarks.annotator ROOT... --overlap 0.5,0.7 --methods lines,mil,forward,both

ROOT is a folder of sequences as for `dcs-jax evaluate`, one with a label on every frame, which may
be in `groundtruth_every_frame.txt`; the others are left out. A simulated annotator draws the first
box, looks at the worst frame (least overlap with the truth), corrects it, and goes on until the
overlap is at least --overlap in every frame. Where several frames are the worst, as they have no
overlap at all, it takes the first of them, or that of --tie: straight lines need fewer boxes with
"last". Its boxes are counted, per 100 frames, for each way of filling the frames between:

    lines    straight lines between the boxes, as CVAT has them; the last box stays
    mil      `cv2.TrackerMIL`, forward from every box
    forward  dcs_jax, forward from every box
    both     dcs_jax, forward and backward, joined

A box of a frame in which the tracker says that the object is lost counts as any other.

A second annotator sees no truth, and goes where `Editor.next_doubtful` sends it: it corrects a box
that is wrong (an overlap of less than --overlap with the truth), and goes on from the others. It
ends when it has seen every doubtful frame; a box that it has seen it knows. Prints how many of its
visits were to wrong boxes, and the share of frames that are wrong before the first and after the
last.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.reliability import EVERY_FRAME
from dcs_jax.annotate import Box, Editor, Project, Runs, Stretch, StretchTrack, track_stretches
from dcs_jax.annotate.stretches import unknown
from dcs_jax.compilation import cache
from dcs_jax.evaluation.datasets import Entry, find_sequences
from dcs_jax.evaluation.metrics import overlap
from dcs_jax.io.annotations import read_boxes

# Of n equal frames, the one that is taken.
TIES = {"first": lambda n: 0, "middle": lambda n: n // 2, "last": lambda n: n - 1}

Filler = Callable[[Stretch], StretchTrack]


class Labelled(NamedTuple):
    """A clip with a label on every frame: frames [T, H, W, 3] uint8, truth [T, 4]."""

    name: str
    frames: NDArray[np.uint8]
    truth: NDArray[np.float64]


class Visits(NamedTuple):
    """Where the annotator without a truth was sent.

    visits: of them wrong: to wrong boxes. before, after: share of frames that are wrong with the
        first box only, and at the end.
    """

    visits: int
    wrong: int
    before: float
    after: float


def main() -> None:
    """Print the boxes per 100 frames, and the visits."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("root", type=Path, nargs="+")
    parser.add_argument("--sequences", help="names with commas between (default: all)")
    parser.add_argument("--overlap", default="0.5,0.7", help="that is asked of every frame")
    parser.add_argument("--methods", default="lines,mil,forward,both")
    parser.add_argument("--tie", default="first", choices=TIES, help="of several worst frames")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    cache()
    methods = arguments.methods.split(",")
    if set(methods) - set(METHODS):
        parser.error(f"--methods must be some of {', '.join(METHODS)}")
    asked = [float(value) for value in arguments.overlap.split(",")]
    names = arguments.sequences.split(",") if arguments.sequences else None
    print("Boxes per 100 frames (boxes) at an overlap of " + " / ".join(map(str, asked)) + "\n")
    print("| sequence | frames | " + " | ".join(methods) + " |")
    print("|---|---|" + "---|" * len(methods))
    total = np.zeros((len(methods), len(asked)), int)
    frames, visits = 0, []
    for sequence in labelled(arguments.root, names):
        fillers = [METHODS[method](sequence.frames, arguments.seed) for method in methods]
        boxes = np.array(
            [[boxes_drawn(sequence, f, least, arguments.tie) for least in asked] for f in fillers]
        )
        _row(sequence.name, len(sequence.frames), boxes)
        total, frames = total + boxes, frames + len(sequence.frames)
        if "both" in methods:
            filler = fillers[methods.index("both")]
            visits.append([follow_doubt(sequence, filler, least) for least in asked])
    _row("**all**", frames, total)
    for number, least in enumerate(asked if visits else []):
        of_all = [of_one[number] for of_one in visits]
        made, wrong = (sum(getattr(v, name) for v in of_all) for name in ("visits", "wrong"))
        before, after = (
            np.mean([getattr(v, name) for v in of_all]) for name in ("before", "after")
        )
        print(
            f"\nWithout a truth, overlap {least}: {wrong} of {made} visits were to wrong boxes "
            f"({wrong / max(made, 1):.2f}); wrong frames {before:.3f} before, {after:.3f} after."
        )


def labelled(roots: Sequence[Path], names: list[str] | None) -> Iterator[Labelled]:
    """The sequences of these names, or all, that have a label on every frame."""
    for root, entry in entries(roots, names):
        sequence = entry.load()
        truth = np.asarray(sequence.truth, np.float64)
        if (root / entry.name / EVERY_FRAME).exists():
            labels = read_boxes(root / entry.name / EVERY_FRAME)
            truth = labels[len(labels) - len(truth) :]  # a sequence starts at its first label
        if np.isfinite(truth).all():
            yield Labelled(entry.name, np.stack(list(sequence.frames)), truth)


def entries(roots: Sequence[Path], names: list[str] | None) -> Iterator[tuple[Path, Entry]]:
    """The sequences of these names, or all, and the root of each; one root may lack some."""
    for root in roots:
        there = {entry.name for entry in find_sequences(root)}
        for entry in find_sequences(root, sorted(there.intersection(names or there))):
            yield root, entry


def boxes_drawn(sequence: Labelled, filler: Filler, least: float, tie: str = "first") -> int:
    """How many boxes the annotator draws until the overlap is at least this in every frame.

    tie: which of several worst frames it takes: "first", "middle" or "last".
    """
    editor, id = _begin(sequence)
    while True:
        overlaps = _overlaps(sequence, editor, filler)
        equal = np.flatnonzero(overlaps == overlaps.min())
        worst = int(equal[TIES[tie](len(equal))])
        if overlaps[worst] >= least:
            return len(editor.project.objects[0].keyframes)
        editor.set_keyframe(id, worst, sequence.truth[worst])


def follow_doubt(sequence: Labelled, filler: Filler, least: float) -> Visits:
    """Let the annotator without a truth go where it is sent, until it has seen all of that."""
    editor, id = _begin(sequence)
    overlaps = _overlaps(sequence, editor, filler)
    before = float((overlaps < least).mean())
    visits = wrong = at = 0
    seen: dict[int, NDArray[np.float32]] = {}  # the box that was right
    passed: set[int] = set()  # since the last correction
    while (place := editor.next_doubtful(at)) is not None and place[0] not in passed:
        at = place[0]
        passed.add(at)
        box = editor.project.objects[0].boxes[at]
        if at in seen and np.array_equal(seen[at], box):
            continue
        visits += 1
        if overlaps[at] < least:
            wrong += 1
            editor.set_keyframe(id, at, sequence.truth[at])
            overlaps = _overlaps(sequence, editor, filler)
            passed.clear()
        else:
            seen[at] = box
    return Visits(visits, wrong, before, float((overlaps < least).mean()))


def lines(frames: NDArray[np.uint8], seed: int) -> Filler:
    """Straight lines between the boxes; the last one stays."""

    def fill(stretch: Stretch) -> StretchTrack:
        first, last = (np.array(box or stretch.left) for box in (stretch.left, stretch.right))
        return _track(np.linspace(first, last, stretch.length))

    return fill


def mil(frames: NDArray[np.uint8], seed: int) -> Filler:
    """OpenCV's TrackerMIL, forward."""
    known: dict[tuple[int, Box | None], list[Sequence[float]]] = {}

    def fill(stretch: Stretch) -> StretchTrack:
        key = (stretch.first, stretch.left)
        boxes = known.get(key, [])
        if len(boxes) < stretch.length:
            cv2.setRNGSeed(seed)
            tracker = cv2.TrackerMIL.create()
            box = tuple(round(value) for value in stretch.left or ())
            tracker.init(_bgr(frames[stretch.first]), box)
            boxes = [box]
            for frame in frames[stretch.first + 1 : stretch.last + 1]:
                found, following = tracker.update(_bgr(frame))
                boxes.append(following if found else boxes[-1])
            known[key] = boxes
        return _track(np.array(boxes[: stretch.length], np.float64))

    return fill


def forward(frames: NDArray[np.uint8], seed: int) -> Filler:
    """dcs_jax, forward."""
    of_both = both(frames, seed)
    return lambda stretch: of_both(stretch._replace(right=None))


def both(frames: NDArray[np.uint8], seed: int) -> Filler:
    """dcs_jax, both ways, joined. The tracks from each box are kept."""
    runs = Runs()

    def fill(stretch: Stretch) -> StretchTrack:
        def read(start: int, end: int) -> NDArray[np.uint8]:
            return frames[start:end]

        return track_stretches(read, [stretch], seed=seed, runs=runs)[stretch]

    return fill


METHODS = {"lines": lines, "mil": mil, "forward": forward, "both": both}


def _begin(sequence: Labelled) -> tuple[Editor, int]:
    height, width = sequence.frames.shape[1:3]
    project = Project(sequence.name, {}, (width, height), len(sequence.frames), 30.0)
    editor = Editor(project)
    return editor, editor.add_object(0, sequence.truth[0])


def _overlaps(sequence: Labelled, editor: Editor, filler: Filler) -> NDArray[np.float64]:
    for stretch in editor.pending():
        editor.fill(stretch, filler(stretch))
    lane = editor.project.objects[0]
    return overlap(lane.boxes.astype(np.float64), sequence.truth)


def _track(boxes: NDArray[np.float64]) -> StretchTrack:
    return unknown(len(boxes))._replace(boxes=boxes.astype(np.float32))


def _bgr(frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.ascontiguousarray(frame[..., ::-1])


def _row(name: str, frames: int, boxes: NDArray[np.int64]) -> None:
    cells = [
        " / ".join(f"{100 * number / frames:.1f}" for number in of_one)
        + f" ({', '.join(map(str, of_one))})"
        for of_one in boxes
    ]
    print(f"| {name} | {frames} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
