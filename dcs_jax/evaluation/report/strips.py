"""Film strips of the report: frames at which the settings differ most, with their boxes."""

import base64
from collections.abc import Mapping
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from dcs_jax.evaluation.metrics import centre_error
from dcs_jax.evaluation.results import JPEG_QUALITY
from dcs_jax.evaluation.summary import Summary
from dcs_jax.io.drawing import Colour
from dcs_jax.io.overlay import TRUTH, draw_box

COUNT = 6
THICKNESS = 2  # of a box; pictures are shown smaller than they are
APART = 12  # chosen frames are at least a 12th of the pictures apart


class Picture(NamedTuple):
    """A frame with boxes.

    frame: index of the frame.
    source: image as a data URI.
    width, height: pixels.
    """

    frame: int
    source: str
    width: int
    height: int


def film_strip(summary: Summary, sequence: str, colours: Mapping[str, str]) -> list[Picture]:
    """Pictures of a sequence where the boxes of the settings lie furthest apart, in order of time.

    Each setting is shown by the seed with the median centre error. The distance is the greatest
    between the centres of two settings, or of a setting and the label, in sides of the label.
    """
    labels = summary.labels[sequence]
    tracks = _median_tracks(summary, sequence)
    if not tracks:
        return []
    every = np.array([*tracks.values(), labels.truth])[:, labels.shown]
    centres = every[..., :2] + every[..., 2:] / 2
    gaps = np.linalg.norm(centres[:, None] - centres[None], axis=-1)
    sides = np.sqrt(labels.truth[labels.shown, 2:].prod(axis=1))
    apart = np.nanmax(gaps, axis=(0, 1)) / sides
    return [_draw(summary, sequence, index, tracks, colours) for index in _spread_out(apart)]


def _median_tracks(summary: Summary, sequence: str) -> dict[str, NDArray[np.float64]]:
    """Boxes [T, 4] by setting: the median seed of the first start, NaN before the start."""
    tracks = {}
    truth = summary.labels[sequence].truth
    for name, setting, start in sorted(summary.records):
        if name != sequence or setting in tracks:
            continue
        record = summary.records[name, setting, start]
        errors = [np.nanmean(centre_error(b, truth[record.frame :])) for b in record.boxes]
        middle = np.argsort(errors)[len(errors) // 2]
        track = np.full_like(truth, np.nan)
        track[record.frame :] = record.boxes[middle]
        tracks[setting] = track
    return {setting: tracks[setting] for setting in summary.settings if setting in tracks}


def _spread_out(values: NDArray[np.float64]) -> list[int]:
    """Indices of up to COUNT of the greatest values in ascending order, no two too close."""
    chosen: list[int] = []
    for index in np.argsort(-values).tolist():
        if all(abs(index - other) * APART >= len(values) for other in chosen):
            chosen.append(index)
        if len(chosen) == COUNT:
            break
    return sorted(chosen)


def _draw(
    summary: Summary,
    sequence: str,
    index: int,
    tracks: Mapping[str, NDArray[np.float64]],
    colours: Mapping[str, str],
) -> Picture:
    labels = summary.labels[sequence]
    frame = int(labels.shown[index])
    encoded = np.frombuffer(labels.pictures[index], np.uint8)
    image = np.asarray(cv2.imdecode(encoded, cv2.IMREAD_COLOR_RGB), np.uint8)
    ratio = image.shape[1] / labels.size[1]  # of the picture to the frame
    draw_box(image, labels.truth[frame] * ratio, TRUTH, thickness=THICKNESS)
    for setting, track in tracks.items():
        draw_box(image, track[frame] * ratio, _rgb(colours[setting]), thickness=THICKNESS)
    bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    _, jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    text = base64.b64encode(bytes(jpeg)).decode()
    return Picture(frame, f"data:image/jpeg;base64,{text}", image.shape[1], image.shape[0])


def _rgb(colour: str) -> Colour:
    red, green, blue = (int(colour[n : n + 2], 16) for n in (1, 3, 5))
    return red, green, blue
