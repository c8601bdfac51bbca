"""Measures what a fresh process is needed for, for `benchmarks.run`; writes a line of JSON.

python -m benchmarks.fresh_worker first SETTING: seconds of the first call and of the second
python -m benchmarks.fresh_worker stream FRAMES TARGETS: seconds, and memory in bytes
"""

import ctypes
import gc
import json
import re
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import jax
import numpy as np
from numpy.typing import NDArray

import dcs_jax
from benchmarks.compare import around
from dcs_jax.config import Config
from dcs_jax.evaluation.settings import parse_setting
from dcs_jax.runners.slots import CHUNK_FRAMES
from dcs_jax.synthetic import Clip, render

PROCESS = Path("/proc/self")


def first(setting: str) -> dict[str, float]:
    """Seconds of two calls on a short clip, the box in the second one moved."""
    clip = render(9)
    config = parse_setting(setting).config("")
    seconds = []
    for shift in (0, 1):
        begin = time.perf_counter()
        box = clip.boxes[0] + np.array([shift, 0, 0, 0], np.float32)
        jax.block_until_ready(dcs_jax.track_sequence(clip.frames, box, config=config))
        seconds.append(time.perf_counter() - begin)
    return {"first": seconds[0], "second": seconds[1]}


def stream(length: int, targets: int) -> dict[str, float]:
    """Follow targets through so many frames: seconds, and the peak of the memory beside the rest.

    The rest is what the process holds after a short stream of the same shapes, compiled programs
    and all. One chunk and the states are what has to be there.
    """
    clip = render(16)
    boxes = around(clip.boxes[0], targets)
    _follow(clip, boxes, 1 + 2 * CHUNK_FRAMES)
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)  # or what was freed would count as held
    (PROCESS / "clear_refs").write_text("5")  # the peak from here on
    before = _memory("VmRSS")
    begin = time.perf_counter()
    _follow(clip, boxes, length)
    seconds = time.perf_counter() - begin
    return {
        "seconds": seconds,
        "peak": _memory("VmHWM") - before,
        "before": before,
        "states": _state_bytes(clip.frames[0], boxes),
        "chunk": clip.frames[0].nbytes * CHUNK_FRAMES,
    }


def _follow(clip: Clip, boxes: NDArray[np.float32], length: int) -> None:
    for _ in dcs_jax.track_stream(_frames(clip, length), boxes):
        pass


def _frames(clip: Clip, length: int) -> Iterator[NDArray[np.uint8]]:
    """The clip forwards and backwards, each frame a new array as a decoder makes it."""
    there_and_back = [*range(len(clip.frames)), *range(len(clip.frames) - 2, 0, -1)]
    for number in range(length):
        yield clip.frames[there_and_back[number % len(there_and_back)]].copy()


def _state_bytes(frame: NDArray[np.uint8], boxes: NDArray[np.float32]) -> int:
    """Of the states of all targets, and of the pool of features that they share."""
    begin = jax.eval_shape(dcs_jax.init, frame, boxes[0], jax.random.key(0), Config())
    pool = sum(leaf.size * leaf.dtype.itemsize for leaf in jax.tree.leaves(begin.pool))
    whole = sum(leaf.size * leaf.dtype.itemsize for leaf in jax.tree.leaves(begin))
    return pool + len(boxes) * (whole - pool)


def _memory(name: str) -> int:
    """Bytes of this process; OSError where the system does not tell."""
    found = re.search(rf"{name}:\s+(\d+) kB", (PROCESS / "status").read_text())
    assert found is not None
    return 1024 * int(found[1])


if __name__ == "__main__":
    if sys.argv[1] == "first":
        print(json.dumps(first(sys.argv[2])))
    else:
        print(json.dumps(stream(int(sys.argv[2]), int(sys.argv[3]))))
