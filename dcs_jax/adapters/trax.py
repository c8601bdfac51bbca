"""A process that speaks TraX over its standard streams, as the VOT toolkit starts trackers.

In the toolkit's trackers.ini:

    [dcs_jax]
    label = dcs_jax
    protocol = trax
    command = python -m dcs_jax.adapters.trax

A message is a line, @@TRAX: and its name, with arguments that may be quoted (version 1 of the
protocol, https://trax.readthedocs.io/en/latest/protocol.html). This server says `hello`, answers
`initialize` (image, region) and `frame` (image) with `state` (region), and ends with `quit`. Images
are paths, regions are rectangles left, top, width, height. A message that is none of these, or a
wrong image or box, is answered with `quit` and the reason.
"""

import math
import re
import sys
from collections.abc import Iterable
from typing import Any, TextIO

import cv2
import numpy as np
from numpy.typing import NDArray

import dcs_jax
from dcs_jax.io.annotations import parse_numbers

PREFIX = "@@TRAX:"
_SCHEME = "file://"
_REGION = "a rectangle left,top,width,height"
# An argument, in quotes or without; in both, a backslash is before what it escapes.
_ARGUMENT = re.compile(r'\s*(?:"((?:[^"\\]|\\.)*)"|((?:[^"\s\\]|\\.)+))(?=\s|$)')


def serve(tracker: dcs_jax.Tracker, source: Iterable[str], sink: TextIO) -> None:
    """Answer the messages of a client until it quits, or there are no more.

    tracker: of frames in the order "bgr".

    Raises ValueError after the client has been told what is wrong with its message.
    """
    _say(sink, "hello", "trax.version=1", "trax.name=dcs_jax", "trax.image=path;",
         "trax.region=rectangle;")  # fmt: skip
    try:
        for line in source:
            if not line.startswith(PREFIX):
                continue
            name, arguments = parse(line)
            if name == "quit":
                break
            _say(sink, "state", *_answer(tracker, name, arguments))
    except ValueError as error:
        _say(sink, "quit", f"trax.reason={error}")
        raise


def parse(line: str) -> tuple[str, list[str]]:
    """Name and arguments of a message; ValueError if it is none."""
    name, _, rest = line.removeprefix(PREFIX).rstrip("\r\n").partition(" ")
    arguments, at, rest = [], 0, rest.rstrip()
    while at < len(rest):
        match = _ARGUMENT.match(rest, at)
        if match is None:
            raise ValueError(f"the message {name} has an argument that cannot be read: {rest!r}")
        text = match[2] if match[1] is None else match[1]
        arguments.append(re.sub(r"\\(.)", lambda m: "\n" if m[1] == "n" else m[1], text))
        at = match.end()
    return name, arguments


def _answer(tracker: dcs_jax.Tracker, name: str, arguments: list[str]) -> list[str]:
    """The arguments of the state: region, and the confidence if there is one."""
    least = {"initialize": 2, "frame": 1}.get(name)
    if least is None or len(arguments) < least:
        raise ValueError(
            f"the message is {name} with {len(arguments)} arguments: expected initialize with an "
            "image and a region, frame with an image, or quit"
        )
    image = _read(arguments[0])
    if name == "initialize":
        tracker.init(image, parse_numbers(arguments[1], "the region", (4,), _REGION))
    else:
        tracker.update(image)
    region = ",".join(f"{side:.4f}" for side in tracker.result.box)
    confidence = tracker.result.confidence
    return [region] if math.isnan(confidence) else [region, f"confidence={confidence:.4f}"]


def _read(url: str) -> NDArray[np.uint8]:
    path = url.removeprefix(_SCHEME)
    image: Any = cv2.imread(path, cv2.IMREAD_COLOR)
    if image is None:
        raise ValueError(f"{path} cannot be read as an image")
    return np.asarray(image)


def _say(sink: TextIO, name: str, *arguments: str) -> None:
    quoted = (re.sub(r'(["\\])', r"\\\1", text).replace("\n", r"\n") for text in arguments)
    print(f"{PREFIX}{name}", *(f'"{text}"' for text in quoted), file=sink, flush=True)


if __name__ == "__main__":
    dcs_jax.cache()
    try:
        serve(dcs_jax.Tracker(order="bgr"), sys.stdin, sys.stdout)
    except (ValueError, BrokenPipeError) as reason:
        sys.exit(f"error: {reason}")
