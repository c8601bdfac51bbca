"""MOTChallenge's text: frame, id, x, y, w, h, conf, -1, -1, -1, one box a line.

"All frame numbers, target IDs and bounding boxes are 1-based" (the evaluation kit's description of
its format): the left edge of the first pixel is at x = 1, and so the kit in Python, py-motmetrics,
subtracts 1 from x and y as it loads a file. Here 1 is added on writing and subtracted on
reading. (Datumaro takes x and y as they are: its boxes are one pixel off.)
Conf is -1 where there is none, as in the kit's example.

Objects have ids: their names, if all are numbers from 1 on, else 1, 2, 3, ... in their order. A
frame in which an object is lost, or has no box, has no line.
"""

from pathlib import Path

import numpy as np

from dcs_jax.formats.assembly import DIGITS, assemble, decimals, visible_rows
from dcs_jax.formats.rows import read_rows
from dcs_jax.formats.tracks import Tracks, ids_of
from dcs_jax.io.files import atomic

# Ground truth has a class and a visibility in place of the world's coordinates.
_COLUMNS = ("frame", "id", "x", "y", "w", "h", "confidence", "world x", "world y", "world z")
_LEAST = 6  # columns: detections and some trackers stop before conf


def write(path: Path, tracks: Tracks) -> None:
    """Write the tracks, by frame and in a frame by object."""
    ids = np.array(ids_of(tracks), int)
    rows = visible_rows(tracks)
    corners = decimals(rows.boxes[:, :2]) + 1
    columns = [
        (rows.frames + 1).tolist(),
        ids[rows.owners].tolist(),
        *np.round(corners, DIGITS).T.tolist(),
        *rows.boxes[:, 2:].T,
        ["-1" if np.isnan(value) else str(value) for value in rows.confidence],
    ]
    lines = zip(*columns, strict=True)
    with atomic(path, text=True) as file:
        file.writelines(f"{','.join(map(str, line))},-1,-1,-1\n" for line in lines)


def read(path: Path) -> Tracks:
    """Read results or ground truth; ValueError names the line and the column."""
    pieces = []
    lines: list[int] = []
    for rows in read_rows(path, _COLUMNS, _LEAST):
        frames = rows.counts("frame", 1, "a frame counted from 1")
        numbers = rows.counts("id", 0, "the number of an object")
        confidence = rows.confidence()
        confidence[confidence == -1] = np.nan
        pieces.append((frames - 1, numbers, rows.boxes(gaps=False) - (1, 1, 0, 0), confidence))
        lines += rows.lines
    frames, numbers, boxes, confidence = map(np.concatenate, zip(*pieces, strict=True))
    found, owners = np.unique(numbers, return_inverse=True)
    return Tracks(
        assemble(
            list(map(str, found)),
            owners,
            frames,
            boxes,
            confidence,
            lambda row: f"{path}, line {lines[row]}",
        )
    )
