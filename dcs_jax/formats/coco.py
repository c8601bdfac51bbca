"""COCO's JSON for videos, as TAO, BDD100K and mmtracking read it: one video, an annotation per box.

    videos        id, name, width, height, length, fps
    images        id, video_id, frame_id and frame_index (both from 0), width, height, file_name
    tracks        id, category_id, video_id, name
    annotations   id, image_id, video_id, category_id, bbox [x, y, w, h], area, iscrowd, score,
                  track_id and instance_id (TAO and mmtracking differ in the name)
    categories    id, name: the labels of the objects or, without one, their names

The file of frame 7 of clip.mp4 is named clip/000008.jpg, as ffmpeg numbers the frames it extracts.
A frame in which the object is lost, or has no box, has no annotation. The frame size has to be
known.
"""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dcs_jax.formats.assembly import assemble, check_total, decimals, visible_rows
from dcs_jax.formats.records import Records, load, records
from dcs_jax.formats.tracks import Tracks, ids_of, names_of
from dcs_jax.io.files import atomic

VIDEO = 1  # id of the one video


def write(path: Path, tracks: Tracks) -> None:
    """Write the tracks; ValueError if the frame size is unknown."""
    if tracks.size is None:
        raise ValueError(f"{path}: coco needs the size of the frames, width and height in pixels")
    check_total(tracks.end, str(path))
    width, height = tracks.size
    clip = Path(tracks.source or "video").stem
    video = {"id": VIDEO, "name": tracks.source or clip, "width": width, "height": height}
    video |= {"length": tracks.end} | ({} if tracks.fps is None else {"fps": tracks.fps})
    images = [
        {
            "id": frame + 1,
            "video_id": VIDEO,
            "frame_id": frame,
            "frame_index": frame,
            "width": width,
            "height": height,
            "file_name": f"{clip}/{frame + 1:06d}.jpg",
        }
        for frame in range(tracks.end)
    ]
    numbers = _numbers([track.category for track in tracks.objects])
    categories = [{"id": number, "name": name} for name, number in numbers.items()]
    objects = [
        {"id": id, "category_id": numbers[t.category], "video_id": VIDEO, "name": t.name}
        for id, t in zip(ids_of(tracks), tracks.objects, strict=True)
    ]
    lists = {
        "videos": [video],
        "images": images,
        "categories": categories,
        "tracks": objects,
        "annotations": _annotations(tracks, objects),
    }
    with atomic(path, text=True) as file:
        opening = "{"
        for name, records in lists.items():
            file.write(f'{opening}"{name}": [')
            opening = "],\n"
            for number, record in enumerate(records):
                text = json.dumps(record, ensure_ascii=False, allow_nan=False)
                file.write(f",\n{text}" if number else f"\n{text}")
        file.write("]}\n")


def read(path: Path) -> Tracks:
    """Read a file of one video; ValueError names the record and the field."""
    document = load(path)
    videos, images, categories, annotations = (
        records(path, document, name) for name in ("videos", "images", "categories", "annotations")
    )
    if len(videos) > 1:
        raise ValueError(f"{path} has {len(videos)} videos: expected one")
    frames = dict(zip(images.counts("id"), images.frames("frame_id", "frame_index"), strict=True))
    labels = {category.count("id"): category.text("name") for category in categories}
    known = records(path, document, "tracks", optional=True)
    names = {track.count("id"): track.text("name") for track in known if "name" in track}
    place = {
        number: at for at, number in enumerate(names)
    }  # the order of objects, else that of ids
    ids = annotations.counts("track_id", "instance_id")
    classes = dict(zip(ids, annotations.members("category_id", labels, "categories"), strict=True))
    numbers = sorted(classes, key=lambda number: (place.get(number, len(place)), number))
    owner = {number: at for at, number in enumerate(numbers)}
    categories_of = [labels[classes[number]] for number in numbers]
    if all(number in names for number in numbers):
        called = [names[number] for number in numbers]
    else:
        called = names_of(categories_of, numbers)
    members = annotations.members("image_id", frames, "images")
    objects = assemble(
        called,
        np.array([owner[number] for number in ids], int),
        np.array([frames[image] for image in members], int),
        annotations.boxes("bbox"),
        annotations.numbers("score"),
        annotations.where,
    )
    objects = tuple(
        track._replace(label=None if label == track.name else label)
        for track, label in zip(objects, categories_of, strict=True)
    )
    return Tracks(objects, **_clip(videos, images, max(frames.values(), default=-1) + 1))


def _annotations(tracks: Tracks, objects: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    rows = visible_rows(tracks)
    columns = (rows.owners, rows.frames, decimals(rows.boxes), decimals(rows.confidence))
    lists = zip(*(column.tolist() for column in columns), strict=True)
    for number, (owner, frame, (x, y, w, h), score) in enumerate(lists, 1):
        annotation = {
            "id": number,
            "image_id": frame + 1,
            "video_id": VIDEO,
            "category_id": objects[owner]["category_id"],
            "track_id": objects[owner]["id"],
            "instance_id": objects[owner]["id"],
            "bbox": [x, y, w, h],
            "area": w * h,
            "iscrowd": 0,
        }
        if not math.isnan(score):
            annotation["score"] = score
        yield annotation


def _clip(videos: Records, images: Records, frames: int) -> dict[str, Any]:
    """Size, length, source and rate of the clip, from the video or its images."""
    video, image = next(iter(videos), None), next(iter(images), None)
    facts: dict[str, Any] = {"length": frames or None}
    for record in (video, image):
        if record is not None and "width" in record and "height" in record:
            facts["size"] = (record.count("width"), record.count("height"))
            break
    if video is not None:
        if "length" in video:
            facts["length"] = max(video.frame("length"), frames) or None
        if "name" in video:
            facts["source"] = video.text("name")
        if "fps" in video:
            facts["fps"] = video.number("fps")
    return facts


def _numbers(names: list[str]) -> dict[str, int]:
    """A number from 1 on for each different name."""
    return {name: number for number, name in enumerate(dict.fromkeys(names), 1)}
