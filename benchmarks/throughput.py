"""Cases of `benchmarks.run`: frames per second beside the trackers of OpenCV, and many seeds."""

import functools
import statistics
import time
from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np

import dcs_jax
from benchmarks.compare import around
from benchmarks.material import PRESETS, Material, Panel, Row
from benchmarks.timing import clocked, ratios, spread, take_turns
from dcs_jax.evaluation.datasets import find_sequences
from dcs_jax.evaluation.runner import run_seeds
from dcs_jax.evaluation.settings import parse_setting

TARGETS, SEEDS = 32, 30


def single(material: Material) -> Iterator[Row | Panel]:
    """One target, both presets, beside every tracker of OpenCV there is: updates alone for those.

    dcs_jax with the start of the track; the frames are in memory.
    """
    frames, box = material.frames, material.box
    updates = min(len(frames) - 1, 30 if material.quick else 200)
    shown = jnp.asarray(frames)
    calls = {}
    for preset in PRESETS:
        config = parse_setting(preset).config(material.name)
        track = functools.partial(dcs_jax.track_sequence, shown, box, jax.random.key(0), config)
        calls[preset] = clocked(track)
    for tracker in material.opencv.trackers:
        calls[tracker] = material.opencv.clock(tracker, frames, [box], updates)
    seconds = take_turns(calls, material.rounds)
    a_frame = {
        name: [t / (len(frames) if name in PRESETS else updates) for t in times]
        for name, times in seconds.items()
    }
    size = f"{frames.shape[2]}x{frames.shape[1]}, box of {box[2]:g}x{box[3]:g}"
    asked = {"default": "40 times MIL, ahead of KCF and CSRT", "paper": "25 times MIL"}
    for preset in PRESETS:
        times = ", ".join(
            f"{spread(ratios(a_frame[tracker], a_frame[preset]))} times {tracker} "
            f"({1 / statistics.median(a_frame[tracker]):.0f} frames/s)"
            for tracker in material.opencv.trackers
        )
        rate = spread([1 / t for t in a_frame[preset]], 0)
        yield Row(
            f"{material.name}, {size}, one target, {preset}: {len(frames)} frames, "
            f"OpenCV {updates}",
            f"{rate} frames/s; {times}",
            asked[preset],
        )


def targets(material: Material) -> Iterator[Row | Panel]:
    """32 targets in one video, beside one target and a loop over as many of OpenCV's MIL."""
    chunks, updates = (1, 2) if material.quick else (4, 8)
    frames = material.frames[: 1 + 32 * chunks]
    boxes = around(material.box, TARGETS)
    shown = jnp.asarray(frames)
    one = functools.partial(dcs_jax.track_sequence, shown, material.box, jax.random.key(0))
    many = functools.partial(dcs_jax.track_batch, shown, boxes, jax.random.key(0))
    calls = {
        "one": clocked(one),
        "many": clocked(many),
        "MIL": material.opencv.clock("MIL", frames, boxes, updates),
    }
    seconds = take_turns(calls, material.rounds)
    one_frame = [t / len(frames) for t in seconds["one"]]
    many_frame = [t / len(frames) / TARGETS for t in seconds["many"]]
    peer_frame = [t / updates / TARGETS for t in seconds["MIL"]]
    yield Row(
        f"{TARGETS} targets in one video, default: {len(frames)} frames, MIL {updates}",
        f"{spread([1 / t for t in many_frame], 0)} track-frames/s; "
        f"{spread(ratios(one_frame, many_frame), 2)} times one target, "
        f"{spread(ratios(peer_frame, many_frame))} times {TARGETS} MIL in a loop",
        "2 times one target, 60 times MIL",
    )


def seeds(material: Material) -> Iterator[Row | Panel]:
    """30 seeds of every sequence below the root: real runs, one of each preset.

    In quick mode a few frames of one sequence are tracked, and the time of all is made of that.
    """
    if material.root is None:
        yield Row(f"{SEEDS} seeds of the sequences", "skipped: no ROOT was given")
        return
    limits = {"default": "under 3 minutes", "paper": "under 6 minutes"}
    entries = find_sequences(material.root)
    for preset in PRESETS:
        case = f"{SEEDS} seeds of {len(entries)} sequences, {preset}"
        setting = parse_setting(preset)
        begin = time.perf_counter()
        if material.quick:
            few = material.frames[:33]
            config = setting.config(material.name)
            runs = run_seeds(iter(few), material.box, range(SEEDS), config)
            total = sum(len(entry.load().truth) for entry in entries)
            minutes = runs.seconds / 60 * total / len(few)
            measured = (
                f"{minutes:.1f} minutes of tracking, made of {len(few)} frames of {material.name} "
                f"for {total}"
            )
        else:
            tracking, count = 0.0, 0
            for entry in entries:
                sequence = entry.load()
                config = setting.config(entry.name)
                runs = run_seeds(sequence.frames, sequence.truth[0], range(SEEDS), config)
                tracking += runs.seconds
                count += int(np.prod(runs.boxes.shape[:2]))
            whole = time.perf_counter() - begin
            measured = (
                f"{whole / 60:.1f} minutes with reading and what has to be compiled, "
                f"{tracking / 60:.1f} of tracking, one run ({count / tracking:.0f} track-frames/s)"
            )
        yield Row(case, measured, limits[preset])
