"""Frames stacked to chunks, and read ahead by a thread."""

import math
import queue
import threading
from collections.abc import Iterable, Iterator
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from dcs_jax.io.source import Image

Item = TypeVar("Item")

_ALIGNMENT = 64  # bytes, of an array that JAX does not copy


def chunks(frames: Iterable[Image], length: int) -> Iterator[NDArray[np.uint8]]:
    """Stack frames to [length, H, W, 3]; the last chunk may be shorter.

    If reading a frame raises an exception, the frames before it are yielded first.
    """
    stack: NDArray[np.uint8] | None = None
    filled = 0
    broken: Exception | None = None
    rest = iter(frames)
    while True:
        try:
            frame = next(rest)
        except StopIteration:
            break
        except Exception as error:  # raised below, after the frames before it
            broken = error
            break
        if stack is None:
            stack = aligned((length, *frame.shape))
        stack[filled] = frame
        filled += 1
        if filled == length:
            yield stack
            stack, filled = None, 0
    if stack is not None:
        yield stack[:filled]
    if broken is not None:
        raise broken


def aligned(shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """An array that JAX reads where it is: others it copies."""
    memory = np.empty(math.prod(shape) + _ALIGNMENT, np.uint8)
    first = -memory.ctypes.data % _ALIGNMENT
    return memory[first : first + math.prod(shape)].reshape(shape)


def ahead(items: Iterator[Item]) -> Iterator[Item]:
    """The same items; a thread makes the next one while the current one is used.

    An exception that is raised by making an item is raised in its place. Closing does not wait for
    the thread: the source may be a camera that says no more.
    """
    wanted = threading.Semaphore()
    made: queue.SimpleQueue[tuple[Item | None, BaseException | None]] = queue.SimpleQueue()
    closed = False

    def make() -> None:
        while wanted.acquire() and not closed:
            try:
                made.put((next(items, None), None))
            except BaseException as error:
                made.put((None, error))

    threading.Thread(target=make, name="dcs_jax.ahead", daemon=True).start()
    try:
        while True:
            item, error = made.get()
            if error is not None:
                raise error
            if item is None:
                return
            wanted.release()
            yield item
    finally:
        closed = True
        wanted.release()
