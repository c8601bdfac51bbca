"""Facts about single sequences: the paper's names for them and the authors' constants.

The data is in paper.toml, with its sources.
"""

import functools
import tomllib
from importlib import resources
from typing import Any


def paper_name(sequence: str) -> str | None:
    """The name of a sequence in the paper's tables (OTB's Deer is `animal`), or None."""
    lowered = sequence.lower()
    for name, folders in _data()["folders"].items():
        if lowered in (folder.lower() for folder in folders):
            return str(name)
    return None


def authors_constants(sequence: str) -> dict[str, Any]:
    """Fields of `Config` as the authors' code sets them for a sequence.

    For a sequence that is not in the paper these are their general constants.
    """
    authors = _data()["authors"]
    special = authors["sequences"].get(paper_name(sequence), {})
    return {
        "selectors": special.get("N", authors["N"]),
        "block": 1 / special.get("divisor", authors["divisor"]),
    }


def otb_frame_range(sequence: str) -> tuple[int, int] | None:
    """First and last frame, from 1, where OTB takes only a part of a sequence; otherwise None."""
    frames = _data()["otb_frames"].get(sequence)
    return None if frames is None else (frames[0], frames[1])


@functools.cache
def _data() -> dict[str, Any]:
    text = resources.files(__package__).joinpath("paper.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)
