"""Which format the content of a file or folder is in."""

import re
from pathlib import Path

from dcs_jax.formats.yolo import LABELS
from dcs_jax.formats.yolo_classes import CLASSES, DATA

_HEAD = 4096  # bytes


def sniff(path: Path) -> str:
    """Name of the format.

    Raises:
        ValueError: the content is in none of the formats.
        OSError: the file cannot be read.
    """
    if path.is_dir():
        return _folder(path)
    with open(path, "rb") as file:
        head = file.read(_HEAD).decode("utf-8-sig", errors="replace").lstrip()
    if not head:
        raise ValueError(f"{path} is empty: expected tracks")
    if head[0] == "<":
        return "cvat"
    if head[0] == "{":
        return "coco"
    line = head.splitlines()[0].strip()
    fields = [field.strip() for field in re.split(r"\s*,\s*|\s+", line)]
    if "frame" in fields:
        return "csv"
    if all(map(_is_number, fields)):
        if len(fields) == 4:
            return "otb"
        if 6 <= len(fields) <= 10:
            return "mot"
    shown = line if len(line) <= 60 else f"{line[:60]}..."
    raise ValueError(
        f"{path} begins with {shown!r}: expected a table with a column frame (csv), "
        "x,y,w,h (otb), frame,id,x,y,w,h,... (mot), XML (cvat) or JSON (coco)"
    )


def _folder(path: Path) -> str:
    if any((path / name).exists() for name in (LABELS, DATA, CLASSES)):
        return "yolo"
    if any(path.glob("*.txt")):
        return "otb"
    raise ValueError(f"{path} is a folder without labels (yolo) or *.txt (otb): expected tracks")


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return True
