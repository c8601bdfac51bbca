"""`dcs-jax batch`: many targets in many videos, on this machine or on a Ray cluster."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from dcs_jax.cli.environment import keep_compiled_programs
from dcs_jax.cli.errors import BROKEN_SOURCE, INTERRUPTED
from dcs_jax.cli.progress import WorkBar
from dcs_jax.cli.track import Preset
from dcs_jax.evaluation.settings import with_changes
from dcs_jax.jobs.results import FAILED, INDEX
from dcs_jax.jobs.run import RETRIES, Batch, BatchWatch, run_batch

SHOWN = 10  # reasons printed; all of them are in the file


class EngineName(StrEnum):
    """The engines to choose from."""

    local = "local"
    ray = "ray"


def batch(
    manifest: Annotated[
        Path,
        typer.Argument(
            metavar="MANIFEST",
            help="A CSV, one row a video and target: source, box (or x, y, w, h), and optionally "
            "start, end, id.",
            show_default=False,
        ),
    ],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where the results go.")] = Path("batch"),
    engine: Annotated[
        EngineName, typer.Option(help="This machine, or a Ray cluster.")
    ] = EngineName.local,
    preset: Annotated[Preset, typer.Option(help="Settings of the tracker.")] = Preset.default,
    changes: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help="Change a field of the preset; repeatable.",
            show_default=False,
        ),
    ] = None,
    seed: Annotated[
        int, typer.Option(min=0, max=2**32 - 1, help="Seed of the random features.")
    ] = 0,
    workers: Annotated[
        int | None,
        typer.Option(min=1, help="Videos at once.", show_default="one a core"),
    ] = None,
    retries: Annotated[
        int, typer.Option(min=0, help="How often a video that fails is tried again.")
    ] = RETRIES,
) -> None:
    """Track every target of a manifest; finished videos are skipped, failed ones listed.

    The same command goes on where it was stopped. Ends with 3 where something failed, and with 130
    after Ctrl-C.
    """
    keep_compiled_programs()
    together = [",".join(changes)] if changes else []
    config = with_changes([preset.value], together)[-1].config("")
    with ProgressBar() as bar:
        done = run_batch(
            manifest,
            out,
            config=config,
            seed=seed,
            engine=engine.value,
            workers=workers,
            retries=retries,
            watch=bar,
        )
    _report(done)
    if done.interrupted:
        typer.echo("interrupted: the same command goes on from here", err=True)
        raise typer.Exit(INTERRUPTED)
    if done.failed:
        raise typer.Exit(BROKEN_SOURCE)


def _report(done: Batch) -> None:
    """Say what is finished, and the first reasons of what is not."""
    if done.retried:
        typer.echo(f"tried again: {done.retried}")
    typer.echo(f"{len(done.finished)} targets finished, boxes by {done.out / INDEX}")
    for target, reason in list(done.failed.items())[:SHOWN]:
        typer.echo(f"failed {target}: {reason}", err=True)
    if len(done.failed) > SHOWN:
        typer.echo(f"and {len(done.failed) - SHOWN} more in {done.out / FAILED}", err=True)


class ProgressBar(WorkBar, BatchWatch):
    """A bar over the frames to track, on stderr, shown on a terminal only."""

    def __init__(self) -> None:
        super().__init__("looking")

    def planned(self, work: int, reused: int, stale: int, videos: int) -> None:
        """Say what is reused, and set the bar to what is left."""
        notes = [f"{reused} of {videos} videos finished before"] if reused else []
        if stale:
            notes.append(f"{stale} made anew, as row, setting or file have changed")
        self.start(work, notes)
        self.describe("tracking")
