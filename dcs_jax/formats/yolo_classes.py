"""What a folder of YOLO says of its classes and of the clip: data.yaml, or classes.txt."""

import importlib.util
import json
import re
from pathlib import Path
from typing import Any, NamedTuple

from dcs_jax.formats.records import Record

DATA, CLASSES = "data.yaml", "classes.txt"


class Facts(NamedTuple):
    """Names of the classes, and the fields of `Tracks`, None where they are unknown."""

    names: dict[int, str]
    size: tuple[int, int] | None = None
    length: int | None = None
    source: str | None = None
    fps: float | None = None

    def label(self, number: int) -> str:
        """The name of a class, or its number."""
        return self.names.get(number) or str(number)


def facts_of(path: Path) -> Facts:
    """Names of classes, and what else a file says of the clip."""
    if (path / DATA).is_file():
        record = Record(str(path / DATA), _load_yaml(path / DATA))
        return Facts(
            _names(record),
            _size(record) if "size" in record else None,
            record.frame("length") if "length" in record else None,
            record.text("source") if "source" in record else None,
            record.number("fps") if "fps" in record else None,
        )
    if (path / CLASSES).is_file():
        return Facts(dict(enumerate(lines_of(path / CLASSES))))
    return Facts({})


def lines_of(file: Path) -> list[str]:
    """The lines of a text file; ValueError if it is none."""
    try:
        return file.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise ValueError(f"{file} is not text: {error}") from None


def _names(record: Record) -> dict[int, str]:
    found = record.fields.get("names")
    pairs: Any = enumerate(found) if isinstance(found, list) else ()
    if isinstance(found, dict):
        pairs = found.items()
    names = {}
    for number, name in pairs:
        # YAML makes a number, or a truth value, of some names.
        if not isinstance(name, (str, int, float)) or not re.fullmatch("[0-9]{1,9}", str(number)):
            record.refuse("names", "a list of names, or numbers with names")
        names[int(number)] = str(name)
    return names


def _size(record: Record) -> tuple[int, int]:
    found = record.fields["size"]
    whole = isinstance(found, list) and len(found) == 2 and all(type(n) is int for n in found)
    if not whole or min(found) < 1:
        record.refuse("size", "a width and a height in pixels")
    return found[0], found[1]


def _load_yaml(file: Path) -> dict[str, Any]:
    """The mapping in a YAML file; without PyYAML, if it is JSON, as ours are."""
    text = "\n".join(lines_of(file))
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        if importlib.util.find_spec("yaml") is None:
            raise ValueError(f"{file} needs PyYAML to be read: pip install pyyaml") from None
        import yaml

        try:
            found = yaml.safe_load(text)
        except (yaml.YAMLError, RecursionError, ValueError) as error:
            raise ValueError(f"{file} is not YAML: {error}") from None
    if not isinstance(found, dict):
        raise ValueError(f"{file} holds a {type(found).__name__}: expected names of classes")
    return found
