"""What the page may ask for, and of which types: anything else is refused."""

import json
from typing import Any

from dcs_jax.checks import INT32, check_count, shown

Message = dict[str, Any]
_LONGEST_NAME = 200  # characters

_FIELDS: dict[str, tuple[str, ...]] = {
    "add": ("frame", "box"),
    "set": ("id", "frame", "box?"),
    "remove": ("id", "frame"),
    "rename": ("id", "name"),
    "delete": ("id",),
    "undo": (),
    "redo": (),
    "doubtful": ("frame", "id?"),
    "pause": (),
    "resume": (),
}


def parse(text: str) -> tuple[str, Message]:
    """The name of a request and its arguments; ValueError where it is none that is known."""
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        raise ValueError(f"a request must be JSON, but is {shown(text)}") from None
    name = content.get("type") if isinstance(content, dict) else None
    if not isinstance(name, str) or name not in _FIELDS:
        raise ValueError(f"a request must be one of {', '.join(_FIELDS)}, but is {shown(content)}")
    return name, {
        field.rstrip("?"): _value(field, content.get(field.rstrip("?"))) for field in _FIELDS[name]
    }


def _value(field: str, value: Any) -> Any:
    if field.endswith("?") and value is None:
        return None
    field = field.rstrip("?")
    if field in ("id", "frame"):
        return check_count(field, value, least=0, most=INT32)
    if field == "name":
        if not isinstance(value, str) or len(value) > _LONGEST_NAME:
            raise ValueError(
                f"name must be text of at most {_LONGEST_NAME} characters, but is {shown(value)}"
            )
        return value.strip()
    numbers = isinstance(value, list) and len(value) == 4
    if not numbers or not all(type(side) in (int, float) for side in value):
        raise ValueError(f"box must be four numbers x, y, w, h in pixels, but is {shown(value)}")
    return value
