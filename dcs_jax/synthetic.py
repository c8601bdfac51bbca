"""A rendered clip with exact ground truth: for the demonstration, the tests and the benchmarks.

A textured card moves along a smooth curve over a textured background, while a bar passes in front
of it, another card of similar colours passes next to it and a cloud reduces the light. The layers
are sampled by area, so a box is exact to a fraction of a pixel, and all randomness comes from one
seed: the same arguments give the same bytes. On request the card grows or shrinks, is fully hidden
for a while, or leaves the frame and comes back elsewhere.
"""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

# A card or bar: the integral image [texel rows + 1, texel columns + 1, 4] of RGB times alpha, and
# of alpha in [0, 1].
Layer = NDArray[np.float64]

TEXELS = 2  # texels per pixel of a card or bar, along each axis

# When each event happens, as fractions of the clip. They do not overlap, so that each
# has its effect alone.
OCCLUSION = (0.22, 0.42)
LOOKALIKE = (0.48, 0.68)
CLOUD = (0.74, 0.94)
AWAY = 0.3  # when the target starts to leave the frame
COVERING = 20  # frames in which a bar that hides the whole target moves over it

# Colour ramps, RGB, from the dark to the bright end of a texture.
GROUND = ((38, 58, 66), (66, 98, 98), (112, 140, 122), (168, 178, 150))
CARD = ((78, 22, 34), (176, 58, 44), (236, 142, 62), (255, 226, 168))
BAR = ((52, 50, 62), (84, 82, 96), (124, 120, 130))


class Clip(NamedTuple):
    """Frames and what is known about them.

    frames: [T, H, W, 3] uint8, RGB.
    boxes: [T, 4] float32, the target's exact x, y, w, h in pixels, (x, y) the top-left corner.
        It may be outside the frame while the target is away.
    occluded: [T] float32 in [0, 1], fraction of the target's area hidden by the bar or outside the
        frame.
    lookalike: [T, 4] float32, the look-alike's box in pixels, NaN in a clip without one. It may be
        outside the frame.
    light: [T] float32 in (0, 1], factor on all grey values.
    """

    frames: NDArray[np.uint8]
    boxes: NDArray[np.float32]
    occluded: NDArray[np.float32]
    lookalike: NDArray[np.float32]
    light: NDArray[np.float32]

    @property
    def absent(self) -> NDArray[np.bool_]:
        """[T], whether the target is fully hidden; its box is then where it would be."""
        return self.occluded >= 1


def render(
    length: int = 150,
    size: tuple[int, int] = (240, 320),
    target: tuple[int, int] = (64, 48),
    *,
    seed: int = 0,
    speed: float = 5.0,
    occlusion: float = 0.6,
    lookalike: bool = True,
    cloud: float = 0.45,
    noise: float = 2.0,
    zoom: tuple[float, float] = (1.0, 1.0),
    covered: int = 0,
    away: int = 0,
) -> Clip:
    """Render a clip of `length` frames with exact ground truth.

    Args:
        length: number of frames T, at least 1.
        size: rows and columns of a frame, pixels.
        target: rows and columns of the target, pixels, each at least 4 and at most the frame's.
        seed: seed of textures, path and noise.
        speed: bound on the target's speed, pixels per frame; 0 keeps it still.
        occlusion: largest fraction of the target that the passing bar hides, in [0, 1]; 0 for no
            bar.
        lookalike: whether a card of similar colours passes next to the target.
        cloud: largest fraction of the light taken, in [0, 1); 0 for steady light.
        noise: standard deviation of the sensor noise, grey values.
        zoom: sides of the target in the first and in the last frame, in units of `target`; between
            them it grows by the same factor in every frame.
        covered: number of frames in which the bar, which is wider then, hides the whole target; it
            moves over it in the `COVERING` frames before, and off in as many after. 0 for the
            narrow bar.
        away: number of frames in which the target is outside the frame. It leaves at the nearer of
            the left and the right side, and returns at the other one, at the mirrored height. On
            the way it moves by at least an eighth of its width per frame. 0 to stay.

    `covered` and `away` take frames from the other events: switch those off.

    Raises:
        ValueError: an argument is outside its range.
    """
    _check(length, size, target, speed, occlusion, cloud, noise)
    _check_absence(size, target, zoom, covered, away)
    rows, columns = size
    h, w = target
    scene, sensor = np.random.default_rng(seed).spawn(2)
    ground = _ramp(_texture(scene, rows, columns, cell=max(rows, columns) / 6), GROUND)
    card, other = _card(scene, h, w), _card(scene, h, w)
    largest = max(zoom)
    cover = 1 + covered / COVERING if covered else occlusion
    bar = _bar(scene, rows, max(1.0, cover * largest * w))

    time = (np.arange(length) + 0.5) / length
    sides = zoom[0] * (zoom[1] / zoom[0]) ** np.linspace(0, 1, length)[:, None] * (w, h)
    room = columns - largest * w, rows - largest * h
    corners = _path(scene, length, room, speed, away, largest * w)
    boxes = np.concatenate([corners + ((largest * w, largest * h) - sides) / 2, sides], 1)
    boxes = boxes.astype(np.float32).astype(np.float64)  # exactly the boxes that the frames show
    bar_width = (bar.shape[1] - 1) / TEXELS
    event = OCCLUSION
    if covered:
        event = OCCLUSION[0], OCCLUSION[0] + (covered + 2 * COVERING) / length
    bar_left = boxes[:, 0] + boxes[:, 2] / 2 - bar_width / 2
    bar_left += _passing(time, event, (largest * w + bar_width) / 2)
    others = _lookalike_boxes(boxes, time, rows)
    dip = np.clip((time - CLOUD[0]) / (CLOUD[1] - CLOUD[0]), 0, 1)
    light = 1 - cloud * np.sin(np.pi * dip) ** 2

    frames = np.empty((length, rows, columns, 3), np.uint8)
    occluded = np.zeros(length, np.float32)
    for t in range(length):
        frame = ground.copy()
        if lookalike:
            _paste(frame, other, others[t, 0], others[t, 1])
        visible = _paste(frame, card, boxes[t, 0], boxes[t, 1], boxes[t, 2] / w)
        # A box within the frame is fully visible, whatever the rounding.
        shown = 1.0 if away == 0 else (visible.sum() / (card[-1, -1, 3] * _pixels(boxes[t, 2] / w)))
        if (occlusion or covered) and visible.any():
            hidden = _paste(frame, bar, bar_left[t], 0)
            shown *= 1 - (visible * hidden).sum() / visible.sum()
        occluded[t] = round(abs(float(1 - shown)), 5)
        frame *= light[t]
        frame += noise * sensor.standard_normal(frame.shape, np.float32)
        frames[t] = np.rint(frame).clip(0, 255)
    if not lookalike:
        others[:] = np.nan
    single = np.float32
    return Clip(frames, boxes.astype(single), occluded, others.astype(single), light.astype(single))


def _check(
    length: int,
    size: tuple[int, int],
    target: tuple[int, int],
    speed: float,
    occlusion: float,
    cloud: float,
    noise: float,
) -> None:
    if length < 1:
        raise ValueError(f"length is {length}, but a clip has at least 1 frame")
    if not (4 <= target[0] <= size[0] and 4 <= target[1] <= size[1]):
        raise ValueError(
            f"target is {target[0]} x {target[1]} pixels, but it must be at least 4 x 4 and fit "
            f"into the frame of {size[0]} x {size[1]}"
        )
    if not (speed >= 0 and noise >= 0):
        raise ValueError(f"speed {speed} and noise {noise} must not be negative")
    if not (0 <= occlusion <= 1 and 0 <= cloud < 1):
        raise ValueError(
            f"occlusion is {occlusion} and cloud {cloud}, but they are fractions: expected 0 to 1, "
            "the cloud below 1"
        )


def _check_absence(
    size: tuple[int, int],
    target: tuple[int, int],
    zoom: tuple[float, float],
    covered: int,
    away: int,
) -> None:
    if not (min(zoom) * min(target) >= 4 and max(zoom) * max(np.divide(target, size)) <= 1):
        raise ValueError(
            f"zoom {zoom} makes a target of {target[0]} x {target[1]} pixels smaller than 4 x 4 or "
            f"larger than the frame of {size[0]} x {size[1]}"
        )
    if covered < 0 or away < 0:
        raise ValueError(f"covered {covered} and away {away} are numbers of frames: at least 0")


def _path(
    rng: np.random.Generator,
    length: int,
    room: tuple[float, float],
    speed: float,
    away: int,
    width: float,
) -> NDArray[np.float64]:
    """Top-left corners [T, 2] on a Lissajous curve that stays within [0, room] on both axes.

    If `away` is not 0, the target, which is `width` pixels wide, leaves the frame for so many
    frames; then it continues along the curve, mirrored on both axes.
    """
    reach = 0.45 * np.array(room, np.float64)
    cycles = np.array([1.0, 2.0])
    phase = rng.uniform(0, 2 * np.pi, 2)
    fastest = float(np.hypot(*(reach * cycles)))
    angle = np.arange(length) * (speed / fastest if fastest else 0.0)
    corners: NDArray[np.float64] = np.array(room) / 2 + reach * np.sin(
        cycles * angle[:, None] + phase
    )
    if away == 0:
        return corners
    start = int(AWAY * length)
    here = corners[start].copy()
    side = -1 if 2 * here[0] < room[0] else 1
    distance = width + (here[0] if side < 0 else room[0] - here[0])
    step = max(speed, width / 8)
    out = int(np.ceil(distance / step))
    since = np.arange(length) - start
    back = 2 * out + away - since  # frames until the target is on the curve again
    gone = since > out + away // 2
    # The target leaves the curve where it is and comes back to the mirrored position.
    late = corners[np.maximum(np.arange(length) - (2 * out + away), start)]
    corners = np.where((since > 0)[:, None], late, corners)
    corners[gone] = room - corners[gone]
    shift = step * np.where(gone, -np.maximum(back, 0), np.maximum(since, 0))
    corners[:, 0] += side * shift
    return corners


def _passing(
    time: NDArray[np.float64], event: tuple[float, float], width: float
) -> NDArray[np.float64]:
    """Offset [T] that grows linearly and is inside (-width, width) only during the event.

    Layers pass relative to the target, so that they meet it once whatever its path.
    """
    start, end = event
    return width * (2 * (time - start) / (end - start) - 1)


def _lookalike_boxes(
    boxes: NDArray[np.float64], time: NDArray[np.float64], rows: int
) -> NDArray[np.float64]:
    """Boxes [T, 4] of the look-alike: past the target from right to left, on the side with room."""
    others = boxes.copy()
    h, w = boxes[0, 3], boxes[0, 2]
    middle = np.argmin(np.abs(time - sum(LOOKALIKE) / 2))
    side = 1 if boxes[middle, 1] + h / 2 < rows / 2 else -1
    others[:, 0] -= _passing(time, LOOKALIKE, 2 * w)
    others[:, 1] += side * 1.1 * h
    return others


def _texture(rng: np.random.Generator, rows: int, columns: int, cell: float) -> NDArray[np.float32]:
    """Smooth noise [rows, columns] in [0, 1]: octaves from `cell` texels down to about 2."""
    texture = np.zeros((rows, columns), np.float32)
    amplitude = 1.0
    while cell >= 2:
        shape = (int(np.ceil(rows / cell)) + 1, int(np.ceil(columns / cell)) + 1)
        grid = rng.standard_normal(shape, np.float32)
        texture += amplitude * cv2.resize(grid, (columns, rows), interpolation=cv2.INTER_CUBIC)
        amplitude *= 0.6
        cell /= 2
    low, high = np.quantile(texture, (0.02, 0.98))
    stretched: NDArray[np.float32] = (texture - low) / np.float32(max(high - low, 1e-6))
    return stretched.clip(0, 1)


def _ramp(
    texture: NDArray[np.float32], colours: tuple[tuple[int, int, int], ...]
) -> NDArray[np.float32]:
    """Colour a texture [..] in [0, 1] with a ramp of RGB colours: [.., 3]."""
    stops = np.linspace(0, 1, len(colours))
    channels = [np.interp(texture, stops, channel) for channel in zip(*colours, strict=True)]
    return np.stack(channels, axis=-1).astype(np.float32)


def _card(rng: np.random.Generator, h: int, w: int) -> Layer:
    """A card with round corners: a warm texture, a rim, and a band and two rings at random."""
    rows, columns = h * TEXELS, w * TEXELS
    short = min(rows, columns)
    y, x = np.mgrid[:rows, :columns].astype(np.float32) + 0.5
    value = 0.2 + 0.6 * _texture(rng, rows, columns, cell=short / 2)

    angle, shift = rng.uniform(0.5, 1.1) * rng.choice([-1, 1]), rng.uniform(-0.15, 0.15)
    across = (x - columns / 2) * np.sin(angle) + (y - rows / 2) * np.cos(angle) - shift * short
    value += 0.45 * _soft(0.07 * short - np.abs(across))
    for sign in (-1, 1):
        centre_y = rows * (0.5 + sign * rng.uniform(0.2, 0.28))
        centre_x = columns * rng.uniform(0.32, 0.68)
        radius = np.hypot(y - centre_y, x - centre_x)
        value += 0.9 * _soft(0.2 * short - radius) - 1.3 * _soft(0.11 * short - radius)

    # Signed distance to the edge of a rectangle with round corners, positive inside.
    corner = 0.16 * short
    out_y = np.maximum(np.abs(y - rows / 2) - (rows / 2 - corner), 0)
    out_x = np.maximum(np.abs(x - columns / 2) - (columns / 2 - corner), 0)
    inside = corner - np.hypot(out_y, out_x)
    value -= 0.8 * _soft(0.05 * short - inside)
    alpha = np.clip(inside + 0.5, 0, 1)[..., None].astype(np.float32)
    return _integral(np.concatenate([_ramp(value.clip(0, 1), CARD) * alpha, alpha], axis=-1))


def _bar(rng: np.random.Generator, rows: int, width: float) -> Layer:
    """A bar as high as the frame and at least `width` pixels wide, shaded like a column."""
    shape = (rows * TEXELS, int(np.ceil(width * TEXELS)))
    grain = _texture(rng, *shape, cell=max(4, shape[1] / 3))
    roundness = np.sin(np.pi * (np.arange(shape[1]) + 0.5) / shape[1])
    colour = _ramp(0.55 * roundness.astype(np.float32) + 0.45 * grain, BAR)
    return _integral(np.concatenate([colour, np.ones((*shape, 1), np.float32)], axis=-1))


def _soft(distance: NDArray[np.float32]) -> NDArray[np.float32]:
    """A step from 0 to 1 where the distance passes zero, two texels wide."""
    return np.clip(distance / 2 + 0.5, 0, 1)


def _integral(layer: NDArray[np.float32]) -> Layer:
    sums = layer.cumsum(axis=0, dtype=np.float64).cumsum(axis=1)
    return np.pad(sums, ((1, 0), (1, 0), (0, 0)))


def _pixels(zoom: float) -> float:
    """Number of pixels that a texel covers."""
    return (zoom / TEXELS) ** 2


def _paste(
    frame: NDArray[np.float32], layer: Layer, x: float, y: float, zoom: float = 1.0
) -> NDArray[np.float32]:
    """Paste the layer into the frame with its top-left corner at (x, y); returns its alpha [H, W].

    A pixel takes the mean of the layer over its area, so any fraction of a pixel is exact.
    """
    rows, sums = _between_pixels(layer, y, frame.shape[0], TEXELS / zoom)
    columns, sums = _between_pixels(sums.swapaxes(0, 1), x, frame.shape[1], TEXELS / zoom)
    drawn = sums.swapaxes(0, 1).astype(np.float32)  # [rows, columns, 4]
    frame[rows, columns] *= 1 - drawn[..., 3:]
    frame[rows, columns] += drawn[..., :3]
    alpha = np.zeros(frame.shape[:2], np.float32)
    alpha[rows, columns] = drawn[..., 3]
    return alpha


def _between_pixels(
    sums: NDArray[np.float64], start: float, pixels: int, density: float
) -> tuple[slice, NDArray[np.float64]]:
    """The pixels of an axis that a layer at `start` overlaps, and the means of the layer over them.

    sums: [texels + 1, ...], running sums over the texels along the axis. density: texels per pixel.

    Returns:
        The slice of the P pixels, none for a layer outside the frame, and [P, ...].
    """
    texels = len(sums) - 1
    first, last = np.clip([np.floor(start), np.ceil(start + texels / density)], 0, pixels)
    edges = np.clip((np.arange(first, last + 1) - start) * density, 0, texels)
    below = np.minimum(edges.astype(int), texels - 1)
    part = (edges - below).reshape(-1, *[1] * (sums.ndim - 1))
    at_edges = sums[below] + part * (sums[below + 1] - sums[below])
    return slice(int(first), int(last)), np.diff(at_edges, axis=0) / density
