"""From boxes to numbers: one row for each run, means over seeds, tests.

A number of a setting over several sequences is the mean of the sequences' numbers, for each seed,
so that its deviation and interval are over seeds. Only sequences and starts that every setting has
count.
"""

import itertools
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dcs_jax.evaluation.metrics import Scores, failures, precision_curve, scores, success_curve
from dcs_jax.evaluation.paper import paper_name
from dcs_jax.evaluation.results import Labels, Published, Record, Results
from dcs_jax.evaluation.statistics import (
    FEWEST_SEEDS,
    Paired,
    Spread,
    WelchTest,
    paired,
    spread,
    welch_test,
)

# The published runs that a setting repeats.
REPEATS = {
    "paper": "dcs_with_l1",
    "authors": "dcs_with_l1",
    "paper selector=error": "dcs_without_l1",
    "authors selector=error": "dcs_without_l1",
}


class Row(NamedTuple):
    """One run.

    failures_at: frames of the failures, counted from the run's first frame.
    frames: number of frames T.
    frames_per_second: track-frames per second of the run's batch, all seeds together.
    """

    sequence: str
    setting: str
    start: str
    seed: int
    scores: Scores
    failures_at: list[int]
    frames: int
    frames_per_second: float


class Comparison(NamedTuple):
    """Two settings on the same seeds.

    sequence: its name; "" for the mean over all sequences.
    """

    sequence: str
    first: str
    second: str
    centre_error: Paired
    success_rate: Paired


class Agreement(NamedTuple):
    """A setting's centre error on a sequence, against published runs whose deviation is known.

    test: None for fewer than `FEWEST_SEEDS` seeds.
    """

    sequence: str
    setting: str
    ours: Spread
    published: Published
    test: WelchTest | None


class Summary(NamedTuple):
    """All numbers of one or more folders of results.

    records: what the numbers are computed from, by (sequence, setting, start).
    labels: what is kept of each sequence.
    rows: one for each run.
    sequences, settings: names, in the order of the report.
    common: (sequence, start) that every setting has; means over sequences are of these.
    overall: numbers by setting, then by metric, over the common ones.
    by_sequence: numbers by (sequence, setting), then by metric.
    curves: success [21] and precision [51] curve by setting, over the common ones.
    speed: track-frames per second by setting.
    paired, agreement: tests.
    published: other people's results of these sequences, under the sequences' names here.
    notes: what a reader has to know, such as results of different code in one table.
    """

    records: dict[tuple[str, str, str], Record]
    labels: dict[str, Labels]
    rows: list[Row]
    sequences: list[str]
    settings: list[str]
    common: list[tuple[str, str]]
    overall: dict[str, dict[str, Spread]]
    by_sequence: dict[tuple[str, str], dict[str, Spread]]
    curves: dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]
    speed: dict[str, float]
    paired: list[Comparison]
    agreement: list[Agreement]
    published: list[Published]
    notes: list[str]


def summarise(folders: Sequence[Results]) -> Summary:
    """Compute all numbers of the results of one or more folders, as if they were one.

    Where two folders have the same sequence, setting and start, the first one counts. Results on
    other labels or frames of a sequence than the first folder has are left out, with a note.
    """
    notes: list[str] = []
    labels: dict[str, Labels] = {}
    records: dict[tuple[str, str, str], Record] = {}
    for results in folders:
        notes += [f"skipped {skipped}" for skipped in results.skipped()]
        for sequence, kept in results.labels().items():
            labels.setdefault(sequence, kept)
        for record in results.records():
            name = (record.sequence, record.setting, record.start)
            known = labels.get(record.sequence)
            if known is None or record.about["data"] != known.data:
                notes.append(
                    f"{' / '.join(name)} of {results.folder} was run on other data and is left out"
                )
            elif name in records:
                notes.append(f"{' / '.join(name)} is in several folders: the first one counts")
            else:
                records[name] = record
    rows = [row for record in records.values() for row in _rows(record, labels[record.sequence])]
    table = _table(rows)
    settings = sorted(table, key=_setting_order)
    sequences = sorted({row.sequence for row in rows}, key=str.lower)
    runs = [set(table[setting]) for setting in settings]
    common = sorted(set.intersection(*runs)) if runs else []
    notes += _notes(records, common)
    by_sequence = {}
    for setting, sequence in itertools.product(settings, sequences):
        starts = [run for run in table[setting] if run[0] == sequence]
        if starts:
            by_sequence[sequence, setting] = _spreads(_per_seed(table[setting], starts))
    published = _published(folders, sequences)
    return Summary(
        records,
        labels,
        rows,
        sequences,
        settings,
        common,
        overall={s: _spreads(_per_seed(table[s], common)) for s in settings if common},
        by_sequence=by_sequence,
        curves={s: _curves(records, labels, s, common) for s in settings if common},
        speed={s: _speed([r for r in records.values() if r.setting == s]) for s in settings},
        paired=_comparisons(table, settings, sequences, common),
        agreement=_agreements(table, records, published),
        published=published,
        notes=list(dict.fromkeys(notes)),
    )


def per_seed(summary: Summary, setting: str) -> dict[int, Scores]:
    """A setting's mean scores over the common sequences, by seed."""
    return _per_seed(_table(summary.rows)[setting], summary.common)


# The scores by setting, by (sequence, start), by seed.
Run = tuple[str, str]
Table = dict[str, dict[Run, dict[int, Scores]]]


def _rows(record: Record, labels: Labels) -> list[Row]:
    truth = labels.truth[record.frame :]
    rate = record.boxes.shape[0] * len(truth) / record.seconds
    return [
        Row(
            record.sequence,
            record.setting,
            record.start,
            int(seed),
            scores(boxes, truth),
            failures(boxes, truth),
            len(truth),
            rate,
        )
        for seed, boxes in zip(record.seeds, record.boxes, strict=True)
    ]


def _table(rows: Iterable[Row]) -> Table:
    table: Table = {}
    for row in rows:
        runs = table.setdefault(row.setting, {})
        runs.setdefault((row.sequence, row.start), {})[row.seed] = row.scores
    return table


def _per_seed(runs: dict[Run, dict[int, Scores]], wanted: Iterable[Run]) -> dict[int, Scores]:
    """Mean scores over some runs, for every seed that all runs have.

    The starts of a sequence are averaged first, so that all sequences have the same weight.
    """
    by_sequence: dict[str, list[dict[int, Scores]]] = {}
    for run in wanted:
        by_sequence.setdefault(run[0], []).append(runs[run])
    seeds = set.intersection(*(set(cell) for cells in by_sequence.values() for cell in cells))
    return {
        seed: Scores(
            *np.mean(
                [np.mean([cell[seed] for cell in cells], axis=0) for cells in by_sequence.values()],
                axis=0,
            ).tolist()
        )
        for seed in sorted(seeds)
    }


def _spreads(by_seed: dict[int, Scores]) -> dict[str, Spread]:
    return {
        metric: spread([getattr(values, metric) for values in by_seed.values()])
        for metric in Scores._fields
    }


def _curves(
    records: dict[tuple[str, str, str], Record],
    labels: dict[str, Labels],
    setting: str,
    common: Iterable[Run],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Success [21] and precision [51] curve, each a mean over seeds, starts and sequences."""
    by_sequence: dict[str, list[tuple[NDArray[np.float64], NDArray[np.float64]]]] = {}
    for sequence, start in common:
        record = records[sequence, setting, start]
        truth = labels[sequence].truth[record.frame :]
        by_sequence.setdefault(sequence, []).extend(
            (success_curve(boxes, truth), precision_curve(boxes, truth)) for boxes in record.boxes
        )
    success, precision = (
        np.mean([np.mean([pair[n] for pair in pairs], axis=0) for pairs in by_sequence.values()], 0)
        for n in (0, 1)
    )
    return success, precision


def _speed(records: Sequence[Record]) -> float:
    """Track-frames per second, as one figure for all runs."""
    frames = sum(record.boxes.shape[0] * record.boxes.shape[1] for record in records)
    return frames / sum(record.seconds for record in records)


def _comparisons(
    table: Table, settings: Sequence[str], sequences: Sequence[str], common: Sequence[Run]
) -> list[Comparison]:
    """Every pair of settings that share two seeds or more, on each sequence and on their mean."""
    found = []
    for (first, second), sequence in itertools.product(
        itertools.combinations(settings, 2), ["", *sequences]
    ):
        wanted = [run for run in common if sequence in ("", run[0])]
        if not wanted:
            continue
        one, other = _per_seed(table[first], wanted), _per_seed(table[second], wanted)
        seeds = sorted(one.keys() & other.keys())
        if len(seeds) < 2:
            continue
        tests = (
            paired(
                [getattr(one[seed], metric) for seed in seeds],
                [getattr(other[seed], metric) for seed in seeds],
            )
            for metric in ("centre_error", "success_rate")
        )
        found.append(Comparison(sequence, first, second, *tests))
    return found


def _agreements(
    table: Table, records: dict[tuple[str, str, str], Record], published: Iterable[Published]
) -> list[Agreement]:
    """Every setting against the published runs that it repeats, where their deviation is known."""
    found = []
    for theirs in published:
        if not (theirs.runs > 1 and theirs.sd > 0):
            continue
        for (sequence, setting, start), record in records.items():
            if (sequence, start) != (theirs.sequence, "ope") or len(record.seeds) < 2:
                continue
            if REPEATS.get(setting) != theirs.tracker:
                continue
            errors = [values.centre_error for values in table[setting][sequence, start].values()]
            test = None
            if len(errors) >= FEWEST_SEEDS:
                test = welch_test(errors, theirs.centre_error, theirs.sd, theirs.runs)
            found.append(Agreement(sequence, setting, spread(errors), theirs, test))
    return sorted(found, key=lambda agreement: (agreement.setting, agreement.sequence))


def _published(folders: Iterable[Results], sequences: Iterable[str]) -> list[Published]:
    """Other people's results on these sequences, under the sequences' names here."""
    rows = dict.fromkeys(row for results in folders for row in results.published())
    return [
        row._replace(sequence=sequence)
        for sequence in sequences
        for row in rows
        if row.sequence in (sequence, paper_name(sequence))
    ]


def _notes(records: dict[tuple[str, str, str], Record], common: Sequence[Run]) -> list[str]:
    notes = []
    codes = {r.about["code"] for r in records.values() if "baseline" not in r.about["config"]}
    if len(codes) > 1:
        notes.append(f"results of {len(codes)} versions of the code are in one table")
    if len({start[:3] for _, start in common}) > 1:
        notes.append("results of several protocols are in one table: all starts count alike")
    every, shared = {sequence for sequence, _, _ in records}, {sequence for sequence, _ in common}
    if every and not shared:
        notes.append("no sequence has been run with every setting: there are no means over all")
    elif every != shared:
        notes.append(
            f"means are over {len(shared)} of {len(every)} sequences, those that were run with "
            f"every setting: {', '.join(sorted(shared, key=str.lower))}"
        )
    return notes


def _setting_order(name: str) -> tuple[int, str]:
    """Presets in their order, then changed presets, then other settings, OpenCV last."""
    presets = ["default", "paper", "authors"]
    preset = name.split()[0]
    if preset in presets:
        return presets.index(preset) + len(presets) * (name != preset), name
    return 100 if preset == "OpenCV" else 50, name


def published_columns(summary: Summary) -> dict[tuple[str, str], dict[str, Published]]:
    """Other people's results by (source, tracker), then by sequence."""
    columns: dict[tuple[str, str], dict[str, Published]] = {}
    for row in summary.published:
        columns.setdefault((row.source, row.tracker), {})[row.sequence] = row
    return columns


def mean_published(
    cells: dict[str, Published], sequences: Iterable[str]
) -> tuple[float, float] | None:
    """Mean centre error and success rate of a published column; None if it lacks a sequence."""
    found = [cells.get(sequence) for sequence in sequences]
    present = [(cell.centre_error, cell.success_rate) for cell in found if cell is not None]
    if len(present) < len(found):
        return None
    error, success = np.mean(present, axis=0).tolist()
    return error, success
