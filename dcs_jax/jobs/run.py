"""A whole batch: skips what is finished, then checks, sorts, tracks and writes the rest."""

import functools
import itertools
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, Literal, NamedTuple

from dcs_jax import formats
from dcs_jax.checks import check_choice, check_count
from dcs_jax.config import Config
from dcs_jax.jobs.engines import Engine, LocalEngine, OnFrames, RayEngine, WorkResult
from dcs_jax.jobs.manifest import Target, Video, group_by_video, read_manifest
from dcs_jax.jobs.results import TABLE, BatchFolder, FormatName
from dcs_jax.jobs.video import CheckedVideo, check_video, track_video

EngineName = Literal["local", "ray"]
ENGINES: dict[str, Callable[[int | None], Engine]] = {"local": LocalEngine, "ray": RayEngine}
RETRIES = 2
CHECKS_PER_BATCH = 64  # opening a video takes some milliseconds
BATCHES_PER_WORKER = 4


class Batch(NamedTuple):
    """What a batch did.

    out: folder of the results (see `dcs_jax.jobs.results`).
    finished: by id, in the order of the manifest, the file with the target's boxes, relative to
        `out`.
    failed: by id, in the same order, why a target that was tried has no boxes.
    videos: number of videos.
    reused: number of videos that were finished before.
    retried: number of times that a video was tried again.
    interrupted: whether Ctrl-C ended it before all was done.
    """

    out: Path
    finished: dict[str, str]
    failed: dict[str, str]
    videos: int
    reused: int
    retried: int
    interrupted: bool


class BatchWatch:
    """Receives the progress of a batch; this one ignores it."""

    def planned(self, work: int, reused: int, stale: int, videos: int) -> None:
        """Called before the first video is tracked.

        work: number of frames to track, summed over the targets.
        reused: number of videos that were finished before.
        stale: number of videos whose earlier results are replaced.
        videos: number of all videos.
        """

    def advance(self, work: int) -> None:
        """Called after each chunk of frames.

        work: number of frames tracked; negative where a video has to be tried again.
        """


def run_batch(
    manifest: str | Path | Iterable[Target],
    out: str | Path,
    *,
    config: Config = Config(),
    seed: int = 0,
    engine: EngineName = "local",
    workers: int | None = None,
    retries: int = RETRIES,
    format: FormatName = TABLE,
    watch: BatchWatch | None = None,
) -> Batch:
    """Track every target of a manifest and write its boxes; a video that is finished is skipped.

    The boxes are those of `dcs-jax track` with the same settings and seed. A video is decoded once
    for all its targets, and their boxes are written together or not at all. A video or a target
    that cannot be tracked does not stop the others.

    Args:
        manifest: a CSV (see `read_manifest`), or targets.
        out: folder of the results, made if it is missing. It belongs to one manifest, which may
            grow and change: where a row of a video, the settings or the file has changed, the video
            is tracked again, and its new results replace the old ones.
        config: settings.
        seed: seed of the features, the same for all targets.
        engine: "local" for this machine, "ray" for a Ray cluster (see `RayEngine`).
        workers: number of videos (with Ray: tasks) at once, by default one per core.
        retries: number of times that a video that fails is tried again.
        format: of the files of boxes (see `dcs_jax.formats`).
        watch: receives the progress.

    Returns:
        What is finished and what has failed. Ctrl-C ends the run and is reported there, not raised.

    Raises:
        ValueError: the manifest is not as expected, two targets have one id, Ray is missing, or
            another run is writing to the folder.
        OSError: a result cannot be written.
    """
    check_choice("engine", engine, tuple(ENGINES))
    check_choice("format", format, formats.NAMES)
    if workers is not None:
        check_count("workers", workers)
    targets = read_manifest(manifest) if isinstance(manifest, (str, Path)) else list(manifest)
    ids: set[str] = set()
    for target in targets:
        if target.id in ids:
            raise ValueError(f"the id {target.id!r} is there twice: every target needs its own")
        ids.add(target.id)
    folder = BatchFolder(out, config, seed, format)
    run = _BatchRun(targets, folder, watch or BatchWatch())
    track = functools.partial(track_video, config=config, seed=seed)
    with folder.locked():
        try:
            run.skip_finished()
            if run.pending:
                with ENGINES[engine](workers) as entered:
                    run.check(entered, retries)
                    run.track(entered, retries, track)
            interrupted = False
        except KeyboardInterrupt:
            interrupted = True
        run.write_tables()
    return run.batch(interrupted)


class _BatchRun:
    """What is left to do, and what has become of the rest."""

    def __init__(self, targets: list[Target], folder: BatchFolder, watch: BatchWatch) -> None:
        self._targets, self._folder, self._watch = targets, folder, watch
        self._videos = group_by_video(targets)
        self.pending: list[Video] = []
        self._checked: list[CheckedVideo] = []
        self._files: dict[str, str] = {}
        self._reasons: dict[str, str] = {}
        self._reused = self._retried = 0

    def skip_finished(self) -> None:
        """Skip the finished videos, and list them in the index before anything is replaced."""
        for video in self._videos:
            if self._folder.has(video):
                self._reuse(video)
            else:
                self.pending.append(video)
        if not self.pending:
            self._watch.planned(0, self._reused, 0, len(self._videos))
        self.write_tables()

    def check(self, engine: Engine, retries: int) -> None:
        """Open every video that is not finished, and set aside what cannot be tracked."""
        size = min(CHECKS_PER_BATCH, engine.batch_frames)
        batches = (self.pending[n : n + size] for n in range(0, len(self.pending), size))
        for result in self._results(engine, _check, batches, retries):
            checked = result.value
            self._reasons.update(checked.reasons)
            if checked.reasons and self._folder.has(checked.video):
                # An earlier run had to leave out the same targets.
                self._reuse(checked.video)
            else:
                self._checked.append(checked)

    def track(self, engine: Engine, retries: int, track: Callable[..., Any]) -> None:
        """Track the checked videos, and write every video as it is done."""
        stale = sum(self._folder.has_other(checked.video) for checked in self._checked)
        work = sum(checked.work for checked in self._checked)
        self._watch.planned(work, self._reused, stale, len(self._videos))
        # As large as pays, but if there is little work, every worker should have its share.
        size = min(engine.batch_frames, work // (BATCHES_PER_WORKER * engine.workers))
        batches = _batches(self._checked, size)
        shapes = {checked.video: checked.shape for checked in self._checked}
        for result in self._results(engine, track, batches, retries, self._watch.advance):
            rows, columns, _ = shapes[result.video]
            self._folder.write(result.video, result.value, (columns, rows))
            self._finish(result.video)
            name = self._folder.file_of(result.video)
            self._folder.add_to_index(result.video.targets, name)

    def write_tables(self) -> None:
        """Write the index, and the list of what has failed."""
        known = self._targets
        self._folder.write_index((t, self._files[t.id]) for t in known if t.id in self._files)
        self._folder.write_failed((t, self._reasons[t.id]) for t in known if t.id in self._reasons)

    def batch(self, interrupted: bool) -> Batch:
        """What was done, in the order of the manifest."""
        finished, failed = (
            {target.id: of[target.id] for target in self._targets if target.id in of}
            for of in (self._files, self._reasons)
        )
        videos, out = len(self._videos), self._folder.path
        return Batch(out, finished, failed, videos, self._reused, self._retried, interrupted)

    def _reuse(self, video: Video) -> None:
        self._reused += 1
        self._finish(video)

    def _finish(self, video: Video) -> None:
        name = self._folder.file_of(video)
        self._files.update((target.id, name) for target in video.targets)

    def _results(
        self,
        engine: Engine,
        work: Callable[..., Any],
        batches: Iterable[list[Video]],
        retries: int,
        on_frames: OnFrames = lambda frames: None,
    ) -> Iterator[WorkResult]:
        """The results that have a value; the reasons of the others are kept."""

        def count(video: Video, reason: str) -> None:
            self._retried += 1

        # Closed, so that Ctrl-C stops the engine wherever it meets this process.
        run = engine.run(work, batches, retries=retries, on_frames=on_frames, on_retry=count)
        with closing(run) as results:
            for result in results:
                if result.reason is None:
                    yield result
                else:
                    reasons = {target.id: result.reason for target in result.video.targets}
                    self._reasons.update(reasons)


def _check(video: Video, on_frames: OnFrames) -> CheckedVideo:
    return check_video(video)


def _batches(videos: list[CheckedVideo], frames: int) -> Iterator[list[Video]]:
    """Batches of videos of one shape, each with this many frames to track if there are as many.

    Videos of one shape follow each other, so that a worker seldom compiles for a new one. The
    longest come first, so that no worker is left with a long one at the end.
    """
    for _, of_one_shape in itertools.groupby(
        sorted(videos, key=lambda checked: (checked.shape, -checked.work)),
        key=lambda checked: checked.shape,
    ):
        batch: list[Video] = []
        work = 0
        for checked in of_one_shape:
            batch.append(checked.video)
            work += checked.work
            if work >= frames:
                yield batch
                batch, work = [], 0
        if batch:
            yield batch
