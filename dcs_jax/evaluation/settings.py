"""Named settings of the tracker: a preset and changes of its fields, "paper selector=error".

The presets are `default` (`Config()`), `paper` (`Config.paper()`) and `authors`, which is `paper`
with the constants that the authors' code has for the sequence.
"""

import ast
import dataclasses
import re
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from dcs_jax.config import Config
from dcs_jax.evaluation.paper import authors_constants

PRESETS: dict[str, Callable[[str], Config]] = {
    "default": lambda sequence: Config(),
    "paper": lambda sequence: Config.paper(),
    "authors": lambda sequence: Config.paper(**authors_constants(sequence)),
}


class Setting(NamedTuple):
    """A name and the settings it stands for on a sequence.

    config: from the sequence's name to its `Config`.
    """

    name: str
    config: Callable[[str], Config]


def parse_setting(text: str) -> Setting:
    """A setting from its name: a preset, then any changes NAME=VALUE with blanks between.

    Raises ValueError for an unknown preset or field, or a value out of its range.
    """
    preset, *changes = text.split() or [""]
    if preset not in PRESETS:
        raise ValueError(f"{preset!r} is no preset: expected one of {', '.join(PRESETS)}")
    fields: dict[str, Any] = dict(map(_parse_change, changes))

    def config(sequence: str) -> Config:
        return dataclasses.replace(PRESETS[preset](sequence), **fields)

    config("")  # wrong values are found before anything is run
    return Setting(" ".join([preset, *changes]), config)


def with_changes(presets: Iterable[str], changes: Iterable[str]) -> list[Setting]:
    """Every preset as it is, then every preset with each of the changes.

    changes: each NAME=VALUE, or several with commas between, which are then made together.
    """
    presets = list(presets)
    changed = [
        f"{preset} {' '.join(re.split(r',(?=[a-z_]+=)', change))}"
        for change in changes
        for preset in presets
    ]
    return [parse_setting(text) for text in dict.fromkeys([*presets, *changed])]


def _parse_change(text: str) -> tuple[str, Any]:
    name, equals, value = text.partition("=")
    names = [field.name for field in dataclasses.fields(Config)]
    if not equals or name not in names:
        raise ValueError(
            f"{text!r} is no change of a field: expected NAME=VALUE with a name of "
            f"{', '.join(names)}"
        )
    try:
        return name, ast.literal_eval(value)
    except (SyntaxError, ValueError):
        return name, value  # a word such as "error"
