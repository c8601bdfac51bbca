"""`dcs-jax batch`: many targets in many videos, on this machine or on a Ray cluster."""

from pathlib import Path
from typing import Annotated

import typer

from dcs_jax.cli.errors import BROKEN_SOURCE, INTERRUPTED
from dcs_jax.cli.options import Changes, Preset, Seed, together
from dcs_jax.cli.progress import WorkBar
from dcs_jax.compilation import cache
from dcs_jax.evaluation.settings import with_changes
from dcs_jax.jobs.results import FAILED, INDEX, TABLE, FormatName
from dcs_jax.jobs.run import RETRIES, Batch, BatchWatch, EngineName, run_batch

SHOWN = 10  # reasons printed; all of them are in the file


def batch(
    manifest: Annotated[
        Path,
        typer.Argument(
            metavar="MANIFEST",
            help="A CSV file, one row per video and target: source, box (or x, y, w, h), and "
            "optionally start, end, id.",
            show_default=False,
        ),
    ],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the results.")] = Path(
        "batch"
    ),
    engine: Annotated[EngineName, typer.Option(help="This machine, or a Ray cluster.")] = "local",
    preset: Preset = "default",
    changes: Changes = None,
    seed: Seed = 0,
    workers: Annotated[
        int | None,
        typer.Option(min=1, help="Number of videos at once.", show_default="one per core"),
    ] = None,
    retries: Annotated[
        int, typer.Option(min=0, help="Number of times that a failed video is tried again.")
    ] = RETRIES,
    format: Annotated[FormatName, typer.Option(help="Format of the files of boxes.")] = TABLE,
) -> None:
    """Track every target of a manifest; finished videos are skipped, failed ones listed.

    The same command continues where it was stopped. The exit code is 3 if something failed, and 130
    after Ctrl-C.
    """
    cache()
    config = with_changes([preset], together(changes))[-1].config("")
    with BatchBar() as bar:
        done = run_batch(
            manifest,
            out,
            config=config,
            seed=seed,
            engine=engine,
            workers=workers,
            retries=retries,
            format=format,
            watch=bar,
        )
    _report(done)
    if done.interrupted:
        typer.echo("interrupted: the same command continues from here", err=True)
        raise typer.Exit(INTERRUPTED)
    if done.failed:
        raise typer.Exit(BROKEN_SOURCE)


def _report(done: Batch) -> None:
    """Print what is finished, and the first reasons why the rest is not."""
    if done.retried:
        typer.echo(f"tried again: {done.retried}")
    typer.echo(f"{len(done.finished)} targets finished, boxes by {done.out / INDEX}")
    for target, reason in list(done.failed.items())[:SHOWN]:
        typer.echo(f"failed {target}: {reason}", err=True)
    if len(done.failed) > SHOWN:
        typer.echo(f"and {len(done.failed) - SHOWN} more in {done.out / FAILED}", err=True)


class BatchBar(WorkBar, BatchWatch):
    """A progress bar over the frames to track, on stderr, shown on a terminal only."""

    def __init__(self) -> None:
        super().__init__("checking")

    def planned(self, work: int, reused: int, stale: int, videos: int) -> None:
        """Print what is reused, and set the bar to what is left."""
        notes = [f"{reused} of {videos} videos finished before"] if reused else []
        if stale:
            notes.append(f"{stale} tracked again, as row, setting or file have changed")
        self.start(work, notes)
        self.describe("tracking")
