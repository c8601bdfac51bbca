"""One video of a batch: checked first, then all its targets tracked in one pass over its frames."""

import heapq
import threading
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray

from dcs_jax.checks import check_box
from dcs_jax.config import Config
from dcs_jax.io.frames import FrameSource, Image, open_source
from dcs_jax.jobs.manifest import Target, Video
from dcs_jax.jobs.shared import SharedFrames
from dcs_jax.runners.stream import Chunk, track_stream


class CheckedVideo(NamedTuple):
    """What is known of a video before anything is tracked.

    shape: (H, W, 3) of its frames.
    video: the video with the targets that can be tracked.
    reasons: by id, why the other targets cannot.
    work: number of frames to track, summed over the targets; a target in a video that does not
        announce its length counts as one frame.
    """

    shape: tuple[int, int, int]
    video: Video
    reasons: dict[str, str]
    work: int


class TargetTrack(NamedTuple):
    """The track of one target in n frames.

    boxes: [n, 4] float32, x, y, w, h in pixels.
    confidence: [n] float32 in [0, 1]; NaN without verification.
    lost: [n] bool, whether the object is lost.
    """

    boxes: NDArray[np.float32]
    confidence: NDArray[np.float32]
    lost: NDArray[np.bool_]


def check_video(video: Video) -> CheckedVideo:
    """Open a video, and check the range and box of every target against it.

    Raises ValueError if none of the targets can be tracked, with the reason for the first.
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
    return CheckedVideo(shape, Video(video.source, tuple(good)), reasons, work)


def _open(source: str, start: int, end: int | None) -> FrameSource | ValueError:
    try:
        return open_source(source, start, end)
    except ValueError as error:
        return error


def track_video(
    video: Video, on_frames: Callable[[int], None], *, config: Config, seed: int
) -> list[TargetTrack]:
    """Track all targets of a video, which is decoded once: their tracks, in the same order.

    Targets of one range are tracked together. Memory holds a few chunks of frames, and 21 bytes of
    results for each frame of each target.

    on_frames: called with the number of frames tracked, summed over the targets, after each chunk.

    Raises:
        BrokenSource: the video breaks off before all targets are at their ends.
        ValueError: it cannot be opened, or a box or range does not fit it.
    """
    ends = [target.end for target in video.targets]
    end = None if None in ends else max(end for end in ends if end is not None)
    source = open_source(video.source, min(target.start for target in video.targets), end)
    frames = SharedFrames(source)
    groups: dict[Any, list[int]] = {}  # indices of the targets that are tracked together
    for index, target in enumerate(video.targets):
        check_box(target.box, source.shape)
        # Not by the settings themselves, whose numbers may be arrays: only shapes can differ.
        kind = target.start, target.end, jax.tree.structure(config.resolve(target.box))
        groups.setdefault(kind, []).append(index)
    members = list(groups.values())
    streams = [
        _track_group(frames, source.shape, [video.targets[index] for index in group], config, seed)
        for group in members
    ]
    parts: list[list[TargetTrack]] = [[] for _ in video.targets]
    # The group that is furthest behind is tracked next, so that few frames are kept for it.
    turns = [(video.targets[group[0]].start, n) for n, group in enumerate(members)]
    heapq.heapify(turns)
    while turns:
        start, n = heapq.heappop(turns)
        chunk = next(streams[n], None)
        if chunk is None:
            continue
        rows = (chunk.track.boxes, chunk.track.confidence, chunk.track.lost)
        for slot, index in enumerate(members[n]):
            parts[index].append(TargetTrack(*(np.asarray(of_all)[slot] for of_all in rows)))
        on_frames(len(members[n]) * len(chunk.frames))
        heapq.heappush(turns, (start + len(chunk.frames), n))
    return [TargetTrack(*map(np.concatenate, zip(*track, strict=True))) for track in parts]


def _track_group(
    frames: SharedFrames,
    shape: tuple[int, int, int],
    targets: list[Target],
    config: Config,
    seed: int,
) -> Iterator[Chunk]:
    """Track targets of one range and one program; the track of target n is in slot n.

    Their reader is made now, and read as the chunks are taken.
    """
    reader = frames.reader(targets[0].start, targets[0].end)
    boxes = np.array([target.box for target in targets], np.float32)
    config = config.resolve(targets[0].box)
    _compile_once(shape, boxes, config)
    return _track(reader, boxes, jax.random.key(seed), config)


_compiled: set[Any] = set()
_compiling = threading.Lock()


def _compile_once(shape: tuple[int, int, int], boxes: NDArray[np.float32], config: Config) -> None:
    """Compile the programs for frames of this shape, unless it has been done.

    Threads that start on similar videos would otherwise compile the same programs at once.
    """
    kind = shape, jax.tree.structure(config), _num_slots(len(boxes))
    with _compiling:
        if kind not in _compiled:
            blank = np.zeros((2, *shape), np.uint8)
            for _ in _track(blank, boxes, jax.random.key(0), config):
                pass
            _compiled.add(kind)


def _track(
    frames: Iterable[Image], boxes: NDArray[np.float32], key: jax.Array, config: Config
) -> Iterator[Chunk]:
    """`track_stream`, but the first frame is read with the first chunk, not with the call."""
    yield from track_stream(frames, boxes, key, config, slots=_num_slots(len(boxes)))


def _num_slots(count: int) -> int:
    """A power of two for so many targets, so that few programs serve videos with any number.

    An empty slot takes no time.
    """
    return 1 << (count - 1).bit_length()
