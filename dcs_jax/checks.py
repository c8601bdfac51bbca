"""Checks of arguments: a ValueError says what was expected and what was passed.

They need shapes, types and concrete values only, so they run before any compilation. Inside a
transformation, where values are not known yet, they check shapes.
"""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from dcs_jax.types import BoxLike

# Pixels. On a smaller box a part is less than two pixels wide: too little for any feature.
SMALLEST_SIDE = 4
# Pixels. The corners of a larger box are not known to a tenth of a pixel in float32.
LARGEST_SIDE = 1e6
INT32 = 2**31 - 1  # the largest number that fits
LARGEST_SEED = 2**32 - 1  # that `jax.random.key` takes for itself
# Characters of a value in a message.
_SHOWN = 80


def shown(value: Any) -> str:
    """The value as a message has it: in one line, and of an array in memory what it is."""
    if isinstance(value, (np.ndarray, jax.Array)) and (
        isinstance(value, jax.core.Tracer) or value.size > 6
    ):
        return f"an array of {value.dtype} and shape {value.shape}"
    try:
        text = " ".join(repr(value).split())
    except Exception:  # Python refuses integers of more than 4300 digits, for example
        return f"a {type(value).__name__}"
    return text if len(text) <= _SHOWN else f"{text[: _SHOWN - 3]}..."


def check_frames(frames: Any) -> None:
    """ValueError unless frames is a uint8 array, [T, H, W] or [T, H, W, 3], with no empty side."""
    _check_images("frames", frames, "[T, H, W] grey or [T, H, W, 3] RGB", rank=3)


def check_videos(frames: Any) -> bool:
    """True for many videos, [B, T, H, W] or [B, T, H, W, 3], false for one.

    Four axes with 3 at the end are one RGB video.

    Raises ValueError unless frames is a uint8 array of one or the other, with no empty side.
    """
    rank = getattr(frames, "ndim", 0)
    if rank != 5 and not (rank == 4 and frames.shape[-1] != 3):
        check_frames(frames)
        return False
    _check_images("frames", frames, "[B, T, H, W] grey or [B, T, H, W, 3] RGB", rank=4)
    return True


def check_frame(frame: Any) -> None:
    """ValueError unless frame is a uint8 array, [H, W] or [H, W, 3], with no empty side."""
    _check_images("frame", frame, "[H, W] grey or [H, W, 3] RGB", rank=2)


def check_box(box: BoxLike, frame_shape: tuple[int, ...]) -> None:
    """ValueError unless box is x, y, w, h in pixels, 4 to 1e6 px a side, and meets the frame.

    frame_shape: (H, W) or (H, W, 3). The box may lie partly outside the frame. Of a box that is not
    known inside a transformation, an array or four numbers, the shape and types are checked.
    """
    if isinstance(box, jax.core.Tracer) or (
        isinstance(box, Sequence) and any(isinstance(part, jax.core.Tracer) for part in box)
    ):
        _check_unknown_box(box)
        return
    values = box_numbers(box)
    x, y, w, h = values
    height, width = frame_shape[:2]
    if x >= width or y >= height or x + w <= 0 or y + h <= 0:
        raise ValueError(
            f"box must lie at least partly in the frame of {width} x {height} pixels, "
            f"but {_text(values)} is wholly outside"
        )


_BOX = "box must be four finite numbers x, y, w, h in pixels"


def box_numbers(box: Any) -> NDArray[np.float64]:
    """The numbers of a box, [4]; ValueError unless they are x, y, w, h, 4 to 1e6 px a side."""
    values = _numbers(box, _BOX)
    if values.shape != (4,):
        raise ValueError(f"{_BOX}, but has the shape {values.shape}: {shown(box)}")
    if not np.isfinite(values).all():
        raise ValueError(f"{_BOX}, but is {_text(values)}")
    w, h = values[2:]
    if w <= 0 or h <= 0:
        raise ValueError(f"box must have a positive width and height, but is {_text(values)}")
    if min(w, h) < SMALLEST_SIDE:
        raise ValueError(
            f"box must be at least {SMALLEST_SIDE} pixels wide and high, but is {_text(values)}"
        )
    if np.abs(values).max() > LARGEST_SIDE:
        raise ValueError(
            f"box must be at most {LARGEST_SIDE:g} pixels wide and high, and as near to the "
            f"frame, but is {_text(values)}"
        )
    return values


def check_boxes(boxes: Any, frame_shape: tuple[int, ...]) -> NDArray[np.float32]:
    """The boxes as an array [B, 4] float32; ValueError unless each one passes `check_box`."""
    expected = "boxes must be [B, 4], x, y, w, h in pixels of at least one box"
    values = _numbers(boxes, expected)
    if values.ndim != 2 or values.shape[1] != 4 or not len(values):
        raise ValueError(f"{expected}, but has the shape {values.shape}")
    for number, box in enumerate(values):
        try:
            check_box(box, frame_shape)
        except ValueError as error:
            raise ValueError(f"boxes[{number}]: {error}") from None
    return values.astype(np.float32)


def _check_unknown_box(box: Any) -> None:
    """ValueError unless box is four real numbers, as far as shapes and types tell."""
    parts = [box] if isinstance(box, jax.core.Tracer) else list(box)
    shape = np.shape(box) if isinstance(box, jax.core.Tracer) else (len(parts),)
    if shape != (4,):
        raise ValueError(f"{_BOX}, but has the shape {shape}")
    for part in parts:
        dtype = jnp.result_type(part) if np.ndim(part) < 2 else None
        if (np.ndim(part) and part is not box) or not _is_real(dtype):
            raise ValueError(f"{_BOX}, but is {shown(box)}")


def _numbers(values: Any, expected: str) -> NDArray[np.float64]:
    """The values as an array; ValueError, which says what is expected, unless they are real."""
    try:
        array = np.asarray(values)
        if _is_real(array.dtype):
            return array.astype(np.float64)
    except (TypeError, ValueError):
        pass
    raise ValueError(f"{expected}, but is {shown(values)}")


def _is_real(dtype: Any) -> bool:
    return jnp.issubdtype(dtype, jnp.integer) or jnp.issubdtype(dtype, jnp.floating)


def check_keys(keys: Any, count: int) -> jax.Array:
    """The keys, by default the key 0; ValueError unless they are one key or `count` keys."""
    if keys is None:
        return jax.random.key(0)
    if isinstance(keys, jax.Array) and keys.shape == (count,):
        check_key(keys[0], "keys")
        return keys
    if isinstance(keys, jax.Array) and keys.ndim:
        raise ValueError(
            f"keys must be one key for all {count} boxes or one for each, made by "
            f"jax.random.key(seed), but is an array of {keys.dtype} and shape {keys.shape}"
        )
    check_key(keys, "keys")
    return keys


def check_key(key: Any, name: str = "key") -> None:
    """ValueError unless key is one random key, as made by `jax.random.key`."""
    if not (isinstance(key, jax.Array) and jnp.issubdtype(key.dtype, jax.dtypes.prng_key)):
        raise ValueError(f"{name} must be made by jax.random.key(seed), but is {shown(key)}")
    if key.shape != ():
        raise ValueError(f"{name} must be one key, but is an array of keys of shape {key.shape}")


def check_choice(name: str, value: Any, choices: Sequence[Any]) -> Any:
    """The value, one of the choices and of its type; else ValueError."""
    for choice in choices:
        # A choice of another type may be equal, and an array is compared number by number.
        if isinstance(value, type(choice)) and not isinstance(value, bool) and value == choice:
            return choice
    raise ValueError(
        f"{name} must be one of {', '.join(map(repr, choices))}, but is {shown(value)}"
    )


def check_count(name: str, value: Any, least: int = 1, most: int = INT32) -> int:
    """The value as Python's integer; ValueError unless it is an integer from `least` to `most`."""
    integer = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not integer or not least <= value <= most:
        expected = f"an integer of at least {least}"
        if integer and value > most:
            expected += f" and at most {most}"
        raise ValueError(f"{name} must be {expected}, but is {shown(value)}")
    return int(value)


def as_numbers(
    name: str, values: Any, dtype: np.dtype, shape: tuple[int, ...], least: float = -np.inf
) -> jax.Array:
    """The values as an array of this type.

    shape: last dimensions of the array; any dimensions may precede them.

    Raises ValueError unless the values are real numbers, and where they are known, finite in this
    type and at least `least`.
    """
    try:
        array = values if isinstance(values, jax.Array) else np.asarray(values)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be an array of numbers, but is {shown(values)}") from None
    if not (_is_real(array.dtype) or array.dtype == bool):
        raise ValueError(f"{name} must be real numbers, but is {array.dtype}")
    if array.shape[array.ndim - len(shape) :] != shape or array.ndim < len(shape):
        expected = ", ".join(map(str, ("...", *shape)))
        raise ValueError(f"{name} must have the shape [{expected}], but has {array.shape}")
    if not isinstance(array, jax.core.Tracer):
        known = np.asarray(array)
        with np.errstate(over="ignore"):
            finite = np.isfinite(known.astype(dtype))
        wrong = known[~(finite & (known >= least))]
        if wrong.size:
            expected = "finite" if least == -np.inf else f"finite and at least {least:g}"
            raise ValueError(
                f"{name} must be {expected}, but {wrong.size} of its {known.size} values "
                f"{'is' if wrong.size == 1 else 'are'} not (in {dtype}): "
                f"{', '.join(map(str, wrong[:5]))}"
            )
    return jnp.asarray(array, dtype)


def _check_images(name: str, images: Any, expected: str, rank: int) -> None:
    if not isinstance(images, (np.ndarray, jax.Array)):
        raise ValueError(
            f"{name} must be a NumPy or JAX array {expected}, but is a {type(images).__name__}"
        )
    if images.ndim not in (rank, rank + 1):
        raise ValueError(f"{name} must be {expected}, but has the shape {images.shape}")
    if images.ndim == rank + 1 and images.shape[-1] != 3:
        raise ValueError(
            f"{name} must have 3 channels (RGB) or none (grey), but has the shape {images.shape}"
        )
    if images.dtype != np.uint8:
        raise ValueError(f"{name} must be uint8 (grey values 0 to 255), but is {images.dtype}")
    if 0 in images.shape:
        raise ValueError(f"{name} must not be empty, but has the shape {images.shape}")


def _text(box: np.ndarray) -> str:
    return f"({', '.join(f'{value:g}' for value in box)})"
