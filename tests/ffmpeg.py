"""An ffmpeg that makes the files of the tests, and serves their streams."""

import subprocess
from pathlib import Path

import imageio_ffmpeg
import numpy as np

EXECUTABLE = imageio_ffmpeg.get_ffmpeg_exe()
RATE = 25


def ffmpeg(*arguments, frames=None):
    """Run it; frames [T, H, W, 3] are its standard input (`raw`)."""
    command = [EXECUTABLE, "-v", "error", "-y", *map(str, arguments)]
    data = None if frames is None else np.ascontiguousarray(frames).tobytes()
    subprocess.run(command, input=data, check=True, capture_output=True)


def raw(frames, rate=RATE):
    """Arguments that read frames [T, H, W, 3] from standard input."""
    _, rows, columns, _ = frames.shape
    size = f"{columns}x{rows}"
    return ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", size, "-r", rate, "-i", "-"]


def write_plain(path: Path, frames) -> Path:
    """The frames as H.264 that is nearly without loss, with B-frames and a keyframe every 10."""
    codec = ["-c:v", "libx264", "-crf", 8, "-g", 10, "-pix_fmt", "yuv420p"]
    ffmpeg(*raw(frames), *codec, path, frames=frames)
    return path
