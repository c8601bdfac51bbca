"""The layout of GOT-10k (Huang et al., TPAMI 2021): NAME/%08d.jpg, groundtruth.txt, absence.label.

absence.label has one line for each frame, 1 where the target is out of view: such a frame counts as
unlabelled. The hidden test split, which has only one label, is refused.
"""

import functools
from pathlib import Path

import numpy as np

from dcs_jax.evaluation.datasets.sequence import Entry, Sequence, open_sequence
from dcs_jax.io.annotations import parse_numbers, read_boxes, read_lines

ANNOTATION = "groundtruth.txt"
ABSENCE = "absence.label"
MARKS = (ABSENCE, "cover.label", "cut_by_image.label", "meta_info.ini")


def entries(folder: Path, name: str) -> list[Entry]:
    """The sequence of a folder in the layout of GOT-10k; [] for other layouts."""
    if not any((folder / mark).is_file() for mark in MARKS):
        return []
    return [Entry(name, functools.partial(_load, name, folder))]


def _load(name: str, folder: Path) -> Sequence:
    annotation = folder / ANNOTATION
    truth = read_boxes(annotation)
    absence = folder / ABSENCE
    if absence.is_file():
        absent = [
            parse_numbers(line, f"{absence}, line {n}", (1,), "0 or 1")[0] != 0
            for n, line in enumerate(read_lines(absence), 1)
        ]
        if len(absent) != len(truth):
            raise ValueError(f"{absence} has {len(absent)} lines, but {ANNOTATION} {len(truth)}")
        truth[absent] = np.nan
    return open_sequence(name, folder, truth, annotation)
