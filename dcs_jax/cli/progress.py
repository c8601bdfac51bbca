"""Bars that show how far a command is, on stderr, on a terminal only."""

from typing import Self

import typer
from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)


def bar(*columns: ProgressColumn) -> Progress:
    """A bar with what is being done before it and these columns behind it."""
    console = Console(stderr=True)
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        *columns,
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )


class WorkBar:
    """A bar over work whose amount is known once it is planned, with the time left."""

    def __init__(self, description: str) -> None:
        """description: what is done before the work is known."""
        self._progress = bar(TaskProgressColumn(), TimeRemainingColumn())
        self._task = self._progress.add_task(description, total=None)

    def __enter__(self) -> Self:
        """Show it."""
        self._progress.start()
        return self

    def __exit__(self, *error: object) -> None:
        """Take it away."""
        self._progress.stop()

    def start(self, work: int, notes: list[str]) -> None:
        """Print the notes, if any, and set the bar to the work that is left."""
        if notes:
            typer.echo(", ".join(notes))
        self._progress.update(self._task, total=work)

    def describe(self, what: str) -> None:
        """Name what is being done."""
        self._progress.update(self._task, description=what)

    def advance(self, work: int) -> None:
        """Move the bar."""
        self._progress.advance(self._task, work)
