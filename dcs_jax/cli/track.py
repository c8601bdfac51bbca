"""`dcs-jax track`: track an object through a video file or a folder of images."""

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Literal

import jax
import numpy as np
import typer
from numpy.typing import NDArray
from rich.progress import MofNCompleteColumn, ProgressColumn, Task
from rich.text import Text

import dcs_jax
from dcs_jax.checks import check_box
from dcs_jax.cli.errors import INTERRUPTED
from dcs_jax.cli.progress import bar
from dcs_jax.compilation import cache
from dcs_jax.evaluation.metrics import mean_centre_error, success_rate
from dcs_jax.io.annotations import ANNOTATION_NAME, BoxWriter, find_annotation, read_boxes
from dcs_jax.io.frames import BrokenSource, FrameSource, StoredSource, open_source
from dcs_jax.io.overlay import VideoWriter, draw_track

Preset = Literal["default", "paper"]


def track(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="SOURCE", help="A video file or a folder of images.", show_default=False
        ),
    ],
    box: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,W,H",
            help="Box of the object in the first frame, pixels. Optional if the folder has a "
            f"{ANNOTATION_NAME}.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="Table of the boxes, one row per frame.")] = Path(
        "boxes.csv"
    ),
    overlay: Annotated[
        Path | None,
        typer.Option(help="Also write a video (mp4, avi) with the boxes.", show_default=False),
    ] = None,
    preset: Annotated[Preset, typer.Option(help="Settings of the tracker.")] = "default",
    seed: Annotated[
        int, typer.Option(min=0, max=2**32 - 1, help="Seed of the random features.")
    ] = 0,
    start: Annotated[int, typer.Option(help="First frame, counted from 0.")] = 0,
    end: Annotated[
        int | None, typer.Option(help="Frame to stop before.", show_default="all frames")
    ] = None,
) -> None:
    """Track an object through a video file or a folder of images.

    If a folder of images has a groundtruth_rect.txt, centre error and success rate are printed at
    the end, and --box is optional: tracking then starts at the first labelled frame.
    """
    initial = None if box is None else parse_box(box)
    frames = open_source(source, start, end)
    for path in (out, overlay):
        if path is not None and path.resolve() == source.resolve():
            raise ValueError(f"{path} is the source: it would be overwritten")
    truth = _read_truth(source, frames)
    if initial is None:
        if truth is None:
            raise ValueError(f"--box is missing, and {source} has no {ANNOTATION_NAME}")
        first = _first_labelled(truth, start, end)
        frames, initial = open_source(source, first, end), truth[first]
    boxes = _track_to_files(frames, initial, truth, out, overlay, preset, seed)
    typer.echo(f"{len(boxes)} frames tracked, boxes in {out}")
    if overlay is not None:
        typer.echo(f"overlay video in {overlay}")
    if truth is not None:
        _report_accuracy(boxes, truth[frames.start : frames.start + len(boxes)])


def parse_box(text: str) -> NDArray[np.float64]:
    """The box [4] in a text X,Y,W,H; ValueError if it is not four numbers."""
    try:
        box = np.array([float(field) for field in text.split(",")])
    except ValueError:
        box = np.empty(0)
    if len(box) != 4:
        raise ValueError(f"--box is {text!r}: expected four numbers X,Y,W,H")
    return box


def _read_truth(source: Path, frames: StoredSource) -> NDArray[np.float64] | None:
    """The annotation [T, 4] of all frames of the source, None if it has none."""
    annotation = find_annotation(source)
    if annotation is None:
        return None
    truth = read_boxes(annotation)
    if len(truth) != frames.total:
        raise ValueError(
            f"{annotation} has {len(truth)} lines, but there are {frames.total} images: "
            "expected one line per image"
        )
    return truth


def _first_labelled(truth: NDArray[np.float64], start: int, end: int | None) -> int:
    """Index of the first frame from start to end that has a label."""
    labelled = np.flatnonzero(~np.isnan(truth[start:end]).any(axis=1))
    if not labelled.size:
        raise ValueError(f"--box is missing, and no frame from {start} on is labelled")
    return start + int(labelled[0])


def _track_to_files(
    frames: FrameSource,
    box: NDArray[np.float64],
    truth: NDArray[np.float64] | None,
    out: Path,
    overlay: Path | None,
    preset: Preset,
    seed: int,
) -> NDArray[np.float32]:
    """Track all frames and write every chunk as it is done: boxes [n, 4]."""
    cache()
    check_box(box, frames.shape[:2])
    config = dcs_jax.Config() if preset == "default" else dcs_jax.Config.paper()
    boxes: list[NDArray[np.float32]] = []
    with ExitStack() as files:
        video = overlay and files.enter_context(VideoWriter(overlay, frames.shape, frames.fps))
        table = files.enter_context(BoxWriter(out, frames.start))
        progress = files.enter_context(bar(MofNCompleteColumn(), _Rate()))
        task = progress.add_task("tracking", total=frames.length)
        try:
            for chunk in dcs_jax.track_stream(frames, box[None], jax.random.key(seed), config):
                tracked = np.asarray(chunk.track.boxes[0])
                confidence = np.asarray(chunk.track.confidence[0])
                table.write(tracked, confidence)
                if video:
                    for n, frame in enumerate(chunk.frames):
                        label = None if truth is None else truth[frames.start + chunk.start + n]
                        video.write(draw_track(frame, tracked[n], confidence[n], label))
                boxes.append(tracked)
                progress.advance(task, len(tracked))
        except BrokenSource as error:
            raise BrokenSource(f"{error}; what was tracked is in {out}", error.frame) from error
        except KeyboardInterrupt:
            progress.stop()
            count = sum(map(len, boxes))
            typer.echo(f"interrupted: {count} frames tracked, boxes in {out}", err=True)
            raise typer.Exit(INTERRUPTED) from None
    return np.concatenate(boxes)


def _report_accuracy(boxes: NDArray[np.float32], truth: NDArray[np.float64]) -> None:
    labelled = int((~np.isnan(truth).any(axis=1)).sum())
    if labelled:
        error, success = mean_centre_error(boxes, truth), success_rate(boxes, truth)
        typer.echo(
            f"centre error {error:.1f} px, success rate {success:.2f} ({labelled} labelled frames)"
        )


class _Rate(ProgressColumn):
    """Frames per second."""

    def render(self, task: Task) -> Text:
        return Text(f"{task.speed:.0f} frames/s" if task.speed else "compiling", style="cyan")
