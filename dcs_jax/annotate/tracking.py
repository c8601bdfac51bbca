"""The tracks of stretches: forward from the keyframe at the left, backward from that at the right.

Many stretches, of several objects, are tracked in one batch, each direction in one pass over the
frames. The only file of `annotate` that runs the tracker.
"""

import itertools
import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import jax
import numpy as np
from numpy.typing import NDArray

from dcs_jax.annotate.joining import join
from dcs_jax.annotate.project import Box, Keyframe
from dcs_jax.annotate.stretches import Stretch, StretchTrack, assemble, stretches_of, unknown
from dcs_jax.checks import check_box, check_count, check_frames, shown
from dcs_jax.config import Config
from dcs_jax.io.source import Image
from dcs_jax.runners.slots import CHUNK_BYTES
from dcs_jax.runners.stream import track_stream

# Tracks at a time, a few or many, so that all clips of one size have two programs; an empty slot
# takes no time. More stretches than slots take more passes over the frames. With many slots tracks
# share sums over whole frames: one object at 1920x1080 would be followed at 26 frames/s.
FEW_SLOTS, SLOTS = 4, 32
# Frames after which what was tracked is shown, and tracking can be stopped; fewer where they are
# large. Chunks of 32 are not measurably faster.
CHUNK = 8
# Bytes of frames kept from the way forward for the way back; what is before them is read again.
KEPT = 2**30

# The frames `start` (inclusive) to `end` (exclusive) of the clip, [H, W, 3] or [H, W] uint8.
OpenFrames = Callable[[int, int], Iterable[Image]]
# Takes the track of a stretch as far as it is made, and whether it is complete.
OnProgress = Callable[[Stretch, StretchTrack, bool], None]
_Key = tuple[int, Box, bool]


class Runs(dict[_Key, StretchTrack]):
    """What was tracked from each keyframe in each direction, kept from call to call.

    By frame, box and whether it is forward; the first row is the keyframe's. Where a keyframe is
    set in the middle of a stretch, the tracks from its ends are known, and only those from the new
    keyframe are made.
    """


@dataclass
class _Run:
    """A track from a keyframe in one direction, as far as it is made.

    track: [length]; done: how many of its rows are made.
    """

    key: _Key
    track: StretchTrack
    done: int = 0

    @property
    def sign(self) -> int:
        """1 forward, -1 backward."""
        return 1 if self.key[2] else -1

    @property
    def start(self) -> int:
        """Where it starts in the order in which the frames are read: frames, negative backward."""
        return self.sign * self.key[0]

    @property
    def length(self) -> int:
        return len(self.track.lost)


def track_stretches(
    open_frames: OpenFrames,
    stretches: Sequence[Stretch],
    config: Config = Config(),
    seed: int = 0,
    on_progress: OnProgress = lambda stretch, track, complete: None,
    stopped: Callable[[], bool] = lambda: False,
    runs: Runs | None = None,
) -> dict[Stretch, StretchTrack]:
    """Track stretches, all in one batch: those that are complete.

    open_frames: called with a start and an end, gives those frames. It is called once for the way
        forward and, where the clip is longer than what is kept in memory, for blocks on the way
        back.
    config, seed: as for `track_sequence`.
    on_progress: called after every chunk of frames with each stretch that has grown.
    stopped: asked after every chunk; where it is true, the rest is left.
    runs: what earlier calls of the same clip, config and seed have tracked, also those that were
        stopped, and this one adds to.

    Raises ValueError where a box is not one that can be tracked; what `open_frames` raises, after
    what came before has been tracked.
    """
    check_count("seed", seed, least=0)
    runs = Runs() if runs is None else runs
    lengths: dict[_Key, int] = {}
    for stretch in stretches:
        for key in _keys(stretch):
            if key not in runs or len(runs[key].lost) < stretch.length:
                lengths[key] = max(stretch.length, lengths.get(key, 0))
    growing = {key: _Run(key, unknown(length)) for key, length in lengths.items()}
    complete: dict[Stretch, StretchTrack] = {}

    def report(grown: set[_Key]) -> None:
        for stretch in stretches:
            keys = _keys(stretch)
            if stretch not in complete and not grown.isdisjoint(keys):
                track, whole = _track_of(stretch, keys, runs, growing)
                if whole:
                    complete[stretch] = track
                on_progress(stretch, track, whole)

    report({key for stretch in stretches for key in _keys(stretch)} - set(lengths))
    clip = _Clip(open_frames)
    for sign in (1, -1):
        left = [run for run in growing.values() if run.sign == sign]
        while left:
            begin = sign * min(run.start for run in left)
            end = sign * max(run.start + run.length - 1 for run in left)
            frames = clip.forward(begin, end) if sign > 0 else clip.backward(begin, end)
            for grown in _follow(frames, left, config, seed):
                for run in grown:
                    if run.key not in runs or run.done > len(runs[run.key].lost):
                        runs[run.key] = run.track.rows(slice(run.done))
                report({run.key for run in grown})
                if stopped():
                    return complete
            left = [run for run in left if not run.done]
    return complete


def prepare(shape: tuple[int, ...], config: Config = Config(), seed: int = 0) -> None:
    """Compile what `track_stretches` runs on frames of this shape, so that it starts at once.

    For a few stretches at a time: many have a program of their own.

    shape: (H, W, 3) or (H, W).
    """
    frames = [np.zeros(shape, np.uint8)] * 2
    height, width = shape[:2]
    run = _Run((0, (0.0, 0.0, float(width), float(height)), True), unknown(2))
    for _ in _follow(frames, [run], config, seed):
        pass


def track_between(
    frames: NDArray[np.uint8],
    keyframes: Mapping[int, Box | None],
    config: Config = Config(),
    seed: int = 0,
) -> StretchTrack:
    """One object through keyframes, both ways, joined.

        track_between(frames, {0: (99, 146, 48, 64), 180: (131, 120, 52, 68)}).boxes  # [T, 4]

    frames: [T, H, W] or [T, H, W, 3] uint8.
    keyframes: the box in some frames, x, y, w, h in pixels; None: not there, up to the next one.

    Before the first keyframe the object is followed backwards, and behind the last one forward.

    Raises ValueError, before any compilation, where an argument is not as stated.
    """
    check_frames(frames)
    said: dict[int, Keyframe] = {}
    for frame, box in keyframes.items():
        check_count("the frame of a keyframe", frame, least=0, most=len(frames) - 1)
        if box is not None:
            check_box(box, frames.shape[1:])
            x, y, w, h = np.asarray(box, np.float32).tolist()
            box = x, y, w, h
        said[int(frame)] = Keyframe(box)
    if all(keyframe.box is None for keyframe in said.values()):
        raise ValueError(f"keyframes must have a box in one frame or more, but is {shown(said)}")
    stretches = stretches_of(1, said, len(frames))
    tracks = track_stretches(lambda start, end: frames[start:end], stretches, config, seed)
    return assemble(said, tracks, 1, len(frames))


def _keys(stretch: Stretch) -> list[_Key]:
    """Of the runs that a stretch is made of."""
    keys = []
    if stretch.left is not None:
        keys.append((stretch.first, stretch.left, True))
    if stretch.right is not None:
        keys.append((stretch.last, stretch.right, False))
    return keys


def _track_of(
    stretch: Stretch,
    keys: Sequence[_Key],
    runs: Runs,
    growing: Mapping[_Key, _Run],
) -> tuple[StretchTrack, bool]:
    """The track of a stretch as far as its runs are made, and whether it is complete."""
    made = []
    whole = True
    for key in keys:
        run = runs.get(key)
        if run is None or len(run.lost) < stretch.length:
            run = growing[key].track
            whole &= growing[key].done >= stretch.length
        rows = run.rows(slice(stretch.length))
        made.append(rows if key[2] else rows.rows(slice(None, None, -1)))
    if len(made) == 2 and whole:
        return join(*made), True
    # On the way back, what comes from the left is shown until all is known.
    first = made[0].copy()
    for other in made[1:]:
        lacking = np.isnan(first.boxes[:, 0])
        for into, values in zip(first, other, strict=True):
            into[lacking] = values[lacking]
    return first, whole


def _follow(
    frames: Iterable[Image], runs: Sequence[_Run], config: Config, seed: int
) -> Iterator[list[_Run]]:
    """Follow runs through frames: after each chunk, those that have grown.

    frames: from the one on in which the first run starts. Runs for which no slot is free when they
    start are left out.
    """
    waiting = deque(sorted(runs, key=lambda run: run.start))
    begin = waiting[0].start
    most = min(FEW_SLOTS, SLOTS) if len(waiting) <= FEW_SLOTS else SLOTS
    first = [run for run in waiting if run.start == begin][:most]
    for _ in first:
        waiting.popleft()
    boxes = [run.key[1] for run in first]
    source = iter(frames)
    opening = list(itertools.islice(source, 1))
    length = max(1, min(CHUNK, CHUNK_BYTES // max(1, sum(frame.nbytes for frame in opening))))
    frames = itertools.chain(opening, source)
    stream = track_stream(frames, boxes, jax.random.key(seed), config, slots=most, chunk=length)
    slots = dict(enumerate(first))
    read = 0  # number of frames
    try:
        while slots:
            while waiting and (waiting[0].start - begin < read or len(slots) < most):
                run = waiting.popleft()
                if run.start - begin >= read:
                    slots[stream.add(run.key[1], frame=run.start - begin)] = run
            chunk = next(stream, None)
            if chunk is None:
                return
            grown = []
            for slot, run in list(slots.items()):
                start, end = run.start - begin - read, run.start - begin - read + run.length
                rows = slice(max(start, 0), max(end, 0))
                count = len(chunk.track.lost[slot, rows])
                if not count:
                    continue
                into = slice(run.done, run.done + count)
                run.track.boxes[into] = chunk.track.boxes[slot, rows]
                run.track.confidence[into] = chunk.track.confidence[slot, rows]
                run.track.lost[into] = chunk.track.lost[slot, rows]
                run.done += count
                grown.append(run)
                if run.done == run.length:
                    stream.drop(slot)
                    del slots[slot]
            read += len(chunk.frames)
            if grown:
                yield grown
    finally:
        stream.close()


class _Clip:
    """The frames of a clip, forward once, then backward, mostly from memory."""

    def __init__(self, open_frames: OpenFrames) -> None:
        self._open = open_frames
        self._kept: deque[Image] = deque()
        self._start = 0  # index of the first that is kept

    def forward(self, first: int, last: int) -> Iterator[Image]:
        """The frames from `first` to `last`, both included; the last of them are kept."""
        self._kept.clear()
        self._start = first
        for frame in self._open(first, last + 1):
            self._kept.append(frame)
            if len(self._kept) > _block(frame):
                self._kept.popleft()
                self._start += 1
            yield frame

    def backward(self, last: int, first: int) -> Iterator[Image]:
        """The frames from `last` back to `first`, both included."""
        end = last + 1
        block = 1
        while end > first:
            if self._start < end <= self._start + len(self._kept):
                start = max(first, self._start)
                frames = [self._kept[at - self._start] for at in range(start, end)]
            else:
                start = max(first, end - block)
                # What is kept is not read again.
                if start < self._start + len(self._kept) < end:
                    start = self._start + len(self._kept)
                frames = list(self._open(start, end))
            block = _block(frames[-1])
            while frames:
                yield frames.pop()
            end = start


def _block(frame: Image) -> int:
    """How many such frames are kept."""
    return max(1, KEPT // max(1, math.prod(frame.shape)))
