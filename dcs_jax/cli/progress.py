"""Progress bars on stderr, shown on a terminal only."""

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
    """A progress bar after its description and before these columns."""
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
    """A progress bar with the time left, for work whose amount is known only after planning."""

    def __init__(self, description: str) -> None:
        """description: what is done while the work is planned."""
        self._progress = bar(TaskProgressColumn(), TimeRemainingColumn())
        self._task = self._progress.add_task(description, total=None)

    def __enter__(self) -> Self:
        """Show the bar."""
        self._progress.start()
        return self

    def __exit__(self, *error: object) -> None:
        """Remove the bar."""
        self._progress.stop()

    def start(self, work: int, notes: list[str]) -> None:
        """Print the notes, if any, and set the total to the work that is left."""
        if notes:
            typer.echo(", ".join(notes))
        self._progress.update(self._task, total=work)

    def describe(self, what: str) -> None:
        """Set the description to what is being done."""
        self._progress.update(self._task, description=what)

    def advance(self, work: int) -> None:
        """Add the work that is done."""
        self._progress.advance(self._task, work)
