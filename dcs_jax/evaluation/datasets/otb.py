"""The layout of OTB (Wu et al., TPAMI 2015): NAME/img/*.jpg with NAME/groundtruth_rect.txt.

A line is x, y, w, h, separated by commas, tabs or blanks; NaN or zeros stand for no label. With
several targets, a sequence has groundtruth_rect.1.txt, .2.txt and so on and becomes NAME-1, NAME-2;
empty files among several are placeholders. Images may be numbered from any number. Where a sequence
has more images than labels, OTB's own list of frame ranges (paper.toml) says which images count.
"""

import functools
import re
from pathlib import Path

from dcs_jax.evaluation.datasets.sequence import Entry, Sequence, count_images, open_sequence
from dcs_jax.evaluation.paper import otb_frame_range
from dcs_jax.io.annotations import read_boxes, read_lines

PATTERN = re.compile(r"groundtruth_rect(\.\d+)?\.txt")


def entries(folder: Path, name: str) -> list[Entry]:
    """The sequences of a folder in the layout of OTB, one for each target; [] for other layouts."""
    annotations = sorted(path for path in folder.iterdir() if PATTERN.fullmatch(path.name))
    if not annotations:
        if not (folder / "img").is_dir():
            return []
        annotations = [folder / "groundtruth_rect.txt"]
    if len(annotations) == 1:
        return [_entry(name, folder, annotations[0])]
    targets = [path for path in annotations if path.stat().st_size and read_lines(path)]
    return [
        _entry(
            name if path.name.count(".") == 1 else f"{name}-{path.name.split('.')[1]}", folder, path
        )
        for path in targets
    ]


def _entry(name: str, folder: Path, annotation: Path) -> Entry:
    return Entry(name, functools.partial(_load, name, folder, annotation))


def _load(name: str, folder: Path, annotation: Path) -> Sequence:
    truth = read_boxes(annotation)
    images = folder / "img" if (folder / "img").is_dir() else folder
    start, end = 0, None
    known = otb_frame_range(folder.name)
    if known and len(truth) == known[1] - known[0] + 1 < count_images(images):
        start, end = known[0] - 1, known[1]
    return open_sequence(name, images, truth, annotation, start, end)
