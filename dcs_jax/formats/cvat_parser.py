"""The XML of CVAT for video as lists of numbers: each box once, with its line, and no tree."""

import math
from pathlib import Path
from typing import Any, NamedTuple
from xml.parsers import expat

from dcs_jax.formats.tracks import LAST_FRAME

_CORNERS = ("xtl", "ytl", "xbr", "ybr")
_LARGEST = 1e30  # pixels: far below the end of float32, so that sides are finite, too


class Shapes(NamedTuple):
    """The boxes of a track in the order of the file.

    id, label: of the track. lines, frames: of each box. corners: left, top, right, bottom in
    pixels. outside, keyframes: the flags of each box.
    """

    id: str
    label: str
    lines: list[int]
    frames: list[int]
    corners: list[tuple[float, ...]]
    outside: list[bool]
    keyframes: list[bool]


class Clip(NamedTuple):
    """What the file says of the clip, None where it does not: pixels, frames, and its name."""

    size: tuple[int, int] | None
    length: int | None
    source: str | None


def parse(path: Path) -> tuple[Clip, list[Shapes]]:
    """The clip and the tracks of a file; ValueError names the line."""
    return _Parser(path).parse()


class _Parser:
    """Handlers of the elements, and what they have found."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._tags: list[str] = []  # of the elements around
        self._tracks: list[Shapes] = []
        self._meta: dict[str, str] = {}  # text of the elements in <meta>, by their path
        self._images = False
        # Whatever encoding it declares: Python would look for a codec of that name.
        self._expat = expat.ParserCreate("utf-8")
        self._expat.buffer_text = True
        self._expat.StartDoctypeDeclHandler = self._doctype
        self._expat.StartElementHandler = self._start
        self._expat.EndElementHandler = self._end
        self._expat.CharacterDataHandler = self._text

    def parse(self) -> tuple[Clip, list[Shapes]]:
        try:
            with open(self._path, "rb") as file:
                self._expat.ParseFile(file)
        except expat.ExpatError as error:
            what = expat.ErrorString(error.code)
            raise ValueError(f"{self._path}, line {error.lineno} is not XML: {what}") from None
        if self._images and not self._tracks:
            raise ValueError(
                f"{self._path} is an annotation of images: expected CVAT for video, with tracks"
            )
        return self._clip(), self._tracks

    def _clip(self) -> Clip:
        size = None
        sides = [self._count_of(f"original_size/{side}") for side in ("width", "height")]
        if sides[0] and sides[1]:
            size = (sides[0], sides[1])
        source = self._meta.get("source") or self._meta.get("name")
        return Clip(size, self._count_of("size") or None, source or None)

    def _count_of(self, name: str) -> int | None:
        text = self._meta.get(name, "").strip()
        if not text:
            return None
        if not text.isdecimal() or int(text[:12]) > LAST_FRAME:
            raise ValueError(f"{self._path}: {name} in meta is {text!r}: expected a whole number")
        return int(text)

    def _doctype(self, *_: Any) -> None:
        raise self._error("has a document type, which is refused: expected plain XML of CVAT")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        if not self._tags and tag != "annotations":
            raise self._error(f"begins with <{tag}>: expected <annotations>, as CVAT writes")
        if tag == "track":
            if not attributes.get("label"):
                raise self._error("has a track without a label")
            number = attributes.get("id") or str(len(self._tracks))
            self._tracks.append(Shapes(number, attributes["label"], [], [], [], [], []))
        elif tag == "box" and self._tags[-1] == "track":
            self._box(attributes)
        self._images |= tag == "image"
        self._tags.append(tag)

    def _end(self, tag: str) -> None:
        self._tags.pop()

    def _text(self, text: str) -> None:
        # meta/task/size, meta/job/size, meta/task/original_size/width, meta/source
        if self._tags[1:2] == ["meta"]:
            inner = self._tags[2:]
            if inner[:1] in (["task"], ["job"]):
                inner = inner[1:]
            name = "/".join(inner)
            if name in ("size", "name", "source", "original_size/width", "original_size/height"):
                self._meta[name] = self._meta.get(name, "") + text

    def _box(self, attributes: dict[str, str]) -> None:
        track = self._tracks[-1]
        frame = self._attribute(attributes, "frame")
        if not frame.isdecimal() or len(frame) > 10 or int(frame) > LAST_FRAME:
            raise self._wrong("frame", frame, "a frame counted from 0")
        corners = tuple(self._number(attributes, name) for name in _CORNERS)
        outside = self._flag(attributes, "outside", "0")
        if not outside:
            for low, high in ((0, 2), (1, 3)):
                if corners[high] <= corners[low]:
                    name = _CORNERS[high]
                    raise self._wrong(name, attributes[name], f"more than {_CORNERS[low]}")
        track.lines.append(self._expat.CurrentLineNumber)
        track.frames.append(int(frame))
        track.corners.append(corners)
        track.outside.append(outside)
        track.keyframes.append(self._flag(attributes, "keyframe", "1"))

    def _attribute(self, attributes: dict[str, str], name: str) -> str:
        if name not in attributes:
            raise self._error(f"has a box without {name}")
        return attributes[name]

    def _number(self, attributes: dict[str, str], name: str) -> float:
        text = self._attribute(attributes, name)
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not abs(value) <= _LARGEST:
            raise self._wrong(name, text, "a number of pixels")
        return value

    def _flag(self, attributes: dict[str, str], name: str, default: str) -> bool:
        text = attributes.get(name, default)
        if text not in ("0", "1"):
            raise self._wrong(name, text, "0 or 1")
        return text == "1"

    def _wrong(self, name: str, text: str, expected: str) -> ValueError:
        return self._error(f"has a box whose {name} is {text!r}: expected {expected}")

    def _error(self, what: str) -> ValueError:
        return ValueError(f"{self._path}, line {self._expat.CurrentLineNumber} {what}")
