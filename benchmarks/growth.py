"""Cases of `benchmarks.run`: how time grows with target, frame and batch; the picture of it."""

import functools
import statistics
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

import dcs_jax
from benchmarks.compare import around
from benchmarks.material import Material, Panel, Row
from benchmarks.timing import clocked, spread, take_turns
from dcs_jax.config import Config
from dcs_jax.core.window import ColumnSums, column_sums
from dcs_jax.runners.sequence import start_track, track_chunk
from dcs_jax.synthetic import render
from dcs_jax.tracker import step
from dcs_jax.types import State

SIDES = (20, 40, 80, 160, 240, 320, 400)  # of the target, pixels
FRAMES = ((120, 160), (240, 320), (480, 640), (720, 1280), (1080, 1920), (2160, 3840))
STEPS = 8  # timed together: a call from Python is then no part of it
JPEG_QUALITY = 90
BATCHES = (1, 8, 32, 128, 256)


def sizes(material: Material) -> Iterator[Row | Panel]:
    """A frame of the default preset over the side of a square target, in frames of 640x480."""
    sides = SIDES[::3] if material.quick else SIDES
    length, updates = (8, 1) if material.quick else (32, 3)
    calls: dict[str, Callable[[], float]] = {}
    for side in sides:
        clip = render(length + 1, (480, 640), (side, side), occlusion=0, cloud=0, lookalike=False)
        state = _started(clip.frames[0], clip.boxes[0])
        rest = jnp.asarray(clip.frames[1:])
        calls[f"dcs_jax {side}"] = clocked(functools.partial(track_chunk, state, rest, Config()))
        calls[f"MIL {side}"] = material.opencv.clock("MIL", clip.frames, clip.boxes[:1], updates)
    seconds = take_turns(calls, material.rounds)
    lines = {
        name: [1e3 * statistics.median(seconds[f"{name} {side}"]) / count for side in sides]
        for name, count in (("dcs_jax", length), ("MIL", updates))
    }
    growth = {name: line[-1] / line[0] for name, line in lines.items()}
    ours = lines["dcs_jax"]
    yield Row(
        f"target of {sides[0]} to {sides[-1]} px in 640x480, default",
        f"a frame takes {max(ours) / min(ours):.2f} times as long at most ({min(ours):.2f} to "
        f"{max(ours):.2f} ms); MIL {growth['MIL']:.1f} times",
        "less than 2 times",
    )
    yield Panel("Size of the target", "side, pixels", "ms a frame", sides, lines)


def frames(material: Material) -> Iterator[Row | Panel]:
    """What a frame costs over its size: reading, copying, column sums, and the step on those."""
    shapes = FRAMES[::5] if material.quick else FRAMES
    calls: dict[str, Callable[[], float]] = {}
    for rows, columns in shapes:
        clip = render(2, (rows, columns), (48, 48), occlusion=0, cloud=0, lookalike=False)
        for name, call in _parts_of_a_frame(clip.frames, clip.boxes[0]).items():
            calls[f"{name} {columns}"] = call
    seconds = take_turns(calls, material.rounds)
    per_call = {"step": STEPS, "column sums": 1, "copy": 1, "decode": 1}
    lines = {
        name: [1e3 * statistics.median(seconds[f"{name} {shape[1]}"]) / count for shape in shapes]
        for name, count in per_call.items()
    }
    pixels = [rows * columns / 1e6 for rows, columns in shapes]
    changes = ", ".join(
        f"{name} {line[-1] / line[0]:.1f} times ({line[0]:.2f} to {line[-1]:.2f} ms)"
        for name, line in lines.items()
    )
    (top, left), (bottom, right) = shapes[0], shapes[-1]
    yield Row(
        f"frame of {left}x{top} to {right}x{bottom}, target of 48 px, default",
        f"{pixels[-1] / pixels[0]:.0f} times the pixels: {changes}",
        "copy and decode grow, not the step",
    )
    yield Panel("Size of the frame", "million pixels", "ms a frame", pixels, lines)


def batch(material: Material) -> Iterator[Row | Panel]:
    """Track-frames per second over the number of targets in one video."""
    counts = BATCHES[:3:2] if material.quick else BATCHES
    shown = jnp.asarray(material.frames[: 9 if material.quick else 33])
    calls = {}
    for count in counts:
        boxes = around(material.box, count)
        track = functools.partial(dcs_jax.track_batch, shown, boxes, jax.random.key(0))
        calls[str(count)] = clocked(track)
    seconds = take_turns(calls, material.rounds)
    rates = {count: [count * len(shown) / t for t in seconds[str(count)]] for count in counts}
    yield Row(
        f"batch of {counts[0]} to {counts[-1]}, default: {len(shown)} frames",
        "; ".join(f"{count}: {spread(rates[count], 0)}" for count in counts) + " track-frames/s",
        "linear or better: no fewer with more",
    )
    medians = [statistics.median(rates[count]) for count in counts]
    lines = {"track_batch": medians}
    yield Panel("Targets in one video", "targets", "track-frames/s", counts, lines)


def draw(panels: list[Panel], path: Path) -> None:
    """The panels as small multiples, both axes logarithmic, in a PNG."""
    import matplotlib  # only where a picture is wanted

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.ticker import LogLocator, NullLocator

    columns = min(3, len(panels))
    rows = -(-len(panels) // columns)
    figure, axes = plt.subplots(
        rows, columns, figsize=(4 * columns, 3.2 * rows), layout="constrained", squeeze=False
    )
    for place in axes.flat[len(panels) :]:
        place.set_axis_off()
    for place, panel in zip(axes.flat, panels, strict=False):
        for name, line in panel.lines.items():
            place.loglog(panel.xs, line, marker="o", markersize=4, label=name)
        place.set(title=panel.title, xlabel=panel.x, ylabel=panel.y)
        every = [value for line in panel.lines.values() for value in line]
        place.set_xticks(panel.xs, [_plain(x) for x in panel.xs])
        place.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        place.yaxis.set_major_formatter(lambda value, _: _plain(value))
        for axis in (place.xaxis, place.yaxis):
            axis.set_minor_locator(NullLocator())
        # A line that does not grow is to look flat.
        if max(every) < 10 * min(every):
            place.set_ylim(min(every) / 4, max(every) * 4)
        place.grid(True, which="major", alpha=0.3)
        if len(panel.lines) > 1:
            place.legend(frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _plain(value: float) -> str:
    return f"{value:.2g}" if value < 10 else f"{value:.0f}"


def _parts_of_a_frame(
    clip: NDArray[np.uint8], box: NDArray[np.float32]
) -> dict[str, Callable[[], float]]:
    """Clocks of what is done with the second of two frames."""
    frame = clip[1]
    bgr = cv2.cvtColor(frame, cv2.COLOR_RGB2BGR)
    _, file = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    # Started in a part of the frame that is of one size for all, so that it is compiled once.
    rows, columns = FRAMES[0]
    x, y = (
        max(0, int(middle - side / 2))
        for middle, side in zip(box[:2] + box[2:] / 2, (columns, rows), strict=True)
    )
    corner = np.array([x, y, 0, 0], np.float32)
    state = _started(clip[0, y : y + rows, x : x + columns], box - corner)
    state = state._replace(box=state.box + corner)
    shown = jnp.asarray(frame)
    add_up = jax.jit(column_sums)
    calls: dict[str, Callable[[], Any]] = {
        "step": functools.partial(_steps, state, add_up(shown), Config()),
        "column sums": functools.partial(add_up, shown),
        "copy": lambda: frame.copy(),
        "decode": lambda: cv2.imdecode(file, cv2.IMREAD_COLOR_RGB),
    }
    return {name: clocked(call) for name, call in calls.items()}


@jax.jit
def _steps(state: State, sums: ColumnSums, config: Config) -> State:
    """Some steps into the same frame."""
    return jax.lax.fori_loop(0, STEPS, lambda _, state: step(state, sums, config)[0], state)


def _started(frame: NDArray[np.uint8], box: NDArray[np.float32]) -> State:
    return start_track(jnp.asarray(frame), jnp.asarray(box), jax.random.key(0), Config())[0]
