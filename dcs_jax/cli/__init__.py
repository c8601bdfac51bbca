"""The command `dcs-jax`."""

from typing import Annotated

import typer

import dcs_jax
from dcs_jax.cli.batch import batch
from dcs_jax.cli.convert import convert
from dcs_jax.cli.demo import demo
from dcs_jax.cli.environment import end_like_ctrl_c, print_any_name, silence_opencv
from dcs_jax.cli.errors import OneLineErrors
from dcs_jax.cli.evaluate import evaluate
from dcs_jax.cli.label import export, label
from dcs_jax.cli.report import report
from dcs_jax.cli.track import track

app = typer.Typer(
    cls=OneLineErrors,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command()(track)
app.command()(demo)
app.command()(evaluate)
app.command()(report)
app.command()(batch)
app.command()(convert)
app.command()(label)
app.command()(export)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"dcs-jax {dcs_jax.__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def main(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_show_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    """Track one object through a video with part-based online boosting."""
    silence_opencv()
    end_like_ctrl_c()
    print_any_name()
    if context.invoked_subcommand is None:
        typer.echo(context.get_help(), nl=False)
