"""Files that are never half there, and names that are safe on any file system."""

import csv
import os
import re
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import IO, Any


class atomic:  # noqa: N801 (reads as a verb: with atomic(path) as file)
    """A file to write that takes its name only when all is written; a context manager."""

    def __init__(self, path: Path, text: bool = False) -> None:
        self._path, self._text = path, text

    def __enter__(self) -> IO[Any]:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        handle, self._temporary = tempfile.mkstemp(".part", ".", self._path.parent)
        self._file: IO[Any] = (
            os.fdopen(handle, "w", encoding="utf-8", newline="")
            if self._text
            else os.fdopen(handle, "wb")
        )
        return self._file

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        self._file.close()
        if kind is None:
            os.chmod(self._temporary, 0o644)  # a temporary file is readable to its owner only
            os.replace(self._temporary, self._path)
        else:
            os.unlink(self._temporary)


def write_table(path: Path, header: Iterable[str], rows: Iterable[Iterable[Any]]) -> None:
    """Write a CSV file with a header; it takes its name only when all rows are written."""
    with atomic(path, text=True) as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(header)
        table.writerows(rows)


def safe_name(name: str) -> str:
    """A name that is safe as a file's or folder's: blanks, slashes and the like become _."""
    return re.sub(r"[^\w=.,()\[\]-]", "_", name)
