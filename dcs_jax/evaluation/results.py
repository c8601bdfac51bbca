"""Results on disk. Everything in the report is computed from them.

    runs/SEQUENCE/SETTING/START.npz         boxes, confidences, seeds and what they depend on
    runs/SEQUENCE/SETTING/START-seed00.txt  the same boxes as OTB text, one x,y,w,h a line
    sequences/SEQUENCE.npz                  labels and some small frames for the film strips
    published.csv                           other people's results, if there are any
    skipped.csv                             what could not be run, and why
    results.csv, summary.json, summary.md   numbers, by `report.tables`
    index.html, overview.png                the page and a picture, by `report.page`

Files are written to a temporary name and renamed, so that none is ever half written.
"""

import csv
import json
import zipfile
from collections.abc import Container, Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from dcs_jax.evaluation.datasets import Sequence
from dcs_jax.io.files import atomic, safe_name, write_table

_MOST = 200  # bytes of the name of a file without its suffix
PICTURES = 48  # frames of a sequence that are kept
PICTURE_WIDTH = 480  # pixels at most
JPEG_QUALITY = 80
# Raised by reading a file that is damaged, or of another version.
UNREADABLE = (ValueError, KeyError, TypeError, EOFError, OSError, zipfile.BadZipFile)


class Record(NamedTuple):
    """The runs of one setting from one start on one sequence.

    start: name of the start.
    frame: first frame of the sequence that is tracked.
    seeds: [S].
    boxes: [S, T, 4] float32, x, y, w, h in pixels, from the first frame on.
    confidence: [S, T] float32, NaN for a tracker without confidence.
    seconds: time of tracking all S seeds.
    key: digest of all that the boxes depend on: setting, code, data, start.
    about: the same in words, and what it was run with, for the summary.
    """

    sequence: str
    setting: str
    start: str
    frame: int
    seeds: NDArray[np.int64]
    boxes: NDArray[np.float32]
    confidence: NDArray[np.float32]
    seconds: float
    key: str
    about: dict[str, Any]


class Labels(NamedTuple):
    """What is kept of a sequence.

    truth: [T, 4], x, y, w, h in pixels, NaN where unlabelled.
    shown: [P], frames of which there is a picture.
    pictures: P JPEG images, encoded.
    size: rows and columns of the frames, pixels.
    data: digest of labels and files.
    """

    sequence: str
    truth: NDArray[np.float64]
    shown: NDArray[np.int64]
    pictures: list[bytes]
    size: tuple[int, int]
    data: str


class Published(NamedTuple):
    """Other people's result on a sequence; sd is NaN and runs 0 where unknown."""

    source: str
    tracker: str
    sequence: str
    centre_error: float
    sd: float
    success_rate: float
    runs: int


class Skipped(NamedTuple):
    """What could not be run, and why: a sequence, or one setting from one start on it."""

    sequence: str
    run: str
    reason: str

    def __str__(self) -> str:
        return f"{', '.join(filter(None, self[:2]))}: {self.reason}"


class Results:
    """The results in a folder."""

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)

    def find(self, sequence: str, setting: str, start: str) -> Record | None:
        """The record of these names; None unless there is one that can be read."""
        path = self._path(sequence, setting, start)
        return _read_record(path) if path.is_file() else None

    def write(self, record: Record) -> None:
        """Store a record, and its boxes as text."""
        path = self._path(record.sequence, record.setting, record.start)
        for seed, boxes in zip(record.seeds, record.boxes, strict=True):
            with atomic(path.with_name(f"{record.start}-seed{seed:02d}.txt")) as file:
                np.savetxt(file, boxes, fmt="%.4f", delimiter=",")
        about = json.dumps(
            {name: getattr(record, name) for name in ("sequence", "setting", "start", "frame")}
            | {"seconds": record.seconds, "key": record.key, "about": record.about}
        )
        with atomic(path) as file:  # last: where this file is, the others are complete
            np.savez_compressed(
                file,
                about=about,
                seeds=record.seeds,
                boxes=record.boxes,
                confidence=record.confidence,
            )

    def records(self) -> Iterator[Record]:
        """All records, in the order of their names."""
        for path in sorted(self.folder.glob("runs/*/*/*.npz")):
            if (record := _read_record(path)) is not None:
                yield record

    def keep_sequence(
        self, sequence: Sequence, data: str, frames: Iterable[NDArray[np.uint8]]
    ) -> None:
        """Store the labels of a sequence and small pictures of frames spread evenly over it.

        data: fingerprint of the sequence.
        """
        labelled = np.flatnonzero(~np.isnan(sequence.truth).any(axis=1))
        chosen = np.linspace(0, len(labelled) - 1, min(PICTURES, len(labelled))).round()
        shown = labelled[chosen.astype(int)]
        wanted = set(shown.tolist())
        pictures = [_encode(frame) for t, frame in enumerate(frames) if t in wanted]
        about = {"sequence": sequence.name, "size": sequence.frames.shape[:2], "data": data}
        with atomic(self._labels_path(sequence.name)) as file:
            np.savez(
                file,
                about=json.dumps(about),
                truth=sequence.truth,
                shown=shown,
                lengths=[len(picture) for picture in pictures],
                pictures=np.frombuffer(b"".join(pictures), np.uint8),
            )

    def keeps_sequence(self, name: str, data: str) -> bool:
        """Whether labels and pictures of the sequence with this fingerprint are stored."""
        path = self._labels_path(name)
        kept = _read_labels(path) if path.is_file() else None
        return kept is not None and kept.data == data

    def labels(self) -> dict[str, Labels]:
        """What is kept of every sequence, by the name of the sequence."""
        paths = sorted(self.folder.glob("sequences/*.npz"))
        kept = (_read_labels(path) for path in paths)
        return {labels.sequence: labels for labels in kept if labels is not None}

    def write_published(self, published: Iterable[Published]) -> None:
        """Store other people's results."""
        write_table(self.folder / "published.csv", Published._fields, published)

    def published(self) -> list[Published]:
        """Other people's results, as stored."""
        path = self.folder / "published.csv"
        if not path.is_file():
            return []
        with open(path, newline="", encoding="utf-8") as file:
            return [
                Published(
                    row["source"],
                    row["tracker"],
                    row["sequence"],
                    float(row["centre_error"]),
                    float(row["sd"]),
                    float(row["success_rate"]),
                    int(row["runs"]),
                )
                for row in csv.DictReader(file)
            ]

    def write_skipped(self, skipped: Iterable[Skipped], tried: Container[str]) -> None:
        """Store what was skipped, and keep the earlier rows of sequences not `tried` now."""
        rows = [row for row in self.skipped() if row.sequence not in tried]
        write_table(self.folder / "skipped.csv", Skipped._fields, [*rows, *skipped])

    def skipped(self) -> list[Skipped]:
        """What was skipped, as stored."""
        path = self.folder / "skipped.csv"
        if not path.is_file():
            return []
        with open(path, newline="", encoding="utf-8") as file:
            return [Skipped(**row) for row in csv.DictReader(file)]

    def _labels_path(self, sequence: str) -> Path:
        return self.folder / "sequences" / f"{safe_name(sequence, _MOST)}.npz"

    def _path(self, sequence: str, setting: str, start: str) -> Path:
        return self.folder / "runs" / safe_name(sequence) / safe_name(setting) / f"{start}.npz"


def read_published(folder: str | Path) -> list[Published]:
    """Read other people's results from every CSV file of a folder that has the columns.

    Columns: sequence, tracker, success_rate, runs, centre_error_px or centre_error_px_mean, and
    optionally centre_error_px_sd.

    Raises ValueError where the folder does not exist, no file has the columns, or a field is not a
    number.
    """
    published = []
    folder = Path(folder)
    if not folder.is_dir():
        raise ValueError(f"{folder} is not a folder: expected a folder of published results")
    for path in sorted(folder.glob("*.csv")):
        with open(path, newline="", encoding="utf-8-sig") as file:
            rows = list(csv.DictReader(file))
        for n, row in enumerate(rows, 2):
            error = row.get("centre_error_px_mean") or row.get("centre_error_px")
            if error is None or not {"sequence", "tracker", "success_rate", "runs"} <= row.keys():
                break  # a table of something else
            try:
                numbers = (
                    float(error),
                    float(row.get("centre_error_px_sd") or "nan"),
                    float(row["success_rate"]),
                    int(row["runs"]),
                )
            except ValueError as wrong:
                raise ValueError(f"{path}, line {n}: {wrong}") from None
            published.append(Published(path.stem, row["tracker"], row["sequence"], *numbers))
    if not published:
        raise ValueError(
            f"{folder} holds no CSV with the columns sequence, tracker, centre_error_px, "
            "success_rate, runs"
        )
    return published


def _read_record(path: Path) -> Record | None:
    """Read a record; None where the file is damaged or of another version."""
    try:
        with open(path, "rb") as handle, np.load(handle) as file:
            about = json.loads(str(file["about"]))
            return Record(
                seeds=file["seeds"],
                boxes=file["boxes"],
                confidence=file["confidence"],
                **about,
            )
    except UNREADABLE:
        return None


def _read_labels(path: Path) -> Labels | None:
    try:
        with open(path, "rb") as handle, np.load(handle) as file:
            about = json.loads(str(file["about"]))
            ends = np.cumsum(file["lengths"])[:-1]
            pictures = [part.tobytes() for part in np.split(file["pictures"], ends)]
            return Labels(
                about["sequence"],
                file["truth"],
                file["shown"],
                pictures,
                tuple(about["size"]),
                about["data"],
            )
    except UNREADABLE:
        return None


def _encode(frame: NDArray[np.uint8]) -> bytes:
    """A frame [H, W, 3] RGB as a JPEG of at most PICTURE_WIDTH."""
    rows, columns = frame.shape[:2]
    if columns > PICTURE_WIDTH:
        size = (PICTURE_WIDTH, round(rows * PICTURE_WIDTH / columns))
        frame = cv2.resize(frame, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
    bgr = cv2.cvtColor(frame, cv2.COLOR_RGB2BGR)
    _, encoded = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return bytes(encoded)
