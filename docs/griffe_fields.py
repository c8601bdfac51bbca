"""How the API page reads what is in the code: a Griffe extension for mkdocstrings.

Arguments and fields stand in docstrings as lines "name: text"; they become a list. A setting's
default is the first argument of what checks it, as in `share(0.03)`.
"""

import re
from typing import Any

import griffe

_MAKES_FIELD = re.compile(r"static|choice|count|number|not_negative|share")
_NAMES = re.compile(r"(\w+(?:, \w+)*): ")


class Fields(griffe.Extension):
    """Lists of arguments and fields, and defaults."""

    def on_function(self, *, func: griffe.Function, **kwargs: Any) -> None:
        """Its arguments."""
        _list_names(func, {parameter.name.lstrip("*") for parameter in func.parameters})

    def on_class(self, *, cls: griffe.Class, **kwargs: Any) -> None:
        """Its fields."""
        _list_names(cls, set(cls.members))

    def on_attribute(self, *, attr: griffe.Attribute, **kwargs: Any) -> None:
        """A setting's default."""
        value = attr.value
        if isinstance(value, griffe.ExprCall) and _MAKES_FIELD.fullmatch(str(value.function)):
            attr.value = value.arguments[0]


def _list_names(described: griffe.Object, names: set[str]) -> None:
    """Make a list item of every line "name: text", and of "one, other: text"."""
    if described.docstring is None:
        return
    lines = []
    inside = False  # an item, whose other lines are indented
    for line in described.docstring.value.splitlines():
        match = _NAMES.match(line)
        if match and names.issuperset(match[1].split(", ")):
            if not inside:
                lines.append("")
            shown = ", ".join(f"`{name}`" for name in match[1].split(", "))
            line = f"- {shown}: {line[match.end() :]}"
            inside = True
        elif not line.strip():
            inside = False
        elif inside:
            line = f"    {line.strip()}"
        lines.append(line)
    described.docstring.value = "\n".join(lines)
