"""The results of a batch on disk.

    boxes/VIDEO-SOURCE-DIGEST.csv  one row a frame of each target of a video
    results.csv                    id, source and file of every target that is finished
    failed.csv                     id, source and reason of every target that is not, if any

A file of boxes takes its name when all targets of its video are in it, and the name says what they
depend on: a video is finished where there is a file of that name, without looking into it.
"""

import csv
import dataclasses
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import dcs_jax
from dcs_jax.config import Config
from dcs_jax.evaluation.provenance import digest
from dcs_jax.io.annotations import COLUMNS, box_rows
from dcs_jax.io.files import atomic, safe_name
from dcs_jax.jobs.manifest import Target, Video
from dcs_jax.jobs.video import Found

FOLDER = "boxes"
INDEX = "results.csv"
FAILED = "failed.csv"
LONGEST_STEM = 80  # characters of the video's name in the name of its file


class Results:
    """The results in a folder, made with these settings."""

    def __init__(self, folder: str | Path, config: Config, seed: int) -> None:
        self.folder = Path(folder)
        self._made_with = [dataclasses.asdict(config), seed, dcs_jax.__version__]
        # Looked up before the video is tracked: a file that changes meanwhile is another one.
        self._names: dict[Video, str] = {}
        # Read once: asking the disk for each of a million files would take longer.
        self._files: dict[str, set[str]] = {}  # names by their part that stands for the source
        boxes = self.folder / FOLDER
        for name in os.listdir(boxes) if boxes.is_dir() else ():
            if name.endswith(".csv") and not name.startswith("."):
                self._files.setdefault(name.rpartition("-")[0], set()).add(name)

    def file_of(self, video: Video) -> str:
        """The name of the file of a video's boxes, there or not, relative to the folder.

        It has a digest of the settings, the seed, the version of dcs_jax, the targets (id, box,
        start and end), and name, size and time of change of the source's files.
        """
        return f"{FOLDER}/{self._name(video)}"

    def has(self, video: Video) -> bool:
        """Whether the video is finished."""
        name = self._name(video)
        return name in self._files.get(name.rpartition("-")[0], ())

    def has_other(self, video: Video) -> bool:
        """Whether there are results of the source, but of other targets, settings or content."""
        return bool(self._files.get(_source_part(video.source))) and not self.has(video)

    def write(self, video: Video, found: Sequence[Found]) -> None:
        """Store what was found of the video's targets; other results of its source are removed."""
        name = self._name(video)
        with atomic(self.folder / FOLDER / name, text=True) as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(("id", *COLUMNS))
            for target, (boxes, confidence) in zip(video.targets, found, strict=True):
                for row in box_rows(boxes, confidence, target.start):
                    table.writerow((target.id, *row))
        others = self._files.setdefault(name.rpartition("-")[0], set())
        for other in others - {name}:
            (self.folder / FOLDER / other).unlink(missing_ok=True)
        others.clear()
        others.add(name)

    def write_index(self, finished: Iterable[tuple[Target, str]]) -> None:
        """Store which file has which target."""
        with atomic(self.folder / INDEX, text=True) as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(("id", "source", "file"))
            table.writerows((target.id, target.source, name) for target, name in finished)

    def write_failed(self, failed: Iterable[tuple[Target, str]]) -> None:
        """Store which targets have failed and why; no file where there is none."""
        rows = [(target.id, target.source, reason) for target, reason in failed]
        if not rows:
            (self.folder / FAILED).unlink(missing_ok=True)
            return
        with atomic(self.folder / FAILED, text=True) as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(("id", "source", "reason"))
            table.writerows(rows)

    def _name(self, video: Video) -> str:
        if video not in self._names:
            depends = digest([self._made_with, video, _content(video.source)])
            self._names[video] = f"{_source_part(video.source)}-{depends}.csv"
        return self._names[video]


def _source_part(source: str) -> str:
    """What the names of all results of a source begin with."""
    return f"{safe_name(Path(source).stem)[:LONGEST_STEM]}-{digest(source)[:8]}"


def _content(source: str) -> list[Any]:
    """Name, size and time of change of the files of a source; none where it is not to be seen."""
    path = Path(source)
    if not path.is_dir():
        files = [path] if path.exists() else []
    else:
        inner = path / "img"
        files = sorted((inner if inner.is_dir() else path).iterdir())
    found = [(file.name, file.stat()) for file in files]
    return [(name, status.st_size, status.st_mtime_ns) for name, status in found]
