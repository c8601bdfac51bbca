"""`dcs-jax report`: the page of one or more folders of results."""

import importlib.util
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from dcs_jax.evaluation.report.tables import write_summary
from dcs_jax.evaluation.results import Results
from dcs_jax.evaluation.statistics import Spread
from dcs_jax.evaluation.summary import Summary, summarise

PAGE = "index.html"
NEEDS = ("jinja2", "matplotlib")
PIPED_WIDTH = 120


def report(
    folders: Annotated[
        list[Path],
        typer.Argument(metavar="DIR...", help="Folders of results.", show_default=False),
    ],
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder of the page.", show_default="the first DIR"),
    ] = None,
) -> None:
    """Make the page again from results; those of several folders become one.

    So the baselines of a different environment come into the same table.
    """
    check_report_needs()
    for folder in folders:
        if not (folder / "runs").is_dir():
            raise ValueError(
                f"{folder} holds no results: expected a folder that evaluate has written"
            )
    summary = summarise([Results(folder) for folder in folders])
    if not summary.rows:
        raise ValueError(f"{', '.join(map(str, folders))}: there is no result that can be read")
    out = out or folders[0]
    write_summary(summary, out)
    print_means(summary)
    typer.echo(write_page(summary, out))


def check_report_needs() -> None:
    """Raise ValueError where a package is missing that only the page needs."""
    missing = [name for name in NEEDS if importlib.util.find_spec(name) is None]
    if missing:
        raise ValueError(f"the page needs {' and '.join(missing)}: pip install 'dcs-jax[report]'")


def write_page(summary: Summary, out: Path) -> Path:
    """Write the page of a summary into a folder, and return its path."""
    # matplotlib takes a second to import, and is optional.
    from dcs_jax.evaluation.report import write_report

    return write_report(summary, out / PAGE)


def print_means(summary: Summary) -> None:
    """Print a table of the means of every setting over all sequences."""
    over = sorted({sequence for sequence, _ in summary.common}, key=str.lower)
    what = f"{len(over)} sequences" if len(over) != 1 else over[0]
    table = Table(title=f"{what}: mean over the seeds, with its 95 % interval")
    table.add_column("setting", overflow="fold")  # a name cut short says nothing
    for column in ("seeds", "centre error, px", "success rate", "AUC", "P@20", "frames/s"):
        table.add_column(column, justify="right")
    for setting, numbers in summary.overall.items():
        table.add_row(
            setting,
            str(numbers["centre_error"].n),
            _interval(numbers["centre_error"], 1),
            _interval(numbers["success_rate"], 3),
            _interval(numbers["auc"], 3),
            _interval(numbers["precision"], 3),
            f"{summary.speed[setting]:.0f}",
        )
    console = Console()
    if not console.is_terminal:
        console.width = PIPED_WIDTH
    console.print(table)


def _interval(values: Spread, digits: int) -> str:
    if values.n < 2:
        return f"{values.mean:.{digits}f}"
    return f"{values.mean:.{digits}f} ± {values.high - values.mean:.{digits}f}"
