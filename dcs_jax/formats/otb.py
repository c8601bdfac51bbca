"""OTB's text: x, y, w, h, one line a frame of the clip from its first frame on.

A frame in which the object is lost, or has no box, is NaN,NaN,NaN,NaN. Numbers are read with
commas, tabs or blanks between them, and zeros as no label. Coordinates are written as they are:
OTB's own annotations count from 1, and its readers differ in whether they subtract it.

A file has one object, whose name is that of the file. Several are a folder of such files, NAME.txt;
characters that are not safe in a file's name are written as %XX.
"""

import re
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from dcs_jax.formats.assembly import check_total
from dcs_jax.formats.tracks import ObjectTrack, Tracks
from dcs_jax.io.annotations import read_boxes
from dcs_jax.io.files import atomic, atomic_folder

SUFFIX = ".txt"
_NOTHING = "NaN,NaN,NaN,NaN\n"
_LONGEST_NAME = 240  # bytes: file systems allow 255


def write(path: Path, tracks: Tracks) -> None:
    """Write a file, or a folder if the path has no suffix.

    Raises ValueError if several objects, or none, would go into one file, or names of files clash.
    """
    if path.suffix or path.is_file():
        if len(tracks.objects) != 1:
            raise ValueError(
                f"{path} would hold {len(tracks.objects)} objects, but a file of otb holds one: "
                "expected a folder (a path without a suffix), or another format such as mot"
            )
        _write_file(path, tracks.objects[0], tracks.end)
        return
    files = [_file_of(track.name) for track in tracks.objects]
    for number, file in enumerate(files):
        same = [other.casefold() for other in files[:number]]
        if file.casefold() in same:  # which Windows and macOS take for one file
            first = tracks.objects[same.index(file.casefold())].name
            raise ValueError(f"{tracks.objects[number].name!r} and {first!r} would be one file")
    with atomic_folder(path) as folder:
        for track, file in zip(tracks.objects, files, strict=True):
            _write_file(folder / file, track, tracks.end)


def read(path: Path) -> Tracks:
    """Read a file or a folder of files; ValueError names the file and the line."""
    if not path.is_dir():
        track, length = _read_file(path, path.stem)
        return Tracks((track,), length=length)
    files = sorted(file for file in path.iterdir() if file.suffix == SUFFIX and file.is_file())
    if not files:
        raise ValueError(f"{path} has no files *{SUFFIX}: expected one per object")
    found = [_read_file(file, unquote(file.stem)) for file in files]
    lengths = [length for _, length in found]
    if min(lengths) != max(lengths):
        shortest, longest = (files[lengths.index(of(lengths))] for of in (min, max))
        raise ValueError(
            f"{shortest} has {min(lengths)} lines, but {longest} {max(lengths)}: "
            "expected one line per frame of the clip"
        )
    return Tracks(tuple(track for track, _ in found), length=lengths[0])


def _write_file(path: Path, track: ObjectTrack, length: int) -> None:
    check_total(length, str(path))
    with atomic(path, text=True) as file:
        file.writelines(_NOTHING for _ in range(track.start))
        for box, visible in zip(track.boxes, track.visible, strict=True):
            file.write(",".join(map(str, box)) + "\n" if visible else _NOTHING)
        file.writelines(_NOTHING for _ in range(length - track.end))


def _read_file(path: Path, name: str) -> tuple[ObjectTrack, int]:
    """The track from the first to the last frame with a box, and the number of lines."""
    boxes = read_boxes(path)
    labelled = np.flatnonzero(~np.isnan(boxes[:, 0]))
    start, end = (int(labelled[0]), int(labelled[-1]) + 1) if labelled.size else (0, 0)
    with np.errstate(over="ignore"):
        single = boxes[start:end].astype(np.float32)
    count = len(single)
    nothing, never = np.full(count, np.nan, np.float32), np.zeros(count, np.bool_)
    return ObjectTrack(name, start, single, nothing, never), len(boxes)


def _escape(character: re.Match[str]) -> str:
    return "".join(f"%{byte:02X}" for byte in character[0].encode())


def _file_of(name: str) -> str:
    # urllib's quote would write every letter beyond ASCII as %XX, too.
    file = re.sub(r"[^\w ,()\[\]=+@-]", _escape, name) + SUFFIX
    if len(file.encode()) > _LONGEST_NAME:
        raise ValueError(f"the name {name!r} is too long for a file: expected 80 characters or so")
    return file
