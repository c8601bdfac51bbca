"""Small sequences on disk, in the layouts of the public data sets, from a rendered clip."""

from pathlib import Path

import cv2
import numpy as np

from dcs_jax.io.overlay import VideoWriter

# A setting that is compiled and run in a moment.
SMALL = "default canvas=20 parts=5 selectors=6 pool_size=12"


def write_images(folder, frames, names):
    folder.mkdir(parents=True, exist_ok=True)
    for frame, name in zip(frames, names, strict=True):
        cv2.imwrite(str(folder / name), cv2.cvtColor(frame, cv2.COLOR_RGB2BGR))


def write_rows(path: Path, rows, delimiter=","):
    np.savetxt(path, np.asarray(rows, float), fmt="%.4f", delimiter=delimiter)


def write_otb(root, name, clip, first=1, delimiter=","):
    names = [f"{first + t:04d}.jpg" for t in range(len(clip.frames))]
    write_images(root / name / "img", clip.frames, names)
    write_rows(root / name / "groundtruth_rect.txt", clip.boxes, delimiter)


def write_video(path, clip):
    path.parent.mkdir(parents=True, exist_ok=True)
    with VideoWriter(path, clip.frames[0].shape) as writer:
        for frame in clip.frames:
            writer.write(frame)
