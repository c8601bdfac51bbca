"""JSON of lists of records, with errors that name the record and the field."""

import itertools
import json
import math
import reprlib
from collections.abc import Container, Iterator
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from dcs_jax.formats.tracks import LAST_FRAME

_LARGEST = 1e30  # far below the end of float32
_SMALLEST = 1e-30  # pixels, a side

_SHORT = reprlib.Repr()  # of values of any size
_SHORT.maxstring = 60


class Record(NamedTuple):
    """A record and its place in the file. A field with two names may have either."""

    where: str
    fields: dict[str, Any]

    def __contains__(self, name: object) -> bool:
        return name in self.fields

    def count(self, *names: str) -> int:
        """A whole number from 0 on."""
        name, value = self._get(names)
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= 2**63 - 1:
            self.refuse(name, "a whole number from 0 on")
        return int(value)

    def frame(self, *names: str) -> int:
        """The index of a frame."""
        value = self.count(*names)
        if value > LAST_FRAME:
            self.refuse(self._get(names)[0], "a frame counted from 0")
        return value

    def number(self, name: str) -> float:
        """A finite number."""
        value = self._get((name,))[1]
        if not _is_number(value):
            self.refuse(name, "a finite number")
        return float(value)

    def text(self, name: str) -> str:
        """A text that is not empty."""
        value = self._get((name,))[1]
        if not isinstance(value, str) or not value:
            self.refuse(name, "a text")
        return str(value)

    def member(self, name: str, known: Container[int], where: str) -> int:
        """An id that is known."""
        value = self.count(name)
        if value not in known:
            self.refuse(name, f"the id of one of the {where}")
        return value

    def box(self, name: str) -> list[float]:
        """A box x, y, w, h in pixels."""
        value = self._get((name,))[1]
        if (
            not isinstance(value, list)
            or len(value) != 4
            or not all(map(_is_number, value))
            or min(value[2:]) < _SMALLEST
        ):
            self.refuse(name, "four finite numbers x, y, w, h with w and h positive")
        return [float(side) for side in value]

    def _get(self, names: tuple[str, ...]) -> tuple[str, Any]:
        for name in names:
            if name in self.fields:
                return name, self.fields[name]
        raise ValueError(f"{self.where} has no {' or '.join(names)}")

    def refuse(self, name: str, expected: str) -> NoReturn:
        """Raise ValueError: the field is there, but not what was expected."""
        raise ValueError(
            f"{self.where}.{name} is {_SHORT.repr(self.fields[name])}: expected {expected}"
        )


def load(path: Path) -> dict[str, Any]:
    """The object in a JSON file; ValueError names the line where it is none."""
    try:
        with open(path, encoding="utf-8-sig") as file:
            document = json.load(file, parse_constant=_refuse_constant)
    except json.JSONDecodeError as error:
        raise ValueError(f"{path}, line {error.lineno} is not JSON: {error.msg}") from None
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not UTF-8: {error}") from None
    except RecursionError:
        raise ValueError(f"{path} is nested too deeply: expected COCO's lists of records") from None
    except ValueError as error:  # a constant, or an integer of thousands of digits
        raise ValueError(f"{path}: {error}") from None
    if not isinstance(document, dict):
        raise ValueError(f"{path} holds a {type(document).__name__}: expected an object of COCO")
    return document


class Records:
    """The records of a list in a file. What is asked of them is asked of each."""

    def __init__(self, where: str, found: list[dict[str, Any]]) -> None:
        self._where, self._found = where, found

    def __len__(self) -> int:
        return len(self._found)

    def __iter__(self) -> Iterator[Record]:
        for number, fields in enumerate(self._found):
            yield Record(self.where(number), fields)

    def where(self, number: int) -> str:
        """The place of a record, for an error message."""
        return f"{self._where}[{number}]"

    def counts(self, *names: str) -> list[int]:
        """Whole numbers from 0 on."""
        values: list[Any] = [fields.get(names[0]) for fields in self._found]
        if set(map(type, values)) == {int} and min(values) >= 0 and max(values) < 2**63:
            return values
        return [record.count(*names) for record in self]

    def frames(self, *names: str) -> list[int]:
        """Indices of frames."""
        values = self.counts(*names)
        if max(values, default=0) > LAST_FRAME:
            return [record.frame(*names) for record in self]
        return values

    def members(self, name: str, known: Container[int], where: str) -> list[int]:
        """Ids that are known."""
        values = self.counts(name)
        for number, value in enumerate(values):
            if value not in known:
                Record(self.where(number), self._found[number]).member(name, known, where)
        return values

    def numbers(self, name: str) -> NDArray[np.float64]:
        """Finite numbers [m]; NaN where the field is missing or null."""
        values: list[Any] = [fields.get(name) for fields in self._found]
        if set(map(type, values)) <= {int, float}:
            found = np.array(values, np.float64)
            if (np.abs(found) <= _LARGEST).all():
                return found
        return np.array(
            [
                np.nan if value is None else record.number(name)
                for value, record in zip(values, self, strict=True)
            ]
        )

    def boxes(self, name: str) -> NDArray[np.float64]:
        """Boxes x, y, w, h in pixels, [m, 4]."""
        values: list[Any] = [fields.get(name) for fields in self._found]
        if all(type(value) is list and len(value) == 4 for value in values):
            kinds = set(map(type, itertools.chain.from_iterable(values)))
            if kinds <= {int, float}:
                found = np.array(values, np.float64).reshape(-1, 4)
                if (np.abs(found) <= _LARGEST).all() and (found[:, 2:] >= _SMALLEST).all():
                    return found
        # One is wrong, and is named.
        return np.array([record.box(name) for record in self]).reshape(-1, 4)


def records(path: Path, document: dict[str, Any], name: str, optional: bool = False) -> Records:
    """The records of a list; ValueError if there is none of that name, or it holds other things."""
    found = document.get(name, [] if optional else None)
    if found is None:
        raise ValueError(f"{path} has no {name}: expected COCO's JSON for videos")
    if not isinstance(found, list):
        raise ValueError(f"{path}: {name} is not a list of records")
    for number, fields in enumerate(found):
        if not isinstance(fields, dict):
            raise ValueError(f"{path}, {name}[{number}] is not a record")
    return Records(f"{path}, {name}", found)


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    return -_LARGEST <= value <= _LARGEST and math.isfinite(value)


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a number of JSON")
