"""The process behind a `common.Worker`: writes lines of JSON, and one more for each it reads.

    python worker.py others                      other trackers; then times of their updates
    python worker.py track FRAMES BOXES SETTING  boxes [B, T, 4]; then seconds of a track
    python worker.py first SETTING               seconds of a first and of a second call
    python worker.py stream FRAMES TARGETS       seconds, and memory in bytes, of a stream
    python worker.py imports                     seconds of `import dcs_jax` after `import jax`

A command imports only what it needs, when it runs: the Python with OpenCV's contrib modules may
have no JAX, and `track` uses the dcs_jax of any revision, so only what every revision has.
"""

import ctypes
import functools
import gc
import importlib
import json
import re
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

PROCESS = Path("/proc/self")


def others() -> Iterator[Any]:
    """Seconds of updates, for each line {"tracker", "frames", "boxes", "count"} that is read.

    tracker: "MIL", "KCF" or "CSRT" of OpenCV, or "dlib" for its correlation tracker. frames: a file
    of [T, H, W, 3], RGB. boxes: [B, 4], a tracker each. count: updates of each tracker. The first
    frame and reading the frames are not timed. OpenCV runs on all its threads, dlib on one.
    """
    import cv2

    try:
        import dlib
    except ImportError:
        dlib = None

    def start_dlib(frame: NDArray[np.uint8], box: list[float]) -> Any:
        x, y, w, h = box
        one = dlib.correlation_tracker()
        one.start_track(frame, dlib.drectangle(x, y, x + w - 1, y + h - 1))
        return one

    def start_opencv(tracker: str, frame: NDArray[np.uint8], box: list[float]) -> Any:
        one = getattr(cv2, f"Tracker{tracker}_create")()
        one.init(frame, tuple(round(side) for side in box))
        return one

    def seconds(tracker: str, frames: str, boxes: list[list[float]], count: int) -> float:
        shown = [np.array(frame) for frame in np.load(frames, mmap_mode="r")[: count + 1]]
        if tracker == "dlib":
            start = start_dlib
        else:
            start = functools.partial(start_opencv, tracker)
            shown = [np.ascontiguousarray(frame[..., ::-1]) for frame in shown]
        trackers = [start(shown[0], box) for box in boxes]
        since = time.perf_counter()
        for frame in shown[1:]:
            for one in trackers:
                one.update(frame)
        return time.perf_counter() - since

    found = [name for name in ("MIL", "KCF", "CSRT") if hasattr(cv2, f"Tracker{name}_create")]
    versions = {"OpenCV": cv2.__version__}
    if dlib is not None:
        found.append("dlib")
        versions["dlib"] = dlib.__version__
    yield {"versions": versions, "trackers": found}
    for line in sys.stdin:
        yield seconds(**json.loads(line))


def track(frames_file: str, boxes_file: str, setting: str) -> Iterator[Any]:
    """The boxes and where dcs_jax was found; then the seconds of a track for each line read.

    frames_file: of [T, H, W, 3]. boxes_file: of [B, 4], tracked in one batch.
    """
    import jax

    import dcs_jax
    from dcs_jax.evaluation.settings import parse_setting

    frames, boxes = jax.numpy.asarray(np.load(frames_file)), np.load(boxes_file)
    config, key = parse_setting(setting).config(""), jax.random.key(0)

    def tracked() -> NDArray[np.float32]:
        if len(boxes) == 1:
            return np.asarray(dcs_jax.track_sequence(frames, boxes[0], key, config).boxes)[None]
        return np.asarray(dcs_jax.track_batch(frames, boxes, key, config).boxes)

    yield {"boxes": tracked().tolist(), "package": dcs_jax.__file__}
    for _ in sys.stdin:
        start = time.perf_counter()
        tracked()
        yield time.perf_counter() - start


def first(setting: str) -> Iterator[Any]:
    """Seconds of two calls on a short clip, the second with the box moved."""
    import dcs_jax
    from dcs_jax.evaluation.settings import parse_setting
    from dcs_jax.synthetic import render

    clip, config = render(9), parse_setting(setting).config("")
    seconds = []
    for shift in (0, 1):
        box = clip.boxes[0] + np.array([shift, 0, 0, 0], np.float32)
        start = time.perf_counter()
        np.asarray(dcs_jax.track_sequence(clip.frames, box, config=config).boxes)
        seconds.append(time.perf_counter() - start)
    yield {"first": seconds[0], "second": seconds[1]}


def stream(length: str, targets: str) -> Iterator[Any]:
    """Seconds, and the peak of the memory above what the process holds after a short stream.

    A stream of the same shapes goes first, so that compiled programs do not count. The states and
    one chunk of frames have to be there.
    """
    import jax

    import dcs_jax
    from benchmarks.common import around
    from dcs_jax.runners.slots import CHUNK_FRAMES
    from dcs_jax.synthetic import render

    clip = render(16)
    boxes = around(clip.boxes[0], int(targets))
    there_and_back = [*clip.frames, *clip.frames[-2:0:-1]]

    def run(length: int) -> float:
        # Each frame is a new array, as a decoder makes it.
        order = (there_and_back[number % len(there_and_back)] for number in range(length))
        start = time.perf_counter()
        for _ in dcs_jax.track_stream((frame.copy() for frame in order), boxes):
            pass
        return time.perf_counter() - start

    run(1 + 2 * CHUNK_FRAMES)
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)  # what was freed would count as held
    (PROCESS / "clear_refs").write_text("5")  # reset the peak
    before = _memory("VmRSS")
    seconds = run(int(length))
    state = jax.eval_shape(
        dcs_jax.init, clip.frames[0], boxes[0], jax.random.key(0), dcs_jax.Config()
    )
    # All targets of a video share one pool of features.
    pool, whole = (
        sum(leaf.size * leaf.dtype.itemsize for leaf in jax.tree.leaves(part))
        for part in (state.pool, state)
    )
    yield {
        "seconds": seconds,
        "peak": _memory("VmHWM") - before,
        "states": pool + len(boxes) * (whole - pool),
        "chunk": clip.frames[0].nbytes * CHUNK_FRAMES,
    }


def imports() -> Iterator[Any]:
    """Seconds of `import dcs_jax` after `import jax`."""
    importlib.import_module("jax")
    start = time.perf_counter()
    importlib.import_module("dcs_jax")
    yield time.perf_counter() - start


def _memory(name: str) -> int:
    """Bytes of this process, by a name in its status; OSError without a /proc."""
    found = re.search(rf"{name}:\s+(\d+) kB", (PROCESS / "status").read_text())
    assert found is not None
    return 1024 * int(found[1])


COMMANDS: dict[str, Callable[..., Iterator[Any]]] = {
    one.__name__: one for one in (others, track, first, stream, imports)
}

if __name__ == "__main__":
    for answer in COMMANDS[sys.argv[1]](*sys.argv[2:]):
        print(json.dumps(answer), flush=True)
