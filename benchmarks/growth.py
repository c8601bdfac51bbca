"""Cases of `benchmarks.run`: how time and memory grow with target, frame and video."""

import functools
import itertools
import statistics
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Inputs, Panel, Row, clocked, fresh, median_range, take_turns
from dcs_jax.config import Config
from dcs_jax.core.window import VideoFrame
from dcs_jax.runners.sequence import init_track, track_chunk
from dcs_jax.synthetic import render
from dcs_jax.tracker import step
from dcs_jax.types import State

SIDES = (20, 40, 80, 160, 240, 320, 400)  # of the target, pixels
FRAMES = ((120, 160), (240, 320), (480, 640), (720, 1280), (1080, 1920), (2160, 3840))
# Sizes of frame and target.
TABLE = (
    ((240, 320), 40),
    ((240, 320), 80),
    ((480, 640), 80),
    ((720, 1280), 80),
    ((1080, 1920), 80),
    ((1080, 1920), 300),
    ((2160, 3840), 160),
)
STEPS = 8  # timed together, so that the call from Python does not count
JPEG_QUALITY = 90
LENGTHS = (100, 1000, 10_000, 100_000)
MEMORY_TARGETS = (1, 32, 256)


def table(inputs: Inputs) -> Iterator[Row | Panel]:
    """Frames per second of one target and every other tracker, by the sizes of frame and target."""
    updates = 2 if inputs.quick else STEPS
    for (rows, columns), side in TABLE[::5] if inputs.quick else TABLE:
        clip = render(
            1 + STEPS, (rows, columns), (side, side), occlusion=0, cloud=0, lookalike=False
        )
        state = _init(clip.frames[0], clip.boxes[0])
        rest = jnp.asarray(clip.frames[1:])
        calls = {"dcs_jax": clocked(functools.partial(track_chunk, state, rest, Config()))}
        for tracker in inputs.others.trackers:
            calls[tracker] = inputs.others.clock(tracker, clip.frames, clip.boxes[:1], updates)
        counts = dict.fromkeys(calls, updates) | {"dcs_jax": STEPS}
        rates = {
            name: [counts[name] / t for t in times]
            for name, times in take_turns(calls, inputs.rounds).items()
        }
        yield Row(
            f"{columns}x{rows}, target of {side} px, default: {STEPS} frames, the others {updates}",
            ", ".join(f"{name} {median_range(rate, 0)}" for name, rate in rates.items())
            + " frames/s",
            "ahead of KCF and dlib",
        )


def sizes(inputs: Inputs) -> Iterator[Row | Panel]:
    """A frame of the default preset over the side of a square target, in frames of 640x480."""
    sides = SIDES[::3] if inputs.quick else SIDES
    length, updates = (8, 1) if inputs.quick else (32, 3)
    calls: dict[str, Callable[[], float]] = {}
    for side in sides:
        clip = render(length + 1, (480, 640), (side, side), occlusion=0, cloud=0, lookalike=False)
        state = _init(clip.frames[0], clip.boxes[0])
        rest = jnp.asarray(clip.frames[1:])
        calls[f"dcs_jax {side}"] = clocked(functools.partial(track_chunk, state, rest, Config()))
        calls[f"MIL {side}"] = inputs.others.clock("MIL", clip.frames, clip.boxes[:1], updates)
    seconds = take_turns(calls, inputs.rounds)
    lines = {
        name: [1e3 * statistics.median(seconds[f"{name} {side}"]) / count for side in sides]
        for name, count in (("dcs_jax", length), ("MIL", updates))
    }
    ours, mil = lines["dcs_jax"], lines["MIL"]
    yield Row(
        f"target of {sides[0]} to {sides[-1]} px in 640x480, default",
        f"a frame takes {max(ours) / min(ours):.2f} times as long at most ({min(ours):.2f} to "
        f"{max(ours):.2f} ms); MIL {mil[-1] / mil[0]:.1f} times",
        "less than 2 times",
    )
    yield Panel("Size of the target", "side, pixels", "ms a frame", sides, lines)


def frames(inputs: Inputs) -> Iterator[Row | Panel]:
    """A frame of the default preset over its size: decoding, copying, and the step."""
    shapes = FRAMES[::5] if inputs.quick else FRAMES
    calls: dict[str, Callable[[], float]] = {}
    for rows, columns in shapes:
        clip = render(2, (rows, columns), (48, 48), occlusion=0, cloud=0, lookalike=False)
        for name, call in _frame_calls(clip.frames, clip.boxes[0]).items():
            calls[f"{name} {columns}"] = clocked(call)
    seconds = take_turns(calls, inputs.rounds)
    per_call = {"step": STEPS, "copy": 1, "decode": 1}
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


def length(inputs: Inputs) -> Iterator[Row | Panel]:
    """A stream of one target over the number of frames: time and peak memory, one run of each."""
    lengths = LENGTHS[:2] if inputs.quick else LENGTHS
    found = [fresh("stream", count, 1) for count in lengths]
    a_frame = [1e3 * one["seconds"] / count for one, count in zip(found, lengths, strict=True)]
    yield Row(
        f"{lengths[0]} to {lengths[-1]} frames of 320x240, track_stream, default",
        "; ".join(
            f"{count}: {time:.2f} ms a frame, {one['peak'] / 1e6:.1f} MB"
            for count, time, one in zip(lengths, a_frame, found, strict=True)
        )
        + f"; the longest: {_peak(found[-1])}",
        "linear or better; memory within 1.5 times state plus one chunk",
    )
    yield Panel("Frames of a stream", "frames", "ms a frame", lengths, {"track_stream": a_frame})
    yield _memory_panel("Memory over frames", "frames", lengths, found)


def memory(inputs: Inputs) -> Iterator[Row | Panel]:
    """Peak memory of a stream over the number of targets, one run of each."""
    counts = MEMORY_TARGETS[1:2] if inputs.quick else MEMORY_TARGETS
    found = [fresh("stream", 65, count) for count in counts]
    yield Row(
        f"memory of {', '.join(map(str, counts))} targets in 320x240, track_stream, default",
        "; ".join(f"{count}: {_peak(one)}" for count, one in zip(counts, found, strict=True)),
        "within 1.5 times state plus one chunk",
    )
    yield _memory_panel("Memory over targets", "targets", counts, found)


def draw(panels: list[Panel], path: Path) -> None:
    """Write the panels as small multiples, both axes logarithmic, into a PNG."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator

    columns = min(3, len(panels))
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(4 * columns, 3.2 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).flat
    for axis, panel in itertools.zip_longest(axes, panels):
        if panel is None:
            axis.set_axis_off()
            continue
        for name, line in panel.lines.items():
            axis.loglog(panel.xs, line, marker="o", markersize=4, label=name)
        axis.set(title=panel.title, xlabel=panel.x, ylabel=panel.y)
        axis.set_xticks(panel.xs, [f"{round(x, 2):g}" for x in panel.xs])
        axis.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.yaxis.set_major_formatter("{x:g}")
        axis.minorticks_off()
        low, high = (f(itertools.chain(*panel.lines.values())) for f in (min, max))
        if high < 10 * low:  # a line that does not grow looks flat
            axis.set_ylim(low / 4, high * 4)
        axis.grid(True, alpha=0.3)
        if len(panel.lines) > 1:
            axis.legend(frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def _frame_calls(clip: NDArray[np.uint8], box: NDArray[np.float32]) -> dict[str, Callable[[], Any]]:
    """What is done with the second of two frames."""
    frame = clip[1]
    bgr = cv2.cvtColor(frame, cv2.COLOR_RGB2BGR)
    _, file = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    # Initialised in a crop of the same size for all frames, so that it is compiled once.
    rows, columns = FRAMES[0]
    x, y = (
        max(0, int(middle - side / 2))
        for middle, side in zip(box[:2] + box[2:] / 2, (columns, rows), strict=True)
    )
    corner = np.array([x, y, 0, 0], np.float32)
    state = _init(clip[0, y : y + rows, x : x + columns], box - corner)
    state = state._replace(box=state.box + corner)
    shown = VideoFrame(jnp.asarray(frame)[None], jnp.int32(0))
    return {
        "step": functools.partial(_steps, state, shown, Config()),
        "copy": lambda: frame.copy(),
        "decode": lambda: cv2.imdecode(file, cv2.IMREAD_COLOR_RGB),
    }


@jax.jit
def _steps(state: State, frame: VideoFrame, config: Config) -> State:
    """Several steps with the same frame."""
    return jax.lax.fori_loop(0, STEPS, lambda _, state: step(state, frame, config)[0], state)


def _init(frame: NDArray[np.uint8], box: NDArray[np.float32]) -> State:
    return init_track(jnp.asarray(frame), jnp.asarray(box), jax.random.key(0), Config())[0]


def _peak(one: dict[str, float]) -> str:
    least = one["states"] + one["chunk"]
    return (
        f"{one['peak'] / 1e6:.1f} MB = {one['peak'] / least:.2f} times (state "
        f"{one['states'] / 1e6:.1f} + chunk {one['chunk'] / 1e6:.1f} MB)"
    )


def _memory_panel(title: str, x: str, xs: tuple[int, ...], found: list[Any]) -> Panel:
    lines = {
        "peak above the idle process": [one["peak"] / 1e6 for one in found],
        "state and one chunk": [(one["states"] + one["chunk"]) / 1e6 for one in found],
    }
    return Panel(title, x, "MB", xs, lines)
