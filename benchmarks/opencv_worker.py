"""Times the trackers of an OpenCV for `benchmarks.run`; needs NumPy and OpenCV only.

    python opencv_worker.py

Writes {"version", "trackers"}, then, for every line {"tracker": "MIL", "frames": "FILE.npy",
"boxes": [[x, y, w, h], ...], "count": n} that it reads, the seconds of n updates of a tracker for
each box. Starting them and reading the frames [T, H, W, 3] RGB are not on the clock. OpenCV runs on
all its threads.
"""

import json
import sys
import time

import cv2
import numpy as np

TRACKERS = ("MIL", "KCF", "CSRT")


def main() -> None:
    """Answer until there is nothing more to read."""
    found = [name for name in TRACKERS if hasattr(cv2, f"Tracker{name}_create")]
    print(json.dumps({"version": cv2.__version__, "trackers": found}), flush=True)
    for line in sys.stdin:
        print(json.dumps(seconds(**json.loads(line))), flush=True)


def seconds(tracker: str, frames: str, boxes: list[list[float]], count: int) -> float:
    """Of `count` updates of a tracker for each box."""
    shown = np.load(frames, mmap_mode="r")[: count + 1]
    bgr = [np.ascontiguousarray(frame[..., ::-1]) for frame in shown]
    trackers = [getattr(cv2, f"Tracker{tracker}_create")() for _ in boxes]
    for one, box in zip(trackers, boxes, strict=True):
        one.init(bgr[0], tuple(round(side) for side in box))
    begin = time.perf_counter()
    for frame in bgr[1:]:
        for one in trackers:
            one.update(frame)
    return time.perf_counter() - begin


if __name__ == "__main__":
    main()
