"""The layout of MIL (Babenko et al., CVPR 2009): imgs/img%05d.png, *_gt.txt, *_frames.txt.

*_gt.txt has x, y, w, h for every frame, zeros where it is unlabelled: only every 5th is labelled.
*_frames.txt has the numbers of the first and the last image.
"""

import functools
from pathlib import Path

from dcs_jax.evaluation.datasets.sequence import Entry, Sequence, count_images, open_sequence
from dcs_jax.io.annotations import parse_numbers, read_boxes


def entries(folder: Path, name: str) -> list[Entry]:
    """The sequence of a folder in the layout of MIL; [] for other layouts."""
    annotations = sorted(folder.glob("*_gt.txt"))
    if not annotations and not (folder / "imgs").is_dir():
        return []
    return [Entry(name, functools.partial(_load, name, folder, annotations))]


def _load(name: str, folder: Path, annotations: list[Path]) -> Sequence:
    if len(annotations) != 1:
        raise ValueError(f"{folder} holds {len(annotations)} files *_gt.txt: expected one")
    (annotation,) = annotations
    images = folder / "imgs"
    count_images(images)
    ranges = sorted(folder.glob("*_frames.txt"))
    if not ranges:
        raise ValueError(f"{folder} holds no *_frames.txt with the first and the last image")
    text = ranges[0].read_text(encoding="utf-8-sig")
    numbers = parse_numbers(text, str(ranges[0]), (2,), "the numbers of the first and last image")
    first, last = (images / f"img{int(number):05d}.png" for number in numbers)
    for image in (first, last):
        if not image.is_file():
            raise ValueError(f"{image} does not exist, but {ranges[0].name} names it")
    names = sorted(path.name for path in images.glob("img*.png"))
    start, end = names.index(first.name), names.index(last.name) + 1
    truth = read_boxes(annotation)
    return open_sequence(name, images, truth, annotation, start, end)
