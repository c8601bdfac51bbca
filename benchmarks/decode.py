"""What it takes to read frames: frames per second and bytes a frame, by format and decoder.

    python -m benchmarks.decode [SOURCE ...] [--frames 300] [--rounds 5]

A SOURCE is a video file or a folder of images. Clips of three sizes are rendered and written as
H.264 and HEVC in mp4, Motion JPEG in avi and folders of JPEG. A rendered scene has less detail than
a filmed one: to plan, give videos of your own.

Two decoders take turns, to RGB on all cores, the files in the system's cache: PyAV, which dcs_jax
uses, and OpenCV's VideoCapture. The table has the median and range over the rounds of frames per
second, and the processor time of a frame, of all threads.
"""

import argparse
import functools
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import av
import cv2

from benchmarks.common import median_range, take_turns
from dcs_jax.cli.environment import silence_opencv
from dcs_jax.io.frames import StoredSource, open_source
from dcs_jax.io.overlay import VideoWriter
from dcs_jax.synthetic import render

SIZES = ((240, 320), (720, 1280), (1080, 1920))  # rows and columns
JPEG_QUALITY = 90


def main() -> None:
    """Decode every source in turn and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("sources", nargs="*", type=Path)
    parser.add_argument("--frames", type=int, default=300, help="frames of the rendered clips")
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    silence_opencv()
    with tempfile.TemporaryDirectory() as folder:
        named = {path.name: path for path in arguments.sources}
        for rows, columns in SIZES:
            named.update(write_clips(Path(folder), (rows, columns), arguments.frames))
        sources = {name: open_source(path) for name, path in named.items()}
        ways: dict[tuple[str, str], Callable[[], int]] = {}
        for name, source in sources.items():
            ways[name, "PyAV" if source.path.is_file() else "images"] = functools.partial(
                lambda source: sum(1 for _ in source), source
            )
            if source.path.is_file():
                ways[name, "OpenCV"] = functools.partial(read_by_opencv, source.path)
        counts: dict[tuple[str, str], int] = {}
        processor: dict[tuple[str, str], list[float]] = {way: [] for way in ways}

        def decode(way: tuple[str, str]) -> float:
            spent, start = time.process_time(), time.perf_counter()
            counts[way] = ways[way]()
            processor[way].append(time.process_time() - spent)
            return time.perf_counter() - start

        calls = {" by ".join(way): functools.partial(decode, way) for way in ways}
        seconds = take_turns(calls, arguments.rounds)
        print("| source | frame | decoder | frames/s | ms of a core a frame | bytes a frame |")
        print("|---|---|---|---|---|---|")
        for (name, decoder), count in counts.items():
            source = sources[name]
            rates = [count / spent for spent in seconds[f"{name} by {decoder}"]]
            cost = 1000 * statistics.median(processor[name, decoder]) / count
            print(
                f"| {name} | {source.shape[1]}x{source.shape[0]} | {decoder} "
                f"| {median_range(rates, 0)} | {cost:.2f} | {bytes_of(source) / count:.0f} |"
            )


def read_by_opencv(path: Path) -> int:
    """The number of frames, all converted to RGB."""
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    count = 0
    while True:
        good, image = capture.read()
        if not good:
            break
        cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
        count += 1
    capture.release()
    return count


def write_clips(folder: Path, size: tuple[int, int], length: int) -> dict[str, Path]:
    """The rendered clip in every format that can be written, by a name for the table."""
    rows, columns = size
    clip = render(length, size, (rows // 4, rows // 5))
    name = f"{columns}x{rows}"
    written = {
        f"H.264, {name}": folder / f"{name}.mp4",
        f"HEVC, {name}": folder / f"{name}-hevc.mp4",
        f"Motion JPEG, {name}": folder / f"{name}.avi",
        f"JPEG folder, {name}": folder / name,
    }
    for path in (folder / f"{name}.mp4", folder / f"{name}.avi"):
        with VideoWriter(path, (rows, columns, 3)) as writer:
            for frame in clip.frames:
                writer.write(frame)
    with av.open(str(folder / f"{name}-hevc.mp4"), "w") as container:
        options = {"crf": "23", "preset": "fast", "x265-params": "log-level=none"}
        stream = container.add_stream("libx265", 30, options=options)
        stream.width, stream.height, stream.pix_fmt = columns, rows, "yuv420p"
        for frame in clip.frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        container.mux(stream.encode(None))
    (folder / name).mkdir()
    for t, frame in enumerate(clip.frames):
        bgr = cv2.cvtColor(frame, cv2.COLOR_RGB2BGR)
        path = folder / name / f"{t:05d}.jpg"
        cv2.imwrite(str(path), bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return written


def bytes_of(source: StoredSource) -> int:
    """The size of a video, or of the files of a folder."""
    files = source.path.iterdir() if source.path.is_dir() else [source.path]
    return sum(path.stat().st_size for path in files)


if __name__ == "__main__":
    main()
