"""`dcs-jax demo`: render a clip, track it, report the accuracy."""

from pathlib import Path
from time import perf_counter
from typing import Annotated

import jax
import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

import dcs_jax
from dcs_jax.cli.film_strip import Span, film_strip, write_image
from dcs_jax.compilation import cache
from dcs_jax.evaluation.metrics import mean_centre_error, overlap, success_rate
from dcs_jax.io.annotations import BoxWriter
from dcs_jax.io.overlay import VideoWriter, draw_track
from dcs_jax.synthetic import Clip, render


def demo(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the files.")] = Path(
        "dcs-jax-demo"
    ),
) -> None:
    """Render a clip with exact ground truth, track it, and write a video and a film strip.

    Needs no data and no network.
    """
    cache()
    out.mkdir(parents=True, exist_ok=True)
    clip = render()
    config = dcs_jax.Config()
    seconds = []
    for _ in range(2):  # the first run compiles, the second gives the speed
        times, tracks = [perf_counter()], []
        for chunk in dcs_jax.track_stream(clip.frames, clip.boxes[:1], config=config):
            tracks.append(chunk.track)
            times.append(perf_counter())
        seconds.append(times[-1] - times[0])
    track = jax.tree.map(lambda *chunks: np.concatenate(chunks, 1)[0], *tracks)
    boxes, confidence, part_scores = track.boxes, track.confidence, track.part_scores

    speed = (len(boxes) - 1) / (
        times[-1] - times[1]
    )  # after the first frame, where the track only starts
    error, success = mean_centre_error(boxes, clip.boxes), success_rate(boxes, clip.boxes)
    table = Table(title=f"dcs-jax {dcs_jax.__version__}: {len(boxes)} rendered frames")
    table.add_column("measure")
    table.add_column("value", justify="right")
    table.add_row("mean centre error", f"{error:.1f} px")
    table.add_row("success rate (overlap above 0.5)", f"{success:.2f}")
    table.add_row("least overlap", f"{overlap(boxes, clip.boxes).min():.2f}")
    table.add_row("speed, tracking only", f"{speed:.0f} frames/s")
    table.add_row("compiling, once and not counted", f"{seconds[0] - seconds[1]:.1f} s")
    Console().print(table)

    strip = film_strip(
        clip.frames,
        boxes,
        confidence,
        part_scores=part_scores,
        truth=clip.boxes,
        spans=_events(clip),
        title="dcs_jax: tracking by dynamic classifier selection",
        subtitle=f"{len(boxes)} rendered frames · centre error {error:.1f} px · "
        f"success rate {success:.2f} · {speed:.0f} frames/s on this machine",
    )
    write_image(out / "film-strip.png", strip)
    with VideoWriter(out / "overlay.mp4", clip.frames[0].shape) as video:
        for drawn in map(draw_track, clip.frames, boxes, confidence, clip.boxes):
            video.write(drawn)
    with BoxWriter(out / "boxes.csv") as file:
        file.write(boxes[None], confidence[None], track.lost[None], range(len(boxes)))
    for name in ("film-strip.png", "overlay.mp4", "boxes.csv"):
        typer.echo(out / name)


def _events(clip: Clip) -> list[Span]:
    """When the target is occluded, the look-alike passes it, and the light is reduced."""
    sideways = np.abs(clip.lookalike[:, 0] - clip.boxes[:, 0])
    events = {
        "occlusion": clip.occluded > 0,
        "look-alike": sideways < clip.boxes[:, 2],
        "cloud": clip.light < 0.99,
    }
    return [_span(label, happens) for label, happens in events.items() if happens.any()]


def _span(label: str, happens: NDArray[np.bool_]) -> Span:
    frames = np.flatnonzero(happens)
    return Span(label, int(frames[0]), int(frames[-1]) + 1)
