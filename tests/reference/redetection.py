"""Re-detection: where else in the frame a missed object is looked for."""

import math

import numpy as np

from .records import Floats, Settings
from .window import shown_box


def search_windows(
    box: Floats,
    num_missed: int,
    frame_shape: tuple[int, ...],
    settings: Settings,
) -> list[Floats]:
    """The boxes [4] around which a frame is searched: none unless the object was missed.

    In every frame the next ones of those that tile it.

    box: [4], the last one. num_missed: frames in a row before this one. frame_shape: H, W.
    """
    assert settings.redetection
    if num_missed == 0:
        return []
    tiles = tiling(box, frame_shape, settings)
    windows = settings.redetection.windows
    return [tiles[(windows * num_missed + turn) % len(tiles)] for turn in range(windows)]


def tiling(box: Floats, frame_shape: tuple[int, ...], settings: Settings) -> list[Floats]:
    """Boxes [4] of this size whose search windows cover the frame, row by row.

    The centre of a box can move by half of (window_factor - 1) sides of what the canvas shows, so
    the frame is divided into the least number of equal tiles that are not larger than that twice.
    """
    _, _, width, height = box
    _, _, shown_width, shown_height = shown_box(box, settings)
    rows = math.ceil(frame_shape[0] / (shown_height * (settings.window_factor - 1)))
    columns = math.ceil(frame_shape[1] / (shown_width * (settings.window_factor - 1)))
    boxes = []
    for i in range(rows):
        for j in range(columns):
            middle_x = (j + 0.5) * frame_shape[1] / columns
            middle_y = (i + 0.5) * frame_shape[0] / rows
            boxes.append(np.array([middle_x - width / 2, middle_y - height / 2, width, height]))
    return boxes
