"""Files that are never half written, and names that are safe on any file system."""

import csv
import os
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]


@contextmanager
def atomic(path: Path, text: bool = False) -> Iterator[IO[Any]]:
    """Open a file for writing that takes its name only when all is written."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(".part", ".", path.parent)
    try:
        mode: dict[str, Any] = {"mode": "wb"}
        if text:
            # Names of files need not be UTF-8: they are written as they are.
            escape = "surrogateescape"
            mode = {"mode": "w", "encoding": "utf-8", "newline": "", "errors": escape}
        with open(handle, **mode) as file:
            yield file
        os.chmod(temporary, 0o644)  # a temporary file is readable to its owner only
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise


@contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """Make a folder that takes its name only when all is in it.

    Raises ValueError as `check_new_folder` does.
    """
    check_new_folder(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(".part", ".", path.parent))
    try:
        yield temporary
        temporary.chmod(0o755)  # a temporary folder is open to its owner only
        if path.is_dir():
            path.rmdir()
        temporary.rename(path)
    except BaseException:
        shutil.rmtree(temporary)
        raise


def check_new_folder(path: Path) -> None:
    """ValueError if there is a file, or a folder that is not empty, of that name."""
    if path.is_dir() and any(path.iterdir()):
        raise ValueError(f"{path} is there already and not empty: expected a new folder")
    if path.exists() and not path.is_dir():
        raise ValueError(f"{path} is a file: expected a new folder")


def remove(path: Path) -> None:
    """Remove a file, or a folder with all that is in it, if it is there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def write_table(path: Path, header: Iterable[str], rows: Iterable[Iterable[Any]]) -> None:
    """Write a CSV file with a header; it takes its name only when all rows are written."""
    with atomic(path, text=True) as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(header)
        table.writerows(rows)


def lock(file: IO[Any]) -> None:
    """Keep other runs from locking the same file until it is closed, or the process ends.

    Raises ValueError where another has it. Where the system has no such locks, nothing is done.
    """
    if fcntl is None:
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        name = file.name
        file.close()
        raise ValueError(f"{name} is being written by another run: wait, or name another") from None
    except OSError:  # the file system knows no locks
        pass


def safe_name(name: str, most: int = 255) -> str:
    """A name that is safe for a file or folder, of at most so many bytes.

    Blanks, slashes and the like become _.
    """
    safe = re.sub(r"[^\w=.,()\[\]-]", "_", name).encode()[:most]
    return safe.decode(errors="ignore")
