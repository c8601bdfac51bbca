"""The whole of an evaluation: sequences x settings x starts, with what is done already reused."""

import dataclasses
import functools
import itertools
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray

from dcs_jax.checks import check_box
from dcs_jax.config import Config
from dcs_jax.evaluation.datasets import Entry, Sequence, find_sequences
from dcs_jax.evaluation.peers import run_peer, select_peers
from dcs_jax.evaluation.protocol import PROTOCOLS, Protocol, Start, starts
from dcs_jax.evaluation.provenance import code_version, digest, environment, peer_version
from dcs_jax.evaluation.report.tables import write_summary
from dcs_jax.evaluation.results import Record, Results, Skipped, read_published
from dcs_jax.evaluation.runner import Runs, run_seeds
from dcs_jax.evaluation.settings import Setting, parse_setting
from dcs_jax.evaluation.summary import Summary, summarise

PEER_WORK = 20  # OpenCV's MIL takes about as long for a frame as dcs_jax for 20 track-frames
IN_MEMORY = 2**31  # bytes of frames; a longer sequence is decoded again for every setting


class Evaluation(NamedTuple):
    """What an evaluation did.

    out: the folder of the results. summary: the numbers, of all results in that folder.
    ran, reused: how many (sequence, setting, start) were run, and were there already.
    broken: what was skipped. interrupted: whether it ended by Ctrl-C before all was done.
    """

    out: Path
    summary: Summary
    ran: int
    reused: int
    broken: list[Skipped]
    interrupted: bool


class Watch:
    """Is told how an evaluation goes on; this one does nothing with it."""

    def planned(self, work: int, reused: int, stale: int, runs: int) -> None:
        """Before the first run: the work left, and how many runs are reused, stale and all.

        work: in track-frames of dcs_jax; one of a peer counts as `PEER_WORK` of them.
        """

    def working(self, what: str) -> None:
        """Before each run: its sequence and setting."""

    def advance(self, work: int) -> None:
        """After each chunk of frames: the work that was done."""

    def broken(self, broken: Skipped) -> None:
        """Where something could not be run."""


def evaluate(
    root: str | Path,
    out: str | Path,
    *,
    sequences: Iterable[str] | None = None,
    settings: Iterable[str] | Mapping[str, Config] = ("default",),
    seeds: int = 30,
    peers: Iterable[str] = (),
    protocol: Protocol = "ope",
    published: str | Path | None = None,
    watch: Watch | None = None,
) -> Evaluation:
    """Run settings of the tracker, and its peers, on labelled sequences; compute all numbers.

    Results are written as they finish, and those that are there already are reused where setting,
    code and data are the same; so an interrupted evaluation is continued by calling it again.
    `dcs_jax.evaluation.report.write_report(done.summary, path)` makes a page of them.

    Args:
        root: folder of sequences in the layout of OTB, MIL, VOT or GOT-10k, or of videos with a
            CSV of boxes each; or a single sequence.
        out: folder of the results, made where it is missing. The summary is of all results in it.
        sequences: names of those to run; all by default.
        settings: names such as "default", "paper", "authors" or "paper selector=error", or a
            mapping of names to configs.
        seeds: number S of seeds, 0 to S - 1, run in one batch. A peer has no seed and runs once.
        peers: trackers of OpenCV: "opencv" for all that are installed, or names such as "MIL".
        protocol: "ope" one pass, "tre" 20 starts, "sre" 12 shifts and scales of the first box.
        published: folder of tables to stand beside ours (see `results.read_published`).
        watch: is told of the progress.

    Returns:
        The summary, what was reused, and what was broken. Sequences that cannot be read are
        skipped and listed there. Ctrl-C ends the run and is noted there, not raised.

    Raises:
        ValueError: there is no such sequence, setting, peer or protocol, or fewer than one seed.
    """
    if seeds < 1:
        raise ValueError(f"seeds must be at least 1, but is {seeds}")
    if protocol not in PROTOCOLS:
        raise ValueError(f"protocol must be one of {', '.join(PROTOCOLS)}, but is {protocol!r}")
    trackers = [_Seeded(setting, seeds) for setting in _named(settings)]
    contestants: list[_Seeded | _Peer] = [*trackers, *map(_Peer, select_peers(peers))]
    if not contestants:
        raise ValueError("there is nothing to run: expected a setting or a peer")
    entries = find_sequences(root, sequences)
    if not entries:
        raise ValueError("there is nothing to run: expected the name of a sequence")
    results = Results(out)
    if published is not None:
        results.write_published(read_published(published))
    work = _Work(results, watch or Watch())
    try:
        work.plan(entries, contestants, protocol)
        work.do()
        interrupted = False
    except KeyboardInterrupt:
        interrupted = True
    results.write_skipped(work.broken, [entry.name for entry in entries])
    summary = summarise([results])
    write_summary(summary, results.folder)
    return Evaluation(results.folder, summary, work.ran, work.reused, work.broken, interrupted)


class _Work:
    """What there is to do, and what has become of it."""

    def __init__(self, results: Results, watch: Watch) -> None:
        self._results, self._watch = results, watch
        self._jobs: dict[str, list[_Job]] = {}
        self._sequences: dict[str, Sequence] = {}
        self._data: dict[str, str] = {}
        self.ran = self.reused = 0
        self.broken: list[Skipped] = []

    def plan(
        self,
        entries: Iterable[Entry],
        contestants: Iterable["_Seeded | _Peer"],
        protocol: Protocol,
    ) -> None:
        """Open the sequences and look up what has been done."""
        for entry in entries:
            try:
                sequence = entry.load()
                data = sequence.fingerprint()
            except (ValueError, OSError) as error:
                self._skip(entry.name, "", error)
                continue
            self._sequences[entry.name], self._data[entry.name] = sequence, data
            self._jobs[entry.name] = [
                _job(self._results, sequence, data, contestant, start)
                for contestant in contestants
                for start in starts(protocol, sequence.truth)
            ]
        jobs = list(itertools.chain.from_iterable(self._jobs.values()))
        todo = [job for job in jobs if job.missing]
        self.reused = len(jobs) - len(todo)
        work = sum(len(job.missing) * job.length * job.contestant.work for job in todo)
        self._watch.planned(work, self.reused, sum(job.stale for job in todo), len(jobs))

    def do(self) -> None:
        """Run what is missing, sequence by sequence, and store each run as it is done."""
        for name, sequence in self._sequences.items():
            todo = [job for job in self._jobs[name] if job.missing]
            data = self._data[name]
            kept = self._results.keeps_sequence(name, data)
            if kept and not todo:
                continue
            try:
                frames = _frames(sequence)
                if not kept:
                    self._results.keep_sequence(sequence, data, frames)
            except ValueError as error:
                self._skip(name, "", error)
                continue
            for job in todo:
                self._watch.working(f"{name} · {job.contestant.name}")
                try:
                    record = _run(job, frames, self._watch.advance)
                except ValueError as error:
                    self._skip(name, f"{job.contestant.name}, {job.start.name}", error)
                    continue
                self._results.write(record)
                self.ran += 1

    def _skip(self, sequence: str, run: str, error: Exception) -> None:
        self.broken.append(Skipped(sequence, run, " ".join(str(error).split())))
        self._watch.broken(self.broken[-1])


class _Seeded:
    """A setting of dcs_jax, run with every seed."""

    work = 1
    version = staticmethod(code_version)

    def __init__(self, setting: Setting, seeds: int) -> None:
        self.name = setting.name
        self._setting = setting
        self.seeds = range(seeds)

    def config(self, sequence: str) -> dict[str, Any]:
        fields = dataclasses.asdict(self._setting.config(sequence))
        return jax.tree.map(lambda v: v.tolist() if isinstance(v, jax.Array) else v, fields)

    def run(self, job: "_Job", frames: Iterable[Any], advance: Callable[[int], None]) -> Runs:
        config = self._setting.config(job.sequence.name)
        return run_seeds(frames, job.start.box, job.missing, config, advance)


class _Peer:
    """A tracker of OpenCV, run once."""

    work = PEER_WORK
    version = staticmethod(peer_version)
    seeds = range(1)

    def __init__(self, peer: str) -> None:
        self._peer = peer
        self.name = f"OpenCV {peer}"

    def config(self, sequence: str) -> dict[str, Any]:
        return {"peer": self._peer}

    def run(self, job: "_Job", frames: Iterable[Any], advance: Callable[[int], None]) -> Runs:
        return run_peer(self._peer, frames, job.start.box, advance)


class _Job(NamedTuple):
    """One (sequence, setting, start): what there is of it (if of the same key) and what is not."""

    sequence: Sequence
    contestant: _Seeded | _Peer
    start: Start
    key: str
    about: dict[str, Any]
    done: Record | None
    stale: bool
    missing: list[int]

    @property
    def length(self) -> int:
        """Frames to track."""
        return len(self.sequence.truth) - self.start.frame


def _job(
    results: Results, sequence: Sequence, data: str, contestant: _Seeded | _Peer, start: Start
) -> _Job:
    about = {
        "config": contestant.config(sequence.name),
        "code": contestant.version(),
        "data": data,
    }
    key = digest([about, start.frame, start.box.tolist()])
    found = results.find(sequence.name, contestant.name, start.name)
    done = found if found is not None and found.key == key else None
    have = set() if done is None else set(done.seeds.tolist())
    missing = [seed for seed in contestant.seeds if seed not in have]
    stale = found is not None and done is None
    return _Job(sequence, contestant, start, key, about, done, stale, missing)


def _run(job: _Job, frames: Iterable[Any], advance: Callable[[int], None]) -> Record:
    """Run the missing seeds of a job and put them together with those that are there."""
    check_box(job.start.box, job.sequence.frames.shape)
    rest = (frame for t, frame in enumerate(frames) if t >= job.start.frame)
    weight = job.contestant.work
    runs = job.contestant.run(job, rest, lambda tracked: advance(tracked * weight))
    seeds = np.array(job.missing, np.int64)
    boxes, confidence, seconds = runs
    if job.done is not None:
        seeds = np.concatenate([job.done.seeds, seeds])
        boxes = np.concatenate([job.done.boxes, boxes])
        confidence = np.concatenate([job.done.confidence, confidence])
        seconds += job.done.seconds
    return Record(
        job.sequence.name,
        job.contestant.name,
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
    """The frames, in memory where they are not too many."""
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
        return [
            Setting(name, functools.partial(_same, config)) for name, config in settings.items()
        ]
    return [parse_setting(text) for text in settings]


def _same(config: Config, sequence: str) -> Config:
    """The config of a setting that is the same for every sequence."""
    del sequence
    return config
