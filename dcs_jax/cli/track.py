"""`dcs-jax track`: track objects through a video, a folder of images or a stream."""

import functools
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import jax
import numpy as np
import typer
from numpy.typing import NDArray
from rich.progress import MofNCompleteColumn, ProgressColumn, Task
from rich.text import Text

import dcs_jax
from dcs_jax import formats
from dcs_jax.checks import check_box
from dcs_jax.cli.environment import uninterrupted
from dcs_jax.cli.errors import INTERRUPTED, warn
from dcs_jax.cli.options import Changes, Preset, PresetName, Seed, together
from dcs_jax.cli.outputs import TABLE, Outputs
from dcs_jax.cli.progress import bar
from dcs_jax.cli.targets import (
    Target,
    check_names,
    first_labelled,
    parse_boxes,
    read_labels,
    read_targets,
)
from dcs_jax.compilation import cache
from dcs_jax.config import Config
from dcs_jax.evaluation.metrics import mean_centre_error, success_rate
from dcs_jax.evaluation.settings import with_changes
from dcs_jax.io.annotations import ANNOTATION_NAME
from dcs_jax.io.frames import BrokenSource, FrameSource, Image, open_frames, open_source
from dcs_jax.io.live import StreamSource
from dcs_jax.runners.stream import Stream
from dcs_jax.saving import Saved, load, save
from dcs_jax.types import State

OUT = "boxes"  # name of the results without a suffix, where none is given


def track(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help="A video file, a folder of images, a pattern img_%04d.png, an address rtsp://…, "
            "the number of a camera, or - for standard input.",
            show_default=False,
        ),
    ],
    box: Annotated[
        list[str] | None,
        typer.Option(
            metavar="[NAME=]X,Y,W,H",
            help="Box of an object in the first frame, pixels; repeatable. Optional if the folder "
            f"has a {ANNOTATION_NAME}.",
            show_default=False,
        ),
    ] = None,
    boxes: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Tracks of any format: every object is followed from its first box on.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Results, a row per frame and object.", show_default="boxes.csv"),
    ] = None,
    format: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help=f"Format of the results: {', '.join(formats.NAMES)}.",
            show_default="that of the suffix of --out, or csv",
        ),
    ] = None,
    overlay: Annotated[
        Path | None,
        typer.Option(help="Also write a video (mp4, mkv, avi) with the boxes.", show_default=False),
    ] = None,
    preset: Preset = "default",
    changes: Changes = None,
    seed: Seed = 0,
    start: Annotated[int, typer.Option(help="First frame, counted from 0.")] = 0,
    end: Annotated[
        int | None, typer.Option(help="Frame to stop before.", show_default="all frames")
    ] = None,
    max_frames: Annotated[
        int | None, typer.Option(min=1, help="Stop after so many frames.", show_default="all")
    ] = None,
    raw: Annotated[
        str | None,
        typer.Option(
            metavar="WxH[:FORMAT]",
            help="Standard input or a pipe is bare pixels of this size, in a format that FFmpeg "
            "names (rgb24, gray, yuv420p, ...).",
            show_default=False,
        ),
    ] = None,
    save_to: Annotated[
        Path | None,
        typer.Option(
            "--save", metavar="FILE", help="Store the tracks to go on from.", show_default=False
        ),
    ] = None,
    resume: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Go on with the stored tracks in the next frame, which is the first of SOURCE.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Track objects through a video file, a folder of images or a stream.

    If a folder of images has a groundtruth_rect.txt, centre error and success rate are printed at
    the end, and --box is optional: tracking then starts at the first labelled frame.
    """
    saved = None if resume is None else _load(resume, preset, changes)
    config = saved.config if saved else with_changes([preset], together(changes))[-1].config("")
    out, format = _out(out, format)
    _check_paths(source, out, overlay, save_to)
    if max_frames is not None:
        end = min(end or start + max_frames, start + max_frames)
    given = parse_boxes(box or [], start)
    frames = open_frames(source, start, end, raw)
    if boxes is not None:
        given += read_targets(boxes, start, end)
    labels = read_labels(source, frames)
    if not given and saved is None:
        given = [first_labelled(labels, source, start, end)]
    elif labels.problem:
        warn(f"labels are not used: {labels.problem}")
    first = min((target.frame for target in given), default=start)
    if first > start and saved is None:
        frames = open_source(source, first, end)
    names = [*(name or None for name in (saved.states if saved else {})), *(t.name for t in given)]
    if len(names) > 1:
        names = [name or str(number) for number, name in enumerate(names, 1)]
        check_names(names)
    for target in given:
        check_box(target.box, frames.shape)
    cache()
    # What drops frames that come too fast is followed frame by frame.
    live = isinstance(frames, StreamSource) and frames.live
    states = list(saved.states.values()) if saved else []
    make = functools.partial(_stream, frames.start, given, states, config, seed, live)
    if live:  # what it shows while programs are compiled is not tracked
        for _ in make(np.zeros((2, *frames.shape), np.uint8)):
            pass
    tracker = make(frames)
    truth = labels.truth if len(names) == 1 else None
    with Outputs(frames, names, out, format, overlay, truth) as outputs:
        _run(tracker, frames, outputs, names, config, save_to)
    typer.echo(f"{outputs.count} frames tracked, boxes in {out}")
    if overlay is not None:
        typer.echo(f"overlay video in {overlay}")
    if save_to is not None:
        typer.echo(f"to go on: --resume {save_to}")
    for note in frames.notes:
        warn(note)
    if isinstance(frames, StreamSource) and frames.dropped:
        warn(f"{frames.dropped} frames came too fast and were dropped")
    if truth is not None:
        _report_accuracy(outputs.boxes[0], truth[frames.start : frames.start + outputs.count])


def _load(resume: Path, preset: PresetName, changes: list[str] | None) -> Saved:
    if changes or preset != "default":
        raise ValueError(f"--preset and --set cannot be changed: {resume} has its own settings")
    return load(resume)


def _out(out: Path | None, format: str | None) -> tuple[Path, str]:
    """Where the results go, and in which format."""
    if format is not None and format not in formats.FORMATS:
        raise ValueError(f"--format is {format!r}: expected one of {', '.join(formats.NAMES)}")
    if out is None:
        format = format or TABLE
        out = Path(OUT).with_suffix(formats.FORMATS[format].suffix)
    return out, format or formats.named_by(out) or TABLE


def _check_paths(source: str, *outputs: Path | None) -> None:
    """ValueError where the source, or what was written before, would be overwritten."""
    seen: dict[Path, Path] = {}
    for path in filter(None, outputs):
        whole = path.resolve()
        if whole == Path(source).resolve():
            raise ValueError(f"{path} is the source: it would be overwritten")
        if whole in seen:
            raise ValueError(f"{seen[whole]} and {path} are the same file: expected two")
        seen[whole] = path


def _stream(
    start: int,
    given: list[Target],
    states: list[State],
    config: Config,
    seed: int,
    live: bool,
    frames: Iterable[Image],
) -> Stream:
    """The stream from frame `start` on with all objects, also those that start in a later one."""
    now = [target for target in given if target.frame == start]
    # By default the states' own features.
    key = jax.random.key(seed) if now else None
    stream = dcs_jax.track_stream(
        frames,
        [target.box for target in now] or np.empty((0, 4)),
        key,
        config,
        slots=len(states) + len(given),
        chunk=1 if live else None,
        states=states,
    )
    for target in given:
        if target.frame > start:
            stream.add(target.box, frame=target.frame - start)
    return stream


def _run(
    stream: Stream,
    frames: FrameSource,
    outputs: Outputs,
    names: list[str | None],
    config: Config,
    save_to: Path | None,
) -> None:
    """Track all frames and write every chunk as it is done."""
    states: dict[str, State] = {}
    with bar(MofNCompleteColumn(), _Rate()) as progress:
        task = progress.add_task("tracking", total=frames.length)
        try:
            for chunk in stream:
                with uninterrupted():
                    if save_to is not None:
                        slots = [slot for slot, active in enumerate(chunk.active) if active]
                        states = {names[slot] or "": stream.state(slot) for slot in slots}
                    outputs.write(chunk)
                progress.advance(task, len(chunk.frames))
        except BrokenSource as error:
            kept = f"; what was tracked is in {outputs.path}" if outputs.count else ""
            raise BrokenSource(f"{error}{kept}", error.frame) from error
        except KeyboardInterrupt:
            progress.stop()
            typer.echo(
                f"interrupted: {outputs.count} frames tracked, boxes in {outputs.path}", err=True
            )
            raise typer.Exit(INTERRUPTED) from None
        finally:
            if save_to is not None and states:
                save(save_to, states, config)


def _report_accuracy(boxes: NDArray[np.float32], truth: NDArray[np.float64]) -> None:
    labelled = int((~np.isnan(truth).any(axis=1)).sum())
    if labelled:
        error, success = mean_centre_error(boxes, truth), success_rate(boxes, truth)
        typer.echo(
            f"centre error {error:.1f} px, success rate {success:.2f} ({labelled} labelled "
            f"frame{'s' * (labelled != 1)})"
        )


class _Rate(ProgressColumn):
    """Frames per second."""

    def render(self, task: Task) -> Text:
        return Text(f"{task.speed:.0f} frames/s" if task.speed else "compiling", style="cyan")
