"""Tracks kept in a file, to go on with them in the next part of a video."""

import dataclasses
import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, get_args, get_type_hints

import jax
import numpy as np

from dcs_jax.config import COMPONENTS, Config, check_config
from dcs_jax.io.files import atomic
from dcs_jax.types import State

FORMAT = 7  # of the file: another number is another layout
_KIND = "dcs_jax states"


class Saved(NamedTuple):
    """What `load` has read.

    states: by name, as they were given to `save`.
    config: their settings.
    """

    states: dict[str, State]
    config: Config


def save(path: str | Path, states: State | Mapping[str, State], config: Config) -> None:
    """Store states and their settings in one npz file, which takes its name when it is whole.

    states: one, stored with the name "", or several by name.
    config: the settings they were made with, each number one for all.

    Raises:
        ValueError: it is no state, or a number of the settings is an array.
        OSError: the file cannot be written.
    """
    named = {"": states} if isinstance(states, State) else dict(states)
    arrays: dict[str, Any] = {}
    for number, (name, state) in enumerate(named.items()):
        if not isinstance(state, State):
            raise ValueError(f"states[{name!r}] must be a dcs_jax.State, but is {state!r}")
        arrays |= {f"{number}/{key}": leaf for key, leaf in _leaves(state).items()}
    check_config(config)
    header = {
        "kind": _KIND,
        "format": FORMAT,
        "names": list(named),
        "config": _plain(dataclasses.asdict(config)),
    }
    text = np.frombuffer(json.dumps(header).encode(), np.uint8)
    with atomic(Path(path)) as file:
        np.savez_compressed(file, header=text, **arrays)


def load(path: str | Path) -> Saved:
    """The states and settings that `save` has stored.

    Raises:
        ValueError: the file is none of `save`, is cut short or damaged, or of another version.
        OSError: it cannot be read.
    """
    damaged = f"{path} is no file of dcs_jax.save, or is damaged or cut short"
    try:
        # Opened here: NumPy does not close a file that is no archive.
        with open(path, "rb") as content, np.load(content, allow_pickle=False) as file:
            header = json.loads(file["header"].tobytes())
            if header["kind"] != _KIND:
                raise ValueError(damaged)
            if header["format"] != FORMAT:
                raise ValueError(
                    f"{path} has the format {header['format']}, but this version of dcs_jax reads "
                    f"the format {FORMAT}"
                )
            arrays = {name: file[name] for name in file.files}
            config = _config(header["config"])
            names = list(map(str, header["names"]))
    except (zipfile.BadZipFile, EOFError, KeyError, TypeError, UnicodeDecodeError) as error:
        raise ValueError(f"{damaged} ({type(error).__name__})") from None
    except ValueError as error:
        raise (error if str(path) in str(error) else ValueError(f"{damaged} ({error})")) from None
    states = {name: _state(damaged, arrays, number) for number, name in enumerate(names)}
    return Saved(states, config)


def _leaves(tree: Any, prefix: str = "") -> dict[str, np.ndarray]:
    """The arrays of nested records by the names of their fields; None is left out."""
    if tree is None:
        return {}
    if not hasattr(tree, "_fields"):
        return {prefix: np.asarray(tree)}
    leaves: dict[str, np.ndarray] = {}
    for name in tree._fields:
        leaves |= _leaves(getattr(tree, name), f"{prefix}.{name}" if prefix else name)
    return leaves


def _state(damaged: str, arrays: Mapping[str, np.ndarray], number: int) -> State:
    def record(kind: Any, prefix: str) -> Any:
        """A record of this type, or None where there are none of its arrays."""
        optional = type(None) in get_args(kind)
        kinds = [k for k in get_args(kind) if k is not type(None)] if optional else [kind]
        if hasattr(kinds[0], "_fields"):
            if optional and not any(name.startswith(f"{prefix}.") for name in arrays):
                return None
            of_fields = get_type_hints(kinds[0])
            return kinds[0](
                *(record(of_fields[name], f"{prefix}.{name}") for name in kinds[0]._fields)
            )
        if prefix not in arrays:
            if optional:
                return None
            raise ValueError(f"{damaged} (it lacks {prefix})")
        return jax.numpy.asarray(arrays[prefix])

    fields = get_type_hints(State)
    return State(*(record(fields[name], f"{number}/{name}") for name in State._fields))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _plain(field) for name, field in value.items()}
    if isinstance(value, tuple):
        return list(value)
    if isinstance(value, (np.ndarray, np.generic, jax.Array)):
        if np.ndim(value):
            raise ValueError(f"config must have one number for all states, but has {value!r}")
        return np.asarray(value).item()
    return value


def _config(plain: dict[str, Any]) -> Config:
    fields = dict(plain)
    for name, group in COMPONENTS.items():
        if fields.get(name) is not None:
            fields[name] = group(**fields[name])
    if isinstance(fields.get("canvas"), list):
        fields["canvas"] = tuple(fields["canvas"])
    return Config(**fields)
