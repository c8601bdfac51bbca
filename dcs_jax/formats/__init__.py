"""Tracks to and from the files of other tools: one interface, one file a format.

    csv    the package's table                        .csv
    otb    OTB's text, a file an object               .txt, or a folder of them
    mot    MOTChallenge's text
    cvat   CVAT for video 1.1                         .xml
    coco   COCO's JSON for videos                     .json
    yolo   YOLO's labels and data.yaml                a folder

What a format cannot hold, and a track read again does not have:

                            csv      otb     mot     cvat    coco    yolo
    boxes of lost frames    yes      -       -       -       -       -
    frames before the first and behind the last box: lost frames and gaps
                            yes      -       -       -       -       -
    lost                    yes      -       -       yes     -       -      (a gap is lost in cvat)
    confidence              yes      -       yes     -       yes     yes
    keyframes               yes      -       -       yes     -       -      (cvat: more, or all)
    name                    yes (1)  yes (1) (2)     (3)     yes     (3)
    label                   yes      -       -       yes     yes     yes
    size                    -        -       -       yes     yes     yes
    length                  -        yes     -       yes     yes     yes
    source                  -        -       -       yes     yes     yes
    fps                     -        -       -       -       yes     yes
    beyond the frame        yes      yes     yes     yes     yes    -
    objects without a box   yes      yes     -       -       -       -

(1) not that of a single object in one file, which has the name of the file. (2) numbers from 1 on
only; else objects are 1, 2, ... (3) objects with a label are LABEL, or LABEL-ID if others share it.

Every file is written whole or not at all. Numbers have as many digits as float32 needs.
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from dcs_jax.formats import coco, cvat, mot, otb, table, yolo
from dcs_jax.formats.sniffing import sniff
from dcs_jax.formats.supervision import to_supervision
from dcs_jax.formats.tracks import ObjectTrack, Tracks, check, check_size

__all__ = [
    "FORMATS",
    "NAMES",
    "ObjectTrack",
    "Tracks",
    "format_of",
    "named_by",
    "read",
    "sniff",
    "to_supervision",
    "write",
]


class Format(NamedTuple):
    """How tracks are written and read.

    suffix: of a file in this format that is given no name; "" where it is always a folder.
    folder: whether it may be a folder.
    named: whether a path of that suffix is in this format if nothing else is said.
    """

    write: Callable[[Path, Tracks], None]
    read: Callable[..., Tracks]
    suffix: str = ""
    folder: bool = False
    named: bool = True


FORMATS = {
    "csv": Format(table.write, table.read, ".csv"),
    "otb": Format(otb.write, otb.read, ".txt", folder=True),
    "mot": Format(mot.write, mot.read, ".txt", named=False),
    "cvat": Format(cvat.write, cvat.read, ".xml"),
    "coco": Format(coco.write, coco.read, ".json"),
    "yolo": Format(yolo.write, yolo.read, folder=True, named=False),
}
NAMES = tuple(FORMATS)


def write(path: str | Path, tracks: Tracks, format: str | None = None) -> None:
    """Write tracks in a format, by default that of the path's suffix.

    Raises:
        ValueError: the format is unknown, the tracks are not what `Tracks` says, or the format
            cannot hold them.
        OSError: the file cannot be written.
    """
    path = Path(path)
    chosen = FORMATS[format_of(path) if format is None else _known(format)]
    chosen.write(path, check(tracks))


def read(
    path: str | Path,
    format: str | None = None,
    size: tuple[int, int] | None = None,
    length: int | None = None,
) -> Tracks:
    """Read tracks in a format, by default the one that the content is in.

    size: width and height of a frame in pixels. length: number of frames. Where they are given,
        they take the place of what the file says.

    Raises:
        ValueError: the format is unknown, or the file is damaged; the message names line or field.
        OSError: the file cannot be read.
    """
    path = Path(path)
    name = sniff(path) if format is None else _known(format)
    if size is not None:
        check_size(size)
    if path.is_dir() and not FORMATS[name].folder:
        raise ValueError(f"{path} is a folder: expected a file of {name}")
    if name == "yolo":
        if path.is_file():
            raise ValueError(f"{path} is a file: expected a folder of yolo")
        tracks = yolo.read(path, size)
    else:
        tracks = FORMATS[name].read(path)
    try:
        return check(tracks._replace(size=size or tracks.size, length=length or tracks.length))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def format_of(path: Path) -> str:
    """The format of the path's suffix; ValueError if there is none of that suffix."""
    if (name := named_by(path)) is not None:
        return name
    suffixes = ", ".join(
        f"{known.suffix} ({name})" for name, known in FORMATS.items() if known.named
    )
    raise ValueError(
        f"{path} has no suffix that says the format: expected {suffixes}, "
        f"or the name of a format, one of {', '.join(NAMES)}"
    )


def named_by(path: Path) -> str | None:
    """The format of the path's suffix; None if there is none of that suffix."""
    names = {known.suffix: name for name, known in FORMATS.items() if known.named}
    return names.get(path.suffix.lower())


def _known(format: str) -> str:
    if format not in FORMATS:
        raise ValueError(f"format must be one of {', '.join(NAMES)}, but is {format!r}")
    return format
