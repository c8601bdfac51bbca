"""Labelled sequences on disk, found by the files of a folder: OTB, MIL, VOT, GOT-10k, videos.

Every reader is a function that names the sequences of one folder without opening them, so that a
broken sequence does not stop the others.
"""

from collections.abc import Iterable
from pathlib import Path

from dcs_jax.evaluation.datasets import got10k, mil, otb, video, vot
from dcs_jax.evaluation.datasets.sequence import Entry, Sequence, holds_images

__all__ = ["Entry", "Sequence", "find_sequences"]

# In this order: GOT-10k and VOT share the name of the annotation, the marks of GOT-10k decide.
READERS = (otb.entries, mil.entries, got10k.entries, vot.entries)
DEPTH = 3  # folders below the root: GOT-10k has train/NAME, VOT sequences/NAME


def find_sequences(root: str | Path, names: Iterable[str] | None = None) -> list[Entry]:
    """The sequences of a folder, sorted by name; each is opened by its `load`.

    root: folder of sequences, or one sequence. In folders of folders, the name of a sequence is
        its path below the root with "-" for "/". A folder of images without an annotation is
        listed and fails on loading, so that it is reported.
    names: names of the sequences wanted, in this order; all by default.

    Raises ValueError where there is no sequence, or a name is not found.
    """
    root = Path(root)
    if not root.is_dir():
        raise ValueError(f"{root} is not a folder: expected a folder of sequences")
    found = {entry.name: entry for entry in _walk(root, root.resolve().name, DEPTH)}
    if not found:
        raise ValueError(
            f"{root} holds no sequences in the layout of OTB, MIL, VOT or GOT-10k, "
            "and no videos with a CSV file of boxes"
        )
    if names is None:
        return [found[name] for name in sorted(found, key=str.lower)]
    names = list(names)
    missing = [name for name in names if name not in found]
    if missing:
        raise ValueError(
            f"{', '.join(missing)} not found in {root}, which holds {', '.join(sorted(found))}"
        )
    return [found[name] for name in names]


def _walk(folder: Path, name: str, depth: int, prefix: str = "") -> list[Entry]:
    for reader in READERS:
        if entries := reader(folder, prefix + name):
            return entries
    if holds_images(folder):
        return [Entry(prefix + name, lambda: _refuse(folder))]
    if depth == 0:
        return []
    # The root's own name is not a part of the names.
    below = "" if depth == DEPTH else f"{prefix}{name}-"
    inner = (path for path in folder.iterdir() if path.is_dir() and path.name[0] != ".")
    folders = (
        entry for path in sorted(inner) for entry in _walk(path, path.name, depth - 1, below)
    )
    return [*video.entries(folder, below), *folders]


def _refuse(folder: Path) -> Sequence:
    raise ValueError(f"{folder} holds images, but no annotation of a known name")
