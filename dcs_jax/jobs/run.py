"""A whole batch: what is finished is skipped, the rest looked at, sorted, tracked and written."""

import functools
import itertools
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, Literal, NamedTuple

from dcs_jax.checks import check_choice, check_count
from dcs_jax.config import Config
from dcs_jax.jobs.cluster import RayEngine
from dcs_jax.jobs.engines import Advance, Engine, Outcome
from dcs_jax.jobs.local import LocalEngine
from dcs_jax.jobs.manifest import Target, Video, group_by_video, read_manifest
from dcs_jax.jobs.results import Results
from dcs_jax.jobs.video import Look, look_at, track_video

EngineName = Literal["local", "ray"]
ENGINES: dict[str, Callable[[int | None], Engine]] = {"local": LocalEngine, "ray": RayEngine}
RETRIES = 2
LOOKS_A_BATCH = 64  # opening a video takes some milliseconds
BATCHES_A_WORKER = 4


class Batch(NamedTuple):
    """What a batch did.

    out: the folder of the results (see `dcs_jax.jobs.results`).
    finished: of every finished target, in the order of the manifest, the file with its boxes,
        relative to `out`. failed: of every other that was tried, the reason.
    videos, reused: the number of videos, and of those that were finished before.
    retried: how many times a video was tried again.
    interrupted: whether it ended by Ctrl-C before all was done.
    """

    out: Path
    finished: dict[str, str]
    failed: dict[str, str]
    videos: int
    reused: int
    retried: int
    interrupted: bool


class BatchWatch:
    """Is told how a batch goes on; this one does nothing with it."""

    def planned(self, work: int, reused: int, stale: int, videos: int) -> None:
        """Before the first video is tracked.

        work: frames to track, summed over the targets. reused, stale, videos: the number of videos
        that were finished before, of those that are made anew, and of all.
        """

    def advance(self, work: int) -> None:
        """After each chunk of frames; a negative number where a video has to be tried again."""


def run_batch(
    manifest: str | Path | Iterable[Target],
    out: str | Path,
    *,
    config: Config = Config(),
    seed: int = 0,
    engine: EngineName = "local",
    workers: int | None = None,
    retries: int = RETRIES,
    watch: BatchWatch | None = None,
) -> Batch:
    """Track every target of a manifest and write its boxes; a video that is finished is skipped.

    The boxes are those of `dcs-jax track` with the same settings and seed. A video's targets are
    tracked while it is decoded once, and written together, or not at all. Where a video or a target
    cannot be tracked, the rest goes on.

    Args:
        manifest: a CSV (see `read_manifest`), or targets.
        out: folder of the results, made where it is missing. It is for one manifest, which may
            grow and change: a video of which a row, the settings or the file is another than
            before is tracked anew, and its new results take the place of the old ones.
        config: settings.
        seed: of the features, the same for all targets.
        engine: "local" for this machine, "ray" for a Ray cluster (see `RayEngine`).
        workers: videos (with Ray: tasks) at once, by default one a core.
        retries: how often a video that fails is tried again.
        watch: is told of the progress.

    Returns:
        What is finished and what has failed. Ctrl-C ends the run and is noted there, not raised.

    Raises:
        ValueError: the manifest is not as expected, two targets have one id, or Ray is missing.
        OSError: a result cannot be written.
    """
    check_choice("engine", engine, tuple(ENGINES))
    if workers is not None:
        check_count("workers", workers)
    targets = read_manifest(manifest) if isinstance(manifest, (str, Path)) else list(manifest)
    ids: set[str] = set()
    for target in targets:
        if target.id in ids:
            raise ValueError(f"the id {target.id!r} is there twice: every target needs its own")
        ids.add(target.id)
    work = _Work(targets, Results(out, config, seed), watch or BatchWatch())
    track = functools.partial(track_video, config=config, seed=seed)
    try:
        work.sort_out()
        if work.pending:
            with ENGINES[engine](workers) as entered:
                work.look(entered, retries)
                work.track(entered, retries, track)
        interrupted = False
    except KeyboardInterrupt:
        interrupted = True
    work.write_tables()
    return work.batch(interrupted)


class _Work:
    """What there is to do, and what has become of it."""

    def __init__(self, targets: list[Target], results: Results, watch: BatchWatch) -> None:
        self._targets, self._results, self._watch = targets, results, watch
        self._videos = group_by_video(targets)
        self.pending: list[Video] = []
        self._looks: list[Look] = []
        self._files: dict[str, str] = {}
        self._reasons: dict[str, str] = {}
        self._reused = self._retried = 0

    def sort_out(self) -> None:
        """Skip what is finished, and say so in the index before anything is replaced."""
        for video in self._videos:
            if self._results.has(video):
                self._reuse(video)
            else:
                self.pending.append(video)
        if not self.pending:
            self._watch.planned(0, self._reused, 0, len(self._videos))
        self.write_tables()

    def look(self, engine: Engine, retries: int) -> None:
        """Open every video that is not finished, and set aside what cannot be tracked."""
        size = min(LOOKS_A_BATCH, engine.batch_frames)
        batches = (self.pending[n : n + size] for n in range(0, len(self.pending), size))
        for outcome in self._outcomes(engine, _look, batches, retries):
            look = outcome.value
            self._reasons.update(look.reasons)
            if look.reasons and self._results.has(look.video):
                # An earlier run had to leave out the same targets.
                self._reuse(look.video)
            else:
                self._looks.append(look)

    def track(self, engine: Engine, retries: int, track: Callable[..., Any]) -> None:
        """Track what has been looked at, and write every video as it is done."""
        stale = sum(self._results.has_other(look.video) for look in self._looks)
        work = sum(look.work for look in self._looks)
        self._watch.planned(work, self._reused, stale, len(self._videos))
        # As large as pays, but where there is little work, every worker should have its share.
        size = min(engine.batch_frames, work // (BATCHES_A_WORKER * engine.workers))
        batches = _batches(self._looks, size)
        for outcome in self._outcomes(engine, track, batches, retries, self._watch.advance):
            self._results.write(outcome.video, outcome.value)
            self._finish(outcome.video)

    def write_tables(self) -> None:
        """Write the index, and the list of what has failed."""
        known = self._targets
        self._results.write_index((t, self._files[t.id]) for t in known if t.id in self._files)
        self._results.write_failed((t, self._reasons[t.id]) for t in known if t.id in self._reasons)

    def batch(self, interrupted: bool) -> Batch:
        """What was done, in the order of the manifest."""
        finished, failed = (
            {target.id: of[target.id] for target in self._targets if target.id in of}
            for of in (self._files, self._reasons)
        )
        videos, out = len(self._videos), self._results.folder
        return Batch(out, finished, failed, videos, self._reused, self._retried, interrupted)

    def _reuse(self, video: Video) -> None:
        self._reused += 1
        self._finish(video)

    def _finish(self, video: Video) -> None:
        name = self._results.file_of(video)
        self._files.update((target.id, name) for target in video.targets)

    def _outcomes(
        self,
        engine: Engine,
        work: Callable[..., Any],
        batches: Iterable[list[Video]],
        retries: int,
        advance: Advance = lambda frames: None,
    ) -> Iterator[Outcome]:
        """The outcomes that have a value; the reasons of the others are kept."""

        def count(video: Video, reason: str) -> None:
            self._retried += 1

        # Closed, so that Ctrl-C stops the engine wherever it meets this process.
        run = engine.run(work, batches, retries=retries, advance=advance, retrying=count)
        with closing(run) as outcomes:
            for outcome in outcomes:
                if outcome.reason is None:
                    yield outcome
                else:
                    reasons = {target.id: outcome.reason for target in outcome.video.targets}
                    self._reasons.update(reasons)


def _look(video: Video, advance: Advance) -> Look:
    return look_at(video)


def _batches(looks: list[Look], frames: int) -> Iterator[list[Video]]:
    """Batches of videos of like frames, each of this many frames to track if there are as many.

    Videos of one shape follow each other, so that a worker rarely meets another one, and the
    longest come first, so that none is left to one worker at the end.
    """
    for _, alike in itertools.groupby(
        sorted(looks, key=lambda look: (look.shape, -look.work)), key=lambda look: look.shape
    ):
        batch: list[Video] = []
        work = 0
        for look in alike:
            batch.append(look.video)
            work += look.work
            if work >= frames:
                yield batch
                batch, work = [], 0
        if batch:
            yield batch
