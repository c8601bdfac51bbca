"""`dcs-jax convert`: tracks from one format to another."""

import re
from pathlib import Path
from typing import Annotated

import typer

from dcs_jax import formats

_NAMES = ", ".join(formats.NAMES)


def convert(
    source: Annotated[
        Path,
        typer.Argument(metavar="IN", help="A file or folder of tracks.", show_default=False),
    ],
    out: Annotated[
        Path, typer.Argument(metavar="OUT", help="File or folder to write.", show_default=False)
    ],
    from_format: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="FORMAT",
            help=f"Format of IN: {_NAMES}.",
            show_default="its content's",
        ),
    ] = None,
    to_format: Annotated[
        str | None,
        typer.Option(
            "--to", metavar="FORMAT", help="Format of OUT.", show_default="that of its suffix"
        ),
    ] = None,
    size: Annotated[
        str | None,
        typer.Option(
            metavar="WxH",
            help="Size of the frames, pixels, where IN does not say it.",
            show_default=False,
        ),
    ] = None,
    length: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Number of frames of the clip, where IN does not say it.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Convert tracks: csv, otb, mot, cvat, coco, yolo.

    What a format cannot hold is left out: the frames of a lost object in most, names in mot.
    """
    if out.resolve() == source.resolve():
        raise ValueError(f"{out} is the source: it would be overwritten")
    if to_format is None:
        to_format = formats.format_of(out)
    tracks = formats.read(source, from_format, parse_size(size), length)
    formats.write(out, tracks, to_format)
    boxes = sum(int(track.visible.sum()) for track in tracks.objects)
    counts = f"{_count(len(tracks.objects), 'object')}, {_count(boxes, 'box', 'boxes')}"
    typer.echo(f"{counts} in {out} ({to_format})")


def _count(count: int, one: str, many: str | None = None) -> str:
    return f"{count} {one if count == 1 else many or one + 's'}"


def parse_size(text: str | None) -> tuple[int, int] | None:
    """Width and height in a text WxH, None for None; ValueError if it is anything else."""
    if text is None:
        return None
    match = re.fullmatch(r"([1-9][0-9]{0,6})[xX]([1-9][0-9]{0,6})", text)
    if match is None:
        raise ValueError(f"--size is {text!r}: expected width and height in pixels, as in 640x360")
    return int(match[1]), int(match[2])
