"""An evaluation: every setting from every start on every sequence; stored runs are reused."""

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray

from dcs_jax.checks import check_box
from dcs_jax.config import Config
from dcs_jax.evaluation.baselines import run_baseline, select_baselines
from dcs_jax.evaluation.datasets import Entry, Sequence, find_sequences
from dcs_jax.evaluation.protocol import PROTOCOLS, Protocol, Start, starts
from dcs_jax.evaluation.provenance import baseline_version, code_version, digest, environment
from dcs_jax.evaluation.report.tables import write_summary
from dcs_jax.evaluation.results import Record, Results, Skipped, read_published
from dcs_jax.evaluation.runner import Runs, run_seeds
from dcs_jax.evaluation.settings import Setting, parse_setting
from dcs_jax.evaluation.summary import Summary, summarise

BASELINE_WORK = 20  # OpenCV's MIL takes about as long for a frame as dcs_jax for 20 track-frames
IN_MEMORY = 2**31  # bytes of frames; a longer sequence is decoded again for every run


class Evaluation(NamedTuple):
    """What an evaluation did.

    out: folder of the results.
    summary: numbers of all results in that folder.
    ran, reused: numbers of (sequence, setting, start) that were run, and that were run before.
    broken: what was skipped.
    interrupted: whether Ctrl-C ended it before all was done.
    """

    out: Path
    summary: Summary
    ran: int
    reused: int
    broken: list[Skipped]
    interrupted: bool


class Watch:
    """Receives the progress of an evaluation; this one ignores it."""

    def planned(self, work: int, reused: int, stale: int, runs: int) -> None:
        """Called before the first run.

        work: number of track-frames to run; a frame of a baseline counts as `BASELINE_WORK`.
        reused: number of runs that were finished before.
        stale: number of runs whose earlier results are replaced.
        runs: number of all runs.
        """

    def working(self, what: str) -> None:
        """Called before each run.

        what: its sequence and setting.
        """

    def advance(self, work: int) -> None:
        """Called after each chunk of frames.

        work: number of track-frames that were run.
        """

    def broken(self, broken: Skipped) -> None:
        """Called where a sequence or a run is skipped."""


def evaluate(
    root: str | Path,
    out: str | Path,
    *,
    sequences: Iterable[str] | None = None,
    settings: Iterable[str] | Mapping[str, Config] = ("default",),
    seeds: int = 30,
    baselines: Iterable[str] = (),
    protocol: Protocol = "ope",
    published: str | Path | None = None,
    watch: Watch | None = None,
) -> Evaluation:
    """Run settings of the tracker, and baselines, on labelled sequences; compute all numbers.

    Results are written as they finish. Earlier ones are reused where setting, code and data are
    the same, so that calling an interrupted evaluation again continues it.
    `dcs_jax.evaluation.report.write_report(done.summary, path)` makes a page of them.

    Args:
        root: folder of sequences in the layout of OTB, MIL, VOT or GOT-10k, or of videos with a
            CSV of boxes each; or a single sequence.
        out: folder of the results, made if needed. The summary is of all results in it.
        sequences: names of the sequences to run; all by default.
        settings: names such as "default", "paper", "authors" or "paper selector=error", or a
            mapping of names to configs.
        seeds: number S of seeds, 0 to S - 1, run in one batch. Baselines have none and run once.
        baselines: trackers of OpenCV: "opencv" for all that are installed, or names such as "MIL".
        protocol: "ope" one pass, "tre" 20 starts, "sre" 12 shifts and scales of the first box.
        published: folder of tables to compare with (see `results.read_published`).
        watch: receives the progress.

    Returns:
        The summary, how much was reused, and what was skipped, such as a sequence that cannot be
        read. Ctrl-C ends the evaluation and is noted there, not raised.

    Raises:
        ValueError: unknown sequence, setting, baseline or protocol, or fewer than one seed.
    """
    if seeds < 1:
        raise ValueError(f"seeds must be at least 1, but is {seeds}")
    if protocol not in PROTOCOLS:
        raise ValueError(f"protocol must be one of {', '.join(PROTOCOLS)}, but is {protocol!r}")
    trackers: list[_Seeded | _Baseline] = [_Seeded(setting, seeds) for setting in _named(settings)]
    trackers += map(_Baseline, select_baselines(baselines))
    if not trackers:
        raise ValueError("there is nothing to run: expected a setting or a baseline")
    entries = find_sequences(root, sequences)
    if not entries:
        raise ValueError("there is nothing to run: expected the name of a sequence")
    results = Results(out)
    if published is not None:
        results.write_published(read_published(published))
    run = _EvaluationRun(results, watch or Watch())
    try:
        run.plan(entries, trackers, protocol)
        run.finish()
        interrupted = False
    except KeyboardInterrupt:
        interrupted = True
    results.write_skipped(run.broken, [entry.name for entry in entries])
    summary = summarise([results])
    write_summary(summary, results.folder)
    return Evaluation(results.folder, summary, run.ran, run.reused, run.broken, interrupted)


class _EvaluationRun:
    """What is left to do, and what has become of the rest."""

    def __init__(self, results: Results, watch: Watch) -> None:
        self._results, self._watch = results, watch
        self._planned: list[tuple[Sequence, str, list[_Job]]] = []
        self.ran = self.reused = 0
        self.broken: list[Skipped] = []

    def plan(
        self,
        entries: Iterable[Entry],
        trackers: Iterable["_Seeded | _Baseline"],
        protocol: Protocol,
    ) -> None:
        """Open the sequences and read what has been done before."""
        for entry in entries:
            try:
                sequence = entry.load()
                data = sequence.fingerprint()
            except (ValueError, OSError) as error:
                self._skip(entry.name, "", error)
                continue
            jobs = [
                _job(self._results, sequence, data, tracker, start)
                for tracker in trackers
                for start in starts(protocol, sequence.truth)
            ]
            self._planned.append((sequence, data, jobs))
        jobs = [job for _, _, of_sequence in self._planned for job in of_sequence]
        todo = [job for job in jobs if job.seeds]
        self.reused = len(jobs) - len(todo)
        work = sum(len(job.seeds) * job.length * job.tracker.work for job in todo)
        self._watch.planned(work, self.reused, sum(job.stale for job in todo), len(jobs))

    def finish(self) -> None:
        """Run what is left, sequence by sequence, and store each run as it is done."""
        for sequence, data, jobs in self._planned:
            todo = [job for job in jobs if job.seeds]
            kept = self._results.keeps_sequence(sequence.name, data)
            if kept and not todo:
                continue
            try:
                frames = _frames(sequence)
                if not kept:
                    self._results.keep_sequence(sequence, data, frames)
            except ValueError as error:
                self._skip(sequence.name, "", error)
                continue
            for job in todo:
                self._watch.working(f"{sequence.name} · {job.tracker.name}")
                try:
                    record = _run(job, frames, self._watch.advance)
                except ValueError as error:
                    self._skip(sequence.name, f"{job.tracker.name}, {job.start.name}", error)
                    continue
                self._results.write(record)
                self.ran += 1

    def _skip(self, sequence: str, run: str, error: Exception) -> None:
        self.broken.append(Skipped(sequence, run, " ".join(str(error).split())))
        self._watch.broken(self.broken[-1])


class _Seeded:
    """A setting of dcs_jax, run with every seed."""

    work = 1  # of a track-frame
    version = staticmethod(code_version)

    def __init__(self, setting: Setting, seeds: int) -> None:
        self.name = setting.name
        self._setting = setting
        self.seeds = range(seeds)

    def config(self, sequence: str) -> dict[str, Any]:
        fields = dataclasses.asdict(self._setting.config(sequence))
        return jax.tree.map(lambda v: v.tolist() if isinstance(v, jax.Array) else v, fields)

    def run(self, job: "_Job", frames: Iterable[Any], on_frames: Callable[[int], None]) -> Runs:
        config = self._setting.config(job.sequence.name)
        return run_seeds(frames, job.start.box, job.seeds, config, on_frames)


class _Baseline:
    """A tracker of OpenCV, run once."""

    work = BASELINE_WORK
    version = staticmethod(baseline_version)
    seeds = range(1)

    def __init__(self, tracker: str) -> None:
        self._tracker = tracker
        self.name = f"OpenCV {tracker}"

    def config(self, sequence: str) -> dict[str, Any]:
        return {"baseline": self._tracker}

    def run(self, job: "_Job", frames: Iterable[Any], on_frames: Callable[[int], None]) -> Runs:
        return run_baseline(self._tracker, frames, job.start.box, on_frames)


class _Job(NamedTuple):
    """One (sequence, setting, start).

    done: its earlier results, if they have the same key.
    stale: whether there are earlier results of another key.
    seeds: seeds that are left to run.
    """

    sequence: Sequence
    tracker: _Seeded | _Baseline
    start: Start
    key: str
    about: dict[str, Any]
    done: Record | None
    stale: bool
    seeds: list[int]

    @property
    def length(self) -> int:
        """Frames to track."""
        return len(self.sequence.truth) - self.start.frame


def _job(
    results: Results, sequence: Sequence, data: str, tracker: _Seeded | _Baseline, start: Start
) -> _Job:
    about = {
        "config": tracker.config(sequence.name),
        "code": tracker.version(),
        "data": data,
    }
    key = digest([about, start.frame, start.box.tolist()])
    found = results.find(sequence.name, tracker.name, start.name)
    done = found if found is not None and found.key == key else None
    have = set() if done is None else set(done.seeds.tolist())
    seeds = [seed for seed in tracker.seeds if seed not in have]
    stale = found is not None and done is None
    return _Job(sequence, tracker, start, key, about, done, stale, seeds)


def _run(job: _Job, frames: Iterable[Any], on_frames: Callable[[int], None]) -> Record:
    """Run the seeds that are left of a job, and append them to those that are done."""
    check_box(job.start.box, job.sequence.frames.shape)
    rest = (frame for t, frame in enumerate(frames) if t >= job.start.frame)
    work = job.tracker.work
    runs = job.tracker.run(job, rest, lambda tracked: on_frames(tracked * work))
    boxes, confidence, seconds = runs
    seeds = np.array(job.seeds, np.int64)
    if job.done is not None:
        seeds = np.concatenate([job.done.seeds, seeds])
        boxes = np.concatenate([job.done.boxes, boxes])
        confidence = np.concatenate([job.done.confidence, confidence])
        seconds += job.done.seconds
    return Record(
        job.sequence.name,
        job.tracker.name,
        job.start.name,
        job.start.frame,
        seeds,
        boxes,
        confidence,
        seconds,
        job.key,
        job.about | {"environment": environment()},
    )


def _frames(sequence: Sequence) -> Iterable[NDArray[np.uint8]]:
    """The frames, in memory unless they are too many."""
    source = sequence.frames
    if int(np.prod(source.shape)) * len(sequence.truth) > IN_MEMORY:
        return source
    frames = list(source)
    if len(frames) != len(sequence.truth):
        raise ValueError(
            f"{source.path} has {len(frames)} frames, but announced {len(sequence.truth)}"
        )
    return frames


def _named(settings: Iterable[str] | Mapping[str, Config]) -> list[Setting]:
    if isinstance(settings, Mapping):
        return [Setting(name, _constant(config)) for name, config in settings.items()]
    return [parse_setting(text) for text in settings]


def _constant(config: Config) -> Callable[[str], Config]:
    """The config of a setting that does not depend on the sequence."""
    return lambda sequence: config
