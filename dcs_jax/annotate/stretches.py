"""The frames between two keyframes: what is tracked at once, and what is known of them then."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dcs_jax.annotate.project import Box, Keyframe


class Stretch(NamedTuple):
    """The frames `first` to `last`, both included, of an object, with a box at one end or both.

    left: the box in the first frame, of a keyframe; None where the track only goes backwards.
    right: that in the last; None where the track only goes forward: to the end of the clip, or to
        the frame before a keyframe that says the object is not there.
    """

    object: int
    first: int
    last: int
    left: Box | None
    right: Box | None

    @property
    def length(self) -> int:
        """Number of its frames, those of the keyframes included."""
        return self.last - self.first + 1


class StretchTrack(NamedTuple):
    """An object in the n frames of a stretch, or of a whole clip.

    boxes: [n, 4] float32; NaN in frames not tracked yet. confidence: [n] float32 in [0, 1].
    lost: [n] bool. disagreement: [n] float32, as in `ObjectLane`.
    """

    boxes: NDArray[np.float32]
    confidence: NDArray[np.float32]
    lost: NDArray[np.bool_]
    disagreement: NDArray[np.float32]

    def rows(self, rows: slice) -> "StretchTrack":
        """Some of the frames: views."""
        return StretchTrack(
            self.boxes[rows], self.confidence[rows], self.lost[rows], self.disagreement[rows]
        )

    def copy(self) -> "StretchTrack":
        """The same in memory of its own."""
        return StretchTrack(
            self.boxes.copy(), self.confidence.copy(), self.lost.copy(), self.disagreement.copy()
        )


def unknown(length: int) -> StretchTrack:
    """The track of which nothing is known."""
    boxes = np.full((length, 4), np.nan, np.float32)
    return StretchTrack(boxes, boxes[:, 0].copy(), np.zeros(length, np.bool_), boxes[:, 0].copy())


def stretches_of(id: int, keyframes: Mapping[int, Keyframe], length: int) -> list[Stretch]:
    """The stretches of an object, in order of their frames; those of keyframes only are left out.

    length: number of frames of the clip. Where a keyframe says that the object is not there, no
    stretch follows it.
    """
    frames = sorted(keyframes)
    boxes = [keyframes[frame].box for frame in frames]
    found = []
    if frames and boxes[0] is not None:
        found.append(Stretch(id, 0, frames[0], None, boxes[0]))
    following = [*zip(frames[1:], boxes[1:], strict=True), (length, None)]
    for first, left, (after, right) in zip(frames, boxes, following, strict=True):
        if left is not None:
            last = after if right is not None else after - 1
            found.append(Stretch(id, first, last, left, right))
    fewest = [1 if None in (stretch.left, stretch.right) else 2 for stretch in found]
    return [s for s, least in zip(found, fewest, strict=True) if s.last - s.first >= least]


def assemble(
    keyframes: Mapping[int, Keyframe], known: Mapping[Stretch, StretchTrack], id: int, length: int
) -> StretchTrack:
    """The object in all frames of the clip, from its keyframes and the stretches that are known."""
    whole = unknown(length)
    for stretch in stretches_of(id, keyframes, length):
        if stretch in known:
            rows = slice(stretch.first, stretch.last + 1)
            for into, values in zip(whole, known[stretch], strict=True):
                into[rows] = values
    frames = sorted(keyframes)
    if frames and keyframes[frames[0]].box is None:
        whole.lost[: frames[0]] = True
    for frame, after in zip(frames, [*frames[1:], length], strict=True):
        box = keyframes[frame].box
        here = frame if box is not None else slice(frame, after)
        whole.boxes[here] = np.nan if box is None else box
        whole.confidence[here] = np.nan if box is None else 1
        whole.disagreement[here] = np.nan if box is None else 0
        whole.lost[here] = box is None
    return whole
