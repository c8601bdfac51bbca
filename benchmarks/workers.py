"""Long-lived processes that are asked line by line, each with a Python or a checkout of its own."""

import contextlib
import json
import os
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Self

HERE = Path(__file__).resolve().parents[1]  # this checkout


class Worker:
    """A process that answers each line it reads with one, both of JSON.

    What else it has to say goes to the standard error. Use it in a `with`.
    """

    def __init__(
        self, command: Sequence[str | Path], environment: Mapping[str, str] | None = None
    ) -> None:
        """Start it with these changes of the environment."""
        self._command = [str(part) for part in command]
        self._process = subprocess.Popen(
            self._command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, **(environment or {})},
        )

    def __enter__(self) -> Self:
        """Itself."""
        return self

    def __exit__(self, *raised: object) -> None:
        """End it: there is nothing more to read."""
        if raised[0] is not None:
            self._process.kill()
        self._process.communicate()

    def ask(self, question: Any = None) -> Any:
        """What it answers; RuntimeError where it has ended."""
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # the missing answer says it
            self._process.stdin.write(json.dumps(question) + "\n")
            self._process.stdin.flush()
        return self.read()

    def read(self) -> Any:
        """The next line it writes; RuntimeError where it has ended."""
        assert self._process.stdout is not None
        answer = self._process.stdout.readline()
        if not answer:
            command = " ".join(self._command)
            raise RuntimeError(f"{command} ended with {self._process.wait()}")
        return json.loads(answer)


def answer_of(command: Sequence[str | Path], environment: Mapping[str, str] | None = None) -> Any:
    """The one line that a process writes."""
    with Worker(command, environment) as worker:
        return worker.read()
