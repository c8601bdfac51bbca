"""At which frame and with which box a tracker is started: OTB's three protocols.

    ope  one pass: from the first labelled frame, with its label
    tre  temporal robustness: from 20 frames spread evenly over the sequence, each to its end
    sre  spatial robustness: from the first frame with 12 wrong boxes: shifted by a tenth of the
         target's side to the 4 sides and the 4 corners, and scaled by 0.8, 0.9, 1.1 and 1.2

TRE starts at labelled frames that leave 20 frames or more. Where a sequence has fewer than 20 such
frames, it starts at each. All runs of a protocol have the same weight.
"""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

Protocol = Literal["ope", "tre", "sre"]
PROTOCOLS: tuple[Protocol, ...] = ("ope", "tre", "sre")

SEGMENTS = 20
SHORTEST = 20  # frames of a TRE run
SHIFT = 0.1
SHIFTS = ((-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1))
SCALES = (0.8, 0.9, 1.1, 1.2)


class Start(NamedTuple):
    """One run of a protocol: its name, first frame and box [4], x, y, w, h in pixels."""

    name: str
    frame: int
    box: NDArray[np.float64]


def starts(protocol: Protocol, truth: NDArray[np.float64]) -> list[Start]:
    """The runs of a protocol on a sequence.

    truth: [T, 4], x, y, w, h in pixels, NaN where unlabelled; the first row is labelled.
    """
    if protocol == "ope":
        return [Start("ope", 0, truth[0])]
    if protocol == "tre":
        labelled = np.flatnonzero(~np.isnan(truth).any(axis=1))
        usable = labelled[labelled <= max(len(truth) - SHORTEST, 0)]
        spread = np.linspace(0, len(usable) - 1, SEGMENTS).astype(int)
        return [Start(f"tre{t:05d}", int(t), truth[t]) for t in usable[np.unique(spread)]]
    if protocol == "sre":
        return [Start(f"sre{n:02d}", 0, box) for n, box in enumerate(_disturbed(truth[0]))]
    raise ValueError(f"protocol must be one of {', '.join(PROTOCOLS)}, but is {protocol!r}")


def _disturbed(box: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """The 12 boxes [4] of SRE."""
    corner, side = box[:2], box[2:]
    shifted = [np.concatenate([corner + SHIFT * np.array(to) * side, side]) for to in SHIFTS]
    scaled = [np.concatenate([corner + (1 - s) / 2 * side, s * side]) for s in SCALES]
    return shifted + scaled
