"""`dcs-jax label` and `dcs-jax export`: the page in the browser, and what it has made."""

import contextlib
import secrets
import socket
import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from dcs_jax import formats
from dcs_jax.checks import LARGEST_SEED
from dcs_jax.cli.errors import warn
from dcs_jax.cli.options import Changes, PresetName, together
from dcs_jax.compilation import cache

_NAMES = ", ".join(formats.NAMES)


def label(
    clip: Annotated[
        Path,
        typer.Argument(
            metavar="CLIP", help="A video file or a folder of images.", show_default=False
        ),
    ],
    boxes: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help=f"Go on from these tracks: another project, or any format ({_NAMES}).",
            show_default=False,
        ),
    ] = None,
    project: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Where it is kept.", show_default="CLIP.dcs.json"),
    ] = None,
    host: Annotated[
        str, typer.Option(help="Address to listen on; others than this let other machines in.")
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port.", show_default="one that is free")
    ] = 0,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")
    ] = True,
    preset: Annotated[
        PresetName | None,
        typer.Option(help="Settings of the tracker.", show_default="default, or the project's"),
    ] = None,
    changes: Changes = None,
    seed: Annotated[
        int | None,
        typer.Option(
            min=0,
            max=LARGEST_SEED,
            help="Seed of the random features.",
            show_default="0, or the project's",
        ),
    ] = None,
) -> None:
    """Draw boxes in the browser, watch them being tracked, correct them, and export them.

    All is kept in one file beside the clip after every change. Ctrl-C ends it.
    """
    from dcs_jax.label.app import listen, make_app, serve
    from dcs_jax.label.guard import is_loopback
    from dcs_jax.label.opening import hold, open_project
    from dcs_jax.label.threads import end_process

    opened = open_project(clip, project, boxes, preset, seed, *together(changes))
    held = hold(opened.path)
    cache()
    listening = listen(host, port)
    port = listening.getsockname()[1]
    token = secrets.token_urlsafe(24)
    name = socket.gethostname() if host in ("0.0.0.0", "::") else host
    address = f"http://{f'[{name}]' if ':' in name else name}:{port}/?token={token}"
    for note in opened.clip.notes:
        warn(note)
    if not is_loopback(host):
        warn(
            f"{host} can be reached from other machines: whoever has the address below sees and "
            "changes this project, and what is sent is not encrypted"
        )

    def started() -> None:
        typer.echo(f"labelling {clip}: {address}\nCtrl-C ends it; all is kept in {opened.path}")
        if browser:
            webbrowser.open(address)

    with contextlib.suppress(KeyboardInterrupt):  # which ends it; all is saved
        serve(make_app(opened, token, host, port), listening, started)
    if held is not None:
        held.close()
    end_process()


def export(
    project: Annotated[
        Path,
        typer.Argument(
            metavar="PROJECT", help="A file that `dcs-jax label` keeps.", show_default=False
        ),
    ],
    format: Annotated[
        str, typer.Option(metavar="NAME", help=f"Format: {_NAMES}.", show_default=False)
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="OUT", help="File or folder to write.", show_default="beside the project"
        ),
    ] = None,
) -> None:
    """Write the tracks of a project in the format of another tool: csv, otb, mot, cvat, coco, yolo.

    What a format cannot hold is left out, as `dcs-jax convert` does.
    """
    from dcs_jax.annotate import load, to_tracks
    from dcs_jax.label.exports import export_name

    opened = load(project)
    name = export_name(opened, format)
    out = project.parent / name if out is None else out
    if out.resolve() == project.resolve():
        raise ValueError(f"{out} is the project: it would be overwritten")
    formats.write(out, to_tracks(opened), format)
    count = len(opened.objects)
    typer.echo(f"{count} object{'s' * (count != 1)} in {out} ({format})")
