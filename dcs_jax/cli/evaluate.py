"""`dcs-jax evaluate`: settings and baselines on labelled sequences, with a report."""

import re
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from dcs_jax.cli.errors import BROKEN_SOURCE, INTERRUPTED
from dcs_jax.cli.progress import WorkBar
from dcs_jax.cli.report import PAGE, check_report_needs, print_means, write_page
from dcs_jax.compilation import cache
from dcs_jax.evaluation.experiment import Watch
from dcs_jax.evaluation.experiment import evaluate as run_evaluation
from dcs_jax.evaluation.settings import with_changes


class ProtocolName(StrEnum):
    """The protocols to choose from."""

    ope = "ope"
    tre = "tre"
    sre = "sre"


def evaluate(
    root: Annotated[
        Path,
        typer.Argument(
            metavar="ROOT",
            help="Folder of sequences (OTB, MIL, VOT, GOT-10k, or videos with a CSV file each).",
            show_default=False,
        ),
    ],
    sequences: Annotated[
        str | None,
        typer.Option(metavar="A,B", help="Only these sequences.", show_default="all"),
    ] = None,
    presets: Annotated[
        str,
        typer.Option(metavar="A,B", help="From default, paper, authors; changes after a blank."),
    ] = "default",
    changes: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help="Also run every preset with this change; repeatable, commas for several at once.",
            show_default=False,
        ),
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, help="Seeds of every setting, in one batch.")] = 30,
    baselines: Annotated[
        str | None,
        typer.Option(
            metavar="A,B",
            help="Trackers of OpenCV: opencv for all that are installed, or MIL,KCF,CSRT,...",
            show_default=False,
        ),
    ] = None,
    protocol: Annotated[
        ProtocolName, typer.Option(help="One pass, 20 starts, or 12 disturbed boxes.")
    ] = ProtocolName.ope,
    published: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Published results to compare with.", show_default=False),
    ] = None,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the results.")] = Path(
        "report"
    ),
    page: Annotated[
        bool, typer.Option("--page/--no-page", help=f"Whether to write {PAGE}.")
    ] = True,
    peers: Annotated[str | None, typer.Option(hidden=True)] = None,
) -> None:
    """Run settings on labelled sequences and report how good they are.

    Results are written as they finish: the same command continues where it was stopped.
    The exit code is 3 if a sequence was broken, and 130 after Ctrl-C.
    """
    if peers is not None:
        raise ValueError("--peers is now --baselines")
    if page:
        check_report_needs()
    cache()
    settings = with_changes(_split(presets, _BEFORE_A_NAME), changes or [])
    with EvaluationBar() as bar:
        done = run_evaluation(
            root,
            out,
            sequences=_split(sequences) if sequences is not None else None,
            settings=[setting.name for setting in settings],
            seeds=seeds,
            baselines=_split(baselines or ""),
            protocol=protocol.value,
            published=published,
            watch=bar,
        )
    if done.summary.rows:
        print_means(done.summary)
        if page:
            typer.echo(write_page(done.summary, out))
    for broken in done.broken:
        typer.echo(f"skipped {broken}", err=True)
    if done.interrupted:
        typer.echo("interrupted: the same command continues from here", err=True)
        raise typer.Exit(INTERRUPTED)
    if done.broken:
        raise typer.Exit(BROKEN_SOURCE)


_BEFORE_A_NAME = r",(?=\s*[a-z])"  # not the comma of canvas=(40,30)


def _split(text: str, separator: str = ",") -> list[str]:
    return [part.strip() for part in re.split(separator, text) if part.strip()]


class EvaluationBar(WorkBar, Watch):
    """A progress bar over all track-frames, on stderr, shown on a terminal only."""

    def __init__(self) -> None:
        super().__init__("reading")

    def planned(self, work: int, reused: int, stale: int, runs: int) -> None:
        """Print what is reused, and set the bar to what is left."""
        notes = [f"{reused} of {runs} runs reused"] if reused else []
        if stale:
            notes.append(f"{stale} run again, as setting, code or data have changed")
        self.start(work, notes)

    def working(self, what: str) -> None:
        """Show what is being run."""
        self.describe(what)
