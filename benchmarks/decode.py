"""What it takes to read frames: frames per second of one core and bytes a frame, by format.

    python -m benchmarks.decode [SOURCE ...] [--frames 300] [--rounds 5]

A SOURCE is a video file or a folder of images. Clips of two sizes are rendered and written as
MPEG-4 in mp4, Motion JPEG in avi and folders of JPEG, and as H.264 where there is an ffmpeg with
libx264. A rendered scene has less detail than a filmed one: to plan, give videos of your own.

Decoding runs on one thread, the files in the system's cache: this is what a core can decode, not
what a disk can deliver. The formats take turns; the table has median and range over the rounds.
"""

import argparse
import functools
import os
import shutil
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

# OpenCV's FFmpeg reads it when the first video is opened; the default is a thread for each core.
os.environ.setdefault("OPENCV_FFMPEG_CAPTURE_OPTIONS", "threads;1")

import cv2

from benchmarks.common import median_range, take_turns
from dcs_jax.cli.environment import silence_opencv
from dcs_jax.io.frames import StoredSource, open_source
from dcs_jax.io.overlay import VideoWriter
from dcs_jax.synthetic import render

SIZES = ((240, 320), (720, 1280))  # rows and columns
JPEG_QUALITY = 90


def main() -> None:
    """Decode every source in turn and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("sources", nargs="*", type=Path)
    parser.add_argument("--frames", type=int, default=300, help="frames of the rendered clips")
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    silence_opencv()
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as folder:
        named = {path.name: path for path in arguments.sources}
        for rows, columns in SIZES:
            named |= write_clips(Path(folder), (rows, columns), arguments.frames)
        sources = {name: open_source(path) for name, path in named.items()}
        counts: dict[str, int] = {}

        def decode(name: str) -> float:
            # Processor time: another process on the core does not count.
            start = time.process_time()
            counts[name] = sum(1 for _ in sources[name])
            return time.process_time() - start

        calls = {name: functools.partial(decode, name) for name in sources}
        seconds = take_turns(calls, arguments.rounds)
        print(f"one thread, processor time, median (range) of {arguments.rounds}\n")
        print("| source | frame | frames/s of a core | ms a frame | bytes read a frame |")
        print("|---|---|---|---|---|")
        for name, source in sources.items():
            rates = [counts[name] / spent for spent in seconds[name]]
            print(
                f"| {name} | {source.shape[1]}x{source.shape[0]} | {median_range(rates, 0)} "
                f"| {1000 / statistics.median(rates):.2f} | {bytes_of(source) / counts[name]:.0f} |"
            )


def write_clips(folder: Path, size: tuple[int, int], length: int) -> dict[str, Path]:
    """The rendered clip in every format that can be written, by a name for the table."""
    rows, columns = size
    clip = render(length, size, (rows // 4, rows // 5))
    name = f"{columns}x{rows}"
    written = {
        f"MPEG-4, {name}": folder / f"{name}.mp4",
        f"Motion JPEG, {name}": folder / f"{name}.avi",
        f"JPEG folder, {name}": folder / name,
    }
    for path in (folder / f"{name}.mp4", folder / f"{name}.avi"):
        with VideoWriter(path, (rows, columns, 3)) as writer:
            for frame in clip.frames:
                writer.write(frame)
    (folder / name).mkdir()
    for t, frame in enumerate(clip.frames):
        bgr = cv2.cvtColor(frame, cv2.COLOR_RGB2BGR)
        path = folder / name / f"{t:05d}.jpg"
        cv2.imwrite(str(path), bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    ffmpeg = shutil.which("ffmpeg")
    if ffmpeg is not None:
        path = folder / f"{name}-h264.mp4"
        pipe = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", name, "-r", "30", "-i", "-"]
        codec = ["-c:v", "libx264", "-preset", "medium", "-crf", "23", "-pix_fmt", "yuv420p"]
        command = [ffmpeg, "-loglevel", "error", "-y", *pipe, *codec, str(path)]
        done = subprocess.run(command, input=clip.frames.tobytes(), check=False)
        if done.returncode == 0:
            written[f"H.264, {name}"] = path
    return written


def bytes_of(source: StoredSource) -> int:
    """The size of a video, or of the files of a folder."""
    files = source.path.iterdir() if source.path.is_dir() else [source.path]
    return sum(path.stat().st_size for path in files)


if __name__ == "__main__":
    main()
