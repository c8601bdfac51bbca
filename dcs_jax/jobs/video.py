"""One video of a batch: a first look, then all its targets in one pass over its frames."""

import heapq
import threading
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray

from dcs_jax.checks import check_box
from dcs_jax.config import Config
from dcs_jax.io.frames import FrameSource, open_source
from dcs_jax.jobs.manifest import Target, Video
from dcs_jax.jobs.shared import SharedFrames
from dcs_jax.jobs.targets import Chunk, track_targets


class Look(NamedTuple):
    """What is known of a video before anything is tracked.

    shape: (H, W, 3) of its frames.
    video: with the targets that can be tracked. reasons: by id, why the others cannot.
    work: frames to track, summed over the targets; one for each target in a video that does not
        announce its length.
    """

    shape: tuple[int, int, int]
    video: Video
    reasons: dict[str, str]
    work: int


class Found(NamedTuple):
    """Where one target was in its n frames.

    boxes: [n, 4] float32, x, y, w, h in pixels. confidence: [n] float32 in [0, 1].
    """

    boxes: NDArray[np.float32]
    confidence: NDArray[np.float32]


def look_at(video: Video) -> Look:
    """Open a video, and check the range and box of every target against it.

    Raises ValueError where not one of them can be tracked, with the reason for the first.
    """
    opened: dict[tuple[int, int | None], FrameSource | ValueError] = {}
    good: list[Target] = []
    reasons: dict[str, str] = {}
    shape, work = (0, 0, 3), 0
    for target in video.targets:
        span = target.start, target.end
        if span not in opened:
            opened[span] = _open(video.source, *span)
        try:
            frames = opened[span]
            if isinstance(frames, ValueError):
                raise frames
            check_box(target.box, frames.shape)
        except ValueError as error:
            reasons[target.id] = str(error)
            continue
        good.append(target)
        shape, work = frames.shape, work + (frames.length or 1)
    if not good:
        raise ValueError(reasons[video.targets[0].id])
    return Look(shape, Video(video.source, tuple(good)), reasons, work)


def _open(source: str, start: int, end: int | None) -> FrameSource | ValueError:
    try:
        return open_source(source, start, end)
    except ValueError as error:
        return error


def track_video(
    video: Video, advance: Callable[[int], None], *, config: Config, seed: int
) -> list[Found]:
    """Track all targets of a video, which is decoded once: what was found, in their order.

    Targets of the same range are tracked together. Memory holds a few chunks of frames, and 20
    bytes of results for each frame of each target.

    advance: is told the number of frames tracked, summed over the targets, after each chunk.

    Raises:
        BrokenSource: the video breaks off before all targets are at their ends.
        ValueError: it cannot be opened, or a box or range does not fit it.
    """
    ends = [target.end for target in video.targets]
    end = None if None in ends else max(end for end in ends if end is not None)
    source = open_source(video.source, min(target.start for target in video.targets), end)
    frames = SharedFrames(source)
    groups: dict[Any, _Group] = {}
    for place, target in enumerate(video.targets):
        check_box(target.box, source.shape)
        resolved = config.resolve(target.box)
        # Not by the settings themselves, whose numbers may be arrays: only shapes can differ.
        kind = target.start, target.end, jax.tree.structure(resolved)
        groups.setdefault(kind, _Group(target, resolved, [], [])).add(place, target)
    found: list[list[Chunk]] = [[] for _ in video.targets]
    chunks = [group.track(frames, source.shape, seed) for group in groups.values()]
    # The group that is furthest behind goes on, so that few frames are kept for it.
    turns = [(group.first.start, n) for n, group in enumerate(groups.values())]
    heapq.heapify(turns)
    members = [group.places for group in groups.values()]
    while turns:
        at, n = heapq.heappop(turns)
        chunk = next(chunks[n], None)
        if chunk is None:
            continue
        for place, boxes, confidence in zip(members[n], *chunk, strict=True):
            found[place].append(Chunk(boxes, confidence))
        advance(chunk.confidence.size)
        heapq.heappush(turns, (at + chunk.confidence.shape[1], n))
    return [
        Found(
            np.concatenate([chunk.boxes for chunk in pieces]),
            np.concatenate([chunk.confidence for chunk in pieces]),
        )
        for pieces in found
    ]


class _Group(NamedTuple):
    """Targets of one range and one program: places in the video's targets, and their boxes."""

    first: Target
    config: Config
    places: list[int]
    boxes: list[tuple[float, ...]]

    def add(self, place: int, target: Target) -> None:
        self.places.append(place)
        self.boxes.append(target.box)

    def track(
        self, frames: SharedFrames, shape: tuple[int, int, int], seed: int
    ) -> Iterator[Chunk]:
        """The chunks of the group; its reader is made now, and read as they are taken."""
        reader = frames.reader(self.first.start, self.first.end)
        boxes = np.asarray(self.boxes, np.float32)
        _compile_once(shape, boxes, self.config)
        return track_targets(reader, boxes, [jax.random.key(seed)] * len(boxes), self.config)


_compiled: set[Any] = set()
_compiling = threading.Lock()


def _compile_once(shape: tuple[int, int, int], boxes: NDArray[np.float32], config: Config) -> None:
    """Compile the programs for frames of this shape, unless it has been done.

    Threads that start on like videos would otherwise all compile the same programs at once.
    """
    kind = shape, jax.tree.structure(config)
    with _compiling:
        if kind not in _compiled:
            blank = np.zeros((2, *shape), np.uint8)
            for _ in track_targets(blank, boxes[:1], [jax.random.key(0)], config):
                pass
            _compiled.add(kind)
