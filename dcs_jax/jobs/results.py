"""The results of a batch on disk.

    boxes/VIDEO-SOURCE-DIGEST.csv  one row per frame of each target of a video; or in another format
    results.csv                    id, source and file of every finished target
    failed.csv                     id, source and reason of every failed target, if any

A file of boxes takes its name when all targets of its video are in it, and the name is a digest of
what they depend on: a video is finished if its file is there; the file need not be read.
"""

import csv
import dataclasses
import io
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import dcs_jax
from dcs_jax import formats
from dcs_jax.config import Config
from dcs_jax.evaluation.provenance import digest
from dcs_jax.io.annotations import RESULT_COLUMNS, result_rows
from dcs_jax.io.files import lock, remove, safe_name, write_table
from dcs_jax.jobs.manifest import Target, Video
from dcs_jax.jobs.video import TargetTrack

FormatName = Literal["csv", "otb", "mot", "cvat", "coco", "yolo"]

FOLDER = "boxes"
INDEX = "results.csv"
FAILED = "failed.csv"
LOCK = ".lock"
TABLE: FormatName = "csv"
LONGEST_STEM = 80  # bytes of the video's name in the name of its file


class BatchFolder:
    """The folder of a batch's results, made with these settings."""

    def __init__(
        self, path: str | Path, config: Config, seed: int, format: FormatName = TABLE
    ) -> None:
        self.path = Path(path)
        self._format = format
        # A video may have several targets: where they need a folder, it always is one.
        known = formats.FORMATS[format]
        self._suffix = "" if known.folder else known.suffix
        self._made_with = [
            dataclasses.asdict(config),
            seed,
            dcs_jax.__version__,
            *RESULT_COLUMNS,
            format,
        ]
        # Computed before the video is tracked: if its file changes meanwhile, it is not finished.
        self._names: dict[Video, str] = {}
        # Listed once: a million single queries to the disk would take longer.
        self._files: dict[str, set[str]] = {}  # names of files, by the part for their source
        boxes = self.path / FOLDER
        for name in os.listdir(boxes) if boxes.is_dir() else ():
            if not name.startswith("."):
                self._files.setdefault(name.rpartition("-")[0], set()).add(name)

    def file_of(self, video: Video) -> str:
        """Name of the file of a video's boxes, which may be missing, relative to the folder.

        It has a digest of the settings, the seed, the version of dcs_jax, the targets (id, box,
        start and end), and name, size and modification time of the source's files.
        """
        return f"{FOLDER}/{self._name(video)}"

    def has(self, video: Video) -> bool:
        """Whether the video is finished."""
        name = self._name(video)
        return name in self._files.get(name.rpartition("-")[0], ())

    def has_other(self, video: Video) -> bool:
        """Whether the source has results, but of other targets, settings or content."""
        return bool(self._files.get(_source_part(video.source))) and not self.has(video)

    def write(
        self, video: Video, tracks: Iterable[TargetTrack], size: tuple[int, int] | None = None
    ) -> None:
        """Store the tracks of the video's targets; other results of its source are removed.

        size: width and height of its frames, which some formats need.
        """
        name = self._name(video)
        of_targets = list(zip(video.targets, tracks, strict=True))
        if self._format == TABLE:
            rows = (
                (target.id, *row)
                for target, track in of_targets
                for row in result_rows(track.boxes, track.confidence, track.lost, target.start)
            )
            write_table(self.path / FOLDER / name, ("id", *RESULT_COLUMNS), rows)
        else:
            objects = [
                formats.ObjectTrack(target.id, target.start, *track) for target, track in of_targets
            ]
            clip = formats.Tracks(tuple(objects), size, source=Path(video.source).name)
            formats.write(self.path / FOLDER / name, clip, self._format)
        others = self._files.setdefault(name.rpartition("-")[0], set())
        for other in others - {name}:
            remove(self.path / FOLDER / other)
        others.clear()
        others.add(name)

    def write_index(self, finished: Iterable[tuple[Target, str]]) -> None:
        """Store which file has which target."""
        rows = ((target.id, target.source, name) for target, name in finished)
        write_table(self.path / INDEX, ("id", "source", "file"), rows)

    def add_to_index(self, targets: Iterable[Target], name: str) -> None:
        """Append targets and their file, in one piece, so that they are there if this is killed."""
        rows = io.StringIO()
        table = csv.writer(rows, lineterminator="\n")
        table.writerows((target.id, target.source, name) for target in targets)
        with open(self.path / INDEX, "ab", buffering=0) as file:
            file.write(rows.getvalue().encode(errors="surrogateescape"))

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Have the folder for this run alone, and remove what a run that was killed left behind.

        Raises ValueError where another run has it.
        """
        self.path.mkdir(parents=True, exist_ok=True)
        with open(self.path / LOCK, "ab") as file:
            try:
                lock(file)
            except ValueError:
                raise ValueError(
                    f"{self.path} is in use by another run: wait for it, or name another --out"
                ) from None
            for folder in (self.path, self.path / FOLDER):
                for left in folder.glob(".*.part"):
                    remove(left)
            yield

    def write_failed(self, failed: Iterable[tuple[Target, str]]) -> None:
        """Store which targets have failed and why; if there are none, there is no file."""
        rows = [(target.id, target.source, reason) for target, reason in failed]
        if rows:
            write_table(self.path / FAILED, ("id", "source", "reason"), rows)
        else:
            (self.path / FAILED).unlink(missing_ok=True)

    def _name(self, video: Video) -> str:
        if video not in self._names:
            depends = digest([self._made_with, video, _content(video.source)])
            self._names[video] = f"{_source_part(video.source)}-{depends}{self._suffix}"
        return self._names[video]


def _source_part(source: str) -> str:
    """The first part of the names of all results of a source."""
    return f"{safe_name(Path(source).stem, LONGEST_STEM)}-{digest(source)[:8]}"


def _content(source: str) -> list[Any]:
    """Name, size and modification time of a source's files; empty if the source is missing."""
    path = Path(source)
    if not path.is_dir():
        files = [path] if path.exists() else []
    else:
        inner = path / "img"
        files = sorted((inner if inner.is_dir() else path).iterdir())
    statuses = [(file.name, file.stat()) for file in files]
    return [(name, status.st_size, status.st_mtime_ns) for name, status in statuses]
