"""The fields of a class of settings: what each may be, and which of them are leaves of a pytree."""

import dataclasses
import functools
import math
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from dcs_jax.checks import INT32, check_choice, check_count, shown

Check = Callable[[str, Any], Any]  # of a field's name and value: the value to keep, or ValueError

# What a number of the settings may be: with larger ones, float32 overflows somewhere.
_LARGEST_NUMBER = 1e9


def check_between(name: str, value: Any, expected: str, low: float, high: float) -> float:
    """The value as a Python number, which no other type promotes."""
    real = isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)
    try:
        known = float(value) if real else math.nan
    except OverflowError:  # of an integer of many digits
        known = math.inf
    if not low < known < high:
        raise ValueError(f"{name} must be {expected}, but is {shown(value)}")
    return known


def _check_numbers(
    name: str, value: Any, expected: str, least: float, limit: float, whole: bool = False
) -> Any:
    """The value, a number or an array of numbers in [least, limit); whole: of integers.

    Values that are not known pass: those of tracers and of shapes, and in `track_batch` those of
    arrays that lie in other processes.
    """
    kinds = "integers" if whole else "numbers"
    one = "an integer" if whole else "a number"
    wrong: Any
    if isinstance(value, (np.ndarray, np.generic, jax.Array, jax.ShapeDtypeStruct)):
        types = (jnp.integer,) if whole else (jnp.integer, jnp.floating)
        if not any(jnp.issubdtype(value.dtype, kind) for kind in types):
            raise ValueError(
                f"{name} must be {one} or an array of {kinds}, but has the type {value.dtype}"
            )
        if 0 in value.shape:
            raise ValueError(f"{name} must not be empty, but has the shape {value.shape}")
        if isinstance(value, (jax.core.Tracer, jax.ShapeDtypeStruct)) or (
            isinstance(value, jax.Array) and not value.is_fully_addressable
        ):
            return value
        numbers = np.asarray(value).astype(np.float64).reshape(-1)
        wrong = numbers[~((numbers >= least) & (numbers < limit))]
    elif isinstance(value, int if whole else (int, float)) and not isinstance(value, bool):
        # A Python integer may have any number of digits, and then no type of NumPy's.
        wrong = [] if least <= value < limit else [value]
    else:
        raise ValueError(f"{name} must be {one} or an array of {kinds}, but is {shown(value)}")
    if len(wrong):
        if limit <= wrong[0] < math.inf and limit > _LARGEST_NUMBER:
            expected = f"at most {INT32 if whole else '1e9'}"
        given = shown(value) if np.ndim(value) == 0 else f"in part {wrong[0]:g}"
        raise ValueError(f"{name} must be {expected}, but is {given}")
    return value


def _check_group(name: str, value: Any, group: type) -> Any:
    if value is not None and not isinstance(value, group):
        raise ValueError(
            f"{name} must be a dcs_jax.{group.__name__} or None, but is {shown(value)}"
        )
    return value


def static(default: Any, check: Callable[..., Any], **limits: Any) -> Any:
    """A field that defines shapes or chooses code: part of what is compiled."""
    metadata = {"static": True, "check": functools.partial(check, **limits)}
    return dataclasses.field(default=default, metadata=metadata)


def choice(default: Any, *choices: Any) -> Any:
    """A static field, one of the choices."""
    return static(default, check_choice, choices=choices)


def count(default: int) -> Any:
    """A static field, an integer of at least 1."""
    return static(default, check_count)


def number(default: float, expected: str, least: float, limit: float, whole: bool = False) -> Any:
    """A field that is a leaf of the pytree, in [least, limit): it can be swept and vmapped."""
    limits: dict[str, Any] = {"expected": expected, "least": least, "limit": limit, "whole": whole}
    check = functools.partial(_check_numbers, **limits)
    metadata = {"check": check, "dtype": np.int32 if whole else np.float32}
    return dataclasses.field(default=default, metadata=metadata)


def not_negative(default: float) -> Any:
    """A leaf from 0 to 1e9."""
    limit = math.nextafter(_LARGEST_NUMBER, math.inf)
    return number(default, "finite and not negative", 0, limit)


def share(default: float) -> Any:
    """A leaf from 0 to 1."""
    return number(default, "from 0 to 1", 0, 1 + 1e-6)


def group(settings: type) -> Any:
    """A component's settings, or None to switch it off; by default it is on."""
    metadata = {"group": settings, "check": functools.partial(_check_group, group=settings)}
    return dataclasses.field(default=settings(), metadata=metadata)


def check_fields(settings: Any) -> None:
    """ValueError where a field is not as its metadata demands; NumPy's static numbers are Python's.

    Only where settings are written: JAX rebuilds them without a check, around whatever it puts in
    the place of the numbers (`pytree`).
    """
    for field in dataclasses.fields(settings):
        check: Check = field.metadata["check"]
        object.__setattr__(settings, field.name, check(field.name, getattr(settings, field.name)))


_Class = TypeVar("_Class")


def pytree(settings: type[_Class]) -> type[_Class]:
    """Register a dataclass whose fields are leaves, or groups of them, or static.

    `jax.tree_util.register_dataclass` calls the class, and so its checks, with JAX's placeholders:
    objects, None, axes, truth values, strings. A check that lets them pass lets mistakes pass, too.
    """
    fields = dataclasses.fields(settings)  # type: ignore[arg-type]  # a class of any kind
    leaves = [field.name for field in fields if not field.metadata.get("static")]
    static = [field.name for field in fields if field.metadata.get("static")]

    def flatten(made: _Class) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        return tuple(getattr(made, name) for name in leaves), tuple(
            getattr(made, name) for name in static
        )

    def flatten_with_keys(made: _Class) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        values, structure = flatten(made)
        keys = map(jax.tree_util.GetAttrKey, leaves)
        return tuple(zip(keys, values, strict=True)), structure

    def unflatten(structure: tuple[Any, ...], values: Iterable[Any]) -> _Class:
        made = object.__new__(settings)
        for name, value in zip((*static, *leaves), (*structure, *values), strict=True):
            object.__setattr__(made, name, value)
        return made

    jax.tree_util.register_pytree_with_keys(settings, flatten_with_keys, unflatten, flatten)
    return settings
