"""How the command line reports errors: one line, no traceback."""

import sys
from typing import Any

import typer
from typer.core import TyperGroup

from dcs_jax.io.frames import BrokenSource

BAD_INPUT = 2
BROKEN_SOURCE = 3
INTERRUPTED = 130  # as shells report a process that Ctrl-C ended


class OneLineErrors(TyperGroup):
    """Subcommands whose errors become one line on stderr and an exit code.

    A `BrokenSource` exits with 3; any other ValueError or OSError and a wrong call with 2.
    """

    def main(self, *args: Any, **extra: Any) -> Any:
        """Run the command line and exit; errors are raised with `standalone_mode=False`."""
        if not extra.pop("standalone_mode", True):
            return self._run(*args, **extra)
        try:
            code = self._run(*args, **extra)
        except BrokenSource as error:
            code = _report(str(error), BROKEN_SOURCE)
        except typer.TyperException as error:
            code = _report(error.format_message(), BAD_INPUT)
        except OSError as error:
            what = error.strerror or str(error)
            code = _report(f"{error.filename}: {what}" if error.filename else what, BAD_INPUT)
        except ValueError as error:
            code = _report(str(error), BAD_INPUT)
        sys.exit(code)

    def _run(self, *args: Any, **extra: Any) -> Any:
        extra["standalone_mode"] = False
        return super().main(*args, **extra)


def warn(message: str) -> None:
    """Print one line on stderr, and go on."""
    typer.secho("warning: ", fg="yellow", bold=True, nl=False, err=True)
    typer.echo(" ".join(message.split()), err=True)


def _report(message: str, code: int) -> int:
    typer.secho("error: ", fg="red", bold=True, nl=False, err=True)
    typer.echo(" ".join(message.split()), err=True)
    return code
