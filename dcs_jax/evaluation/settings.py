"""Named settings of the tracker: a preset and changes of its fields, "paper selector=error".

Fields of a group have its name before them, "default scale.step=1.03", and a component is switched
off and on by "translation=none" and "translation=default".

The presets are `default` (`Config()`), `paper` (`Config.paper()`) and `authors`, which is `paper`
with the constants that the authors' code has for the sequence.
"""

import ast
import dataclasses
import re
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from dcs_jax.config import COMPONENTS, Config, check_not_renamed
from dcs_jax.evaluation.paper import authors_constants

PRESETS: dict[str, Callable[[str], Config]] = {
    "default": lambda sequence: Config(),
    "paper": lambda sequence: Config.paper(),
    "authors": lambda sequence: Config.paper(**authors_constants(sequence)),
}


FIELDS = [
    *(field.name for field in dataclasses.fields(Config)),
    *(
        f"{name}.{field.name}"
        for name, group in COMPONENTS.items()
        for field in dataclasses.fields(group)
    ),
]


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
        raise ValueError(f"{preset!r} is not a preset: expected one of {', '.join(PRESETS)}")
    fields: dict[str, Any] = dict(map(_parse_change, changes))

    def config(sequence: str) -> Config:
        return _replace(PRESETS[preset](sequence), fields)

    config("")  # wrong values are found before anything is run
    return Setting(" ".join([preset, *changes]), config)


def with_changes(presets: Iterable[str], changes: Iterable[str]) -> list[Setting]:
    """Every preset as it is, then every preset with each of the changes.

    changes: each NAME=VALUE, or several with commas between, which are then made together.
    """
    presets = list(presets)
    changed = [
        f"{preset} {' '.join(re.split(r',(?=[a-z_.]+=)', change))}"
        for change in changes
        for preset in presets
    ]
    return [parse_setting(text) for text in dict.fromkeys([*presets, *changed])]


def _parse_change(text: str) -> tuple[str, Any]:
    name, equals, word = text.partition("=")
    try:
        value = ast.literal_eval(word)
    except (SyntaxError, ValueError):
        value = word  # a word such as "error"
    check_not_renamed(name, value)
    if not equals or name not in FIELDS:
        raise ValueError(
            f"{text!r} is not a change of a field: expected NAME=VALUE with a name of "
            f"{', '.join(FIELDS)}"
        )
    if name in COMPONENTS and word in ("none", "default"):
        value = COMPONENTS[name]() if word == "default" else None
    return name, value


def _replace(config: Config, changes: dict[str, Any]) -> Config:
    """The settings with changed fields; those of a group by "group.field"."""
    fields = {name: value for name, value in changes.items() if "." not in name}
    for name, value in changes.items():
        group, dot, field = name.partition(".")
        if not dot:
            continue
        settings = fields.get(group, getattr(config, group))
        if settings is None:
            raise ValueError(f"{name} cannot be set where {group} is None: add {group}=default")
        fields[group] = dataclasses.replace(settings, **{field: value})
    return dataclasses.replace(config, **fields)
