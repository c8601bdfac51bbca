"""Times tracks for `benchmarks.compare`, with the dcs_jax of the checkout it is started for.

    python track_worker.py FRAMES.npy BOXES.npy SETTING

Only what every revision has is used. Tracks the boxes [B, 4] through the frames [T, H, W, 3] once,
writes {"boxes": [B, T, 4], "package": path} as a line of JSON, then the seconds of one more time
for every line it reads.
"""

import functools
import json
import sys
import time

import jax
import numpy as np

import dcs_jax
from dcs_jax.evaluation.settings import parse_setting


def main() -> None:
    """Answer until there is nothing more to read."""
    frames, boxes = np.load(sys.argv[1]), np.load(sys.argv[2])
    config = parse_setting(sys.argv[3]).config("")
    key = jax.random.key(0)
    shown = jax.numpy.asarray(frames)
    if len(boxes) == 1:
        track = functools.partial(dcs_jax.track_sequence, shown, boxes[0], key, config)
    else:
        track = functools.partial(dcs_jax.track_batch, shown, boxes, key, config)
    found = np.asarray(track().boxes).reshape(len(boxes), len(frames), 4)
    print(json.dumps({"boxes": found.tolist(), "package": dcs_jax.__file__}), flush=True)
    for _ in sys.stdin:
        begin = time.perf_counter()
        jax.block_until_ready(track())
        print(json.dumps(time.perf_counter() - begin), flush=True)


if __name__ == "__main__":
    main()
