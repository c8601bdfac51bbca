"""A project in a file of JSON beside its clip: written whole or not at all.

    {"kind": "dcs_jax project", "version": 1, "clip": "clip.mp4", "fingerprint": {...},
     "size": [1920, 1080], "length": 900, "fps": 25.0, "settings": {"preset": "default", "seed": 0},
     "objects": [{"id": 1, "name": "car", "colour": "#0072b2",
                  "keyframes": {"0": [99.0, 146.0, 48.0, 64.0], "400": null},
                  "boxes": [[99.0, 146.0, 48.0, 64.0], ..., null],
                  "confidence": [1.0, ..., null], "disagreement": [0.0, ..., null],
                  "lost": [0, ..., 1]}]}

A keyframe of null: not there. A box of null: none, or not tracked yet.
"""

import hashlib
import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dcs_jax.annotate.project import Keyframe, ObjectLane, Project
from dcs_jax.checks import box_numbers
from dcs_jax.io.files import atomic
from dcs_jax.io.images import is_pattern, list_images

VERSION = 1  # of the file: another number is another layout
KIND = "dcs_jax project"
_READ = 2**20  # bytes at either end of a video, of which the fingerprint is made


def default_path(clip: str | Path) -> Path:
    """Where the project of a clip is kept: clip.mp4.dcs.json beside clip.mp4."""
    clip = Path(clip)
    return clip.with_name(f"{clip.name}.dcs.json")


def save(path: str | Path, project: Project) -> None:
    """Store a project; the file takes its name when it is whole. OSError where it cannot be."""
    with atomic(Path(path), text=True) as file:
        file.write(json.dumps(_plain(project), separators=(",", ":"), allow_nan=False))


def load(path: str | Path, clip: str | Path | None = None) -> Project:
    """The project that `save` has stored, as it was.

    clip: the clip as it is now.

    Raises:
        ValueError: the file is none of `save`, is damaged or cut short, or of a newer version; or
            the clip is another than the project was made for.
        OSError: the file or the clip cannot be read.
    """
    damaged = f"{path} is no project of dcs-jax, or is damaged or cut short"
    try:
        content = json.loads(Path(path).read_bytes())
    except (ValueError, RecursionError):
        raise ValueError(damaged) from None
    if not isinstance(content, dict) or content.get("kind") != KIND:
        raise ValueError(damaged)
    version = content.get("version")
    if version != VERSION:
        raise ValueError(
            f"{path} has the version {version!r}, but this version of dcs-jax reads the version "
            f"{VERSION}: it was written by a newer one"
        )
    try:
        project = _project(content)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise ValueError(f"{damaged} ({type(error).__name__}: {error})") from None
    if clip is not None and fingerprint(clip) != project.fingerprint:
        raise ValueError(
            f"{clip} is not the clip that {path} was made for: its content has changed"
        )
    return project


def fingerprint(clip: str | Path) -> dict[str, Any]:
    """What tells a clip from another: its bytes and a hash of them.

    Of a video the hash is over the first and the last MiB, of a folder of images over their names
    and sizes.

    Raises OSError where the clip is not there, ValueError where a folder has no images.
    """
    path = Path(clip)
    digest = hashlib.sha256()
    if path.is_dir() or is_pattern(path):
        inner = path / "img"  # as `open_source` has it
        images = list_images(inner if inner.is_dir() else path)
        sizes = [os.stat(image).st_size for image in images]
        for image, size in zip(images, sizes, strict=True):
            digest.update(f"{image.name}\0{size}\0".encode(errors="surrogateescape"))
        return {"images": len(images), "bytes": sum(sizes), "sha256": digest.hexdigest()}
    with open(path, "rb") as file:
        size = file.seek(0, os.SEEK_END)
        for start in sorted({0, max(0, size - _READ)}):
            file.seek(start)
            digest.update(file.read(_READ))
    return {"bytes": size, "sha256": digest.hexdigest()}


def _plain(project: Project) -> dict[str, Any]:
    return {
        "kind": KIND,
        "version": VERSION,
        "clip": project.clip,
        "fingerprint": dict(project.fingerprint),
        "size": list(project.size),
        "length": project.length,
        "fps": project.fps,
        "settings": dict(project.settings),
        "objects": [
            {
                "id": lane.id,
                "name": lane.name,
                "colour": lane.colour,
                "keyframes": {
                    str(frame): None if keyframe.box is None else list(keyframe.box)
                    for frame, keyframe in sorted(lane.keyframes.items())
                },
                "boxes": [None if None in box else box for box in _numbers(lane.boxes)],
                "confidence": _numbers(lane.confidence),
                "disagreement": _numbers(lane.disagreement),
                "lost": lane.lost.astype(int).tolist(),
            }
            for lane in project.objects
        ],
    }


def _numbers(values: NDArray[np.float32]) -> list[Any]:
    """The numbers with as few digits as float32 needs; None for NaN."""
    numbers = [
        None if text == "nan" else float(text) for text in values.ravel().astype(str).tolist()
    ]
    if values.ndim == 1:
        return numbers
    width = values.shape[1]
    return [numbers[start : start + width] for start in range(0, len(numbers), width)]


def _project(content: dict[str, Any]) -> Project:
    width, height = map(_whole, content["size"])
    length, fps = _whole(content["length"]), float(content["fps"])
    if not math.isfinite(fps):
        raise ValueError(f"fps is {fps}")
    objects = tuple(_lane(fields, length) for fields in content["objects"])
    if len({lane.id for lane in objects}) < len(objects):
        raise ValueError("two objects have one id")
    return Project(
        clip=str(content["clip"]),
        fingerprint=dict(content["fingerprint"]),
        size=(width, height),
        length=length,
        fps=fps,
        settings=dict(content["settings"]),
        objects=objects,
    )


def _lane(fields: dict[str, Any], length: int) -> ObjectLane:
    keyframes = {}
    for frame, box in fields["keyframes"].items():
        if not 0 <= int(frame) < length:
            raise ValueError(f"a keyframe is in frame {frame} of {length}")
        keyframe = Keyframe(None)
        if box is not None:
            x, y, w, h = box_numbers(box).tolist()
            keyframe = Keyframe((x, y, w, h))
        keyframes[int(frame)] = keyframe
    if all(keyframe.box is None for keyframe in keyframes.values()):
        raise ValueError(f"{fields['name']} has no keyframe with a box")
    nothing = [math.nan] * 4
    boxes = [nothing if box is None else box for box in fields["boxes"]]
    lane = ObjectLane(
        id=_whole(fields["id"]),
        name=str(fields["name"]),
        colour=str(fields["colour"]),
        keyframes=keyframes,
        boxes=np.array(boxes, np.float32),
        confidence=np.array(fields["confidence"], np.float32),
        disagreement=np.array(fields["disagreement"], np.float32),
        lost=np.array(fields["lost"], np.bool_),
    )
    for name in ("boxes", "confidence", "disagreement", "lost"):
        shape = (length, 4) if name == "boxes" else (length,)
        if getattr(lane, name).shape != shape:
            raise ValueError(f"{name} of {lane.name} are {getattr(lane, name).shape}, not {shape}")
    return lane


def _whole(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise ValueError(f"{value!r} is not a whole number from 1 on")
    return value
