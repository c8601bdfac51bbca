"""A whole evaluation on small sequences: what is run, stored, reused, skipped and compared."""

import csv
import json
import shutil
from typing import Any

import jax
import numpy as np
import pytest
from data_sets import SMALL, write_otb, write_rows

import dcs_jax
from dcs_jax.evaluation import Watch, baselines, evaluate, experiment
from dcs_jax.evaluation.metrics import scores
from dcs_jax.evaluation.report.tables import as_dict, write_summary
from dcs_jax.evaluation.results import Results, read_published
from dcs_jax.evaluation.settings import parse_setting
from dcs_jax.evaluation.statistics import FEWEST_SEEDS
from dcs_jax.evaluation.summary import summarise
from dcs_jax.synthetic import render

LENGTH = 41
SEEDS = FEWEST_SEEDS  # so that there is a verdict on published runs


@pytest.fixture(scope="module")
def clips():
    return {"Deer": render(LENGTH, (120, 160), (36, 30)), "Toy": render(30, (120, 160), (30, 36))}


@pytest.fixture(scope="module")
def root(clips, tmp_path_factory):
    folder = tmp_path_factory.mktemp("root")
    for name, clip in clips.items():
        write_otb(folder, name, clip)
    return folder


@pytest.fixture(scope="module")
def published(tmp_path_factory):
    folder = tmp_path_factory.mktemp("published")
    (folder / "authors.csv").write_text(
        "sequence,tracker,centre_error_px_mean,centre_error_px_sd,success_rate,runs\n"
        "animal,dcs_with_l1,47.1,67.1,0.67,30\n"
        "toy,dcs_with_l1,5,1,1,30\n"
    )
    (folder / "other.csv").write_text(
        "sequence,tracker,centre_error_px,success_rate,runs\nanimal,frag,86.9,0.04,5\n"
    )
    (folder / "unrelated.csv").write_text("a,b\n1,2\n")
    return folder


class Counting(Watch):
    """Counts what is reported to it."""

    def __init__(self):
        self.total, self.done, self.what = None, 0, []

    def planned(self, work, reused, stale, runs):
        self.total, self.plan = work, (reused, stale, runs)

    def working(self, what):
        self.what.append(what)

    def advance(self, work):
        self.done += work


@pytest.fixture(scope="module")
def done(root, published, tmp_path_factory):
    """Two settings of some seeds and OpenCV's MIL, on both sequences."""
    watch = Counting()
    out = tmp_path_factory.mktemp("out") / "new"
    settings = {"paper": parse_setting(SMALL).config(""), "other": small(parts=1)}
    result = evaluate(
        root,
        out,
        settings=settings,
        seeds=SEEDS,
        baselines=["MIL"],
        published=published,
        watch=watch,
    )
    return result, watch


def small(**changes):
    return dcs_jax.Config(**{"canvas": 20, "parts": 5, "selectors": 6, "pool_size": 12, **changes})


def test_all_is_run_and_counted(done):
    result, watch = done
    assert (result.ran, result.reused, result.broken, result.interrupted) == (6, 0, [], False)
    assert watch.plan == (0, 0, 6)
    assert watch.total == watch.done == (2 * SEEDS + experiment.BASELINE_WORK) * (LENGTH + 30)
    assert watch.what[0] == "Deer · paper"


def test_the_rows_are_the_tracks_of_the_seeds(done, clips):
    result, _ = done
    with open(result.out / "results.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * (SEEDS + SEEDS + 1)
    (row,) = (
        row
        for row in rows
        if (row["sequence"], row["setting"], row["seed"]) == ("Deer", "paper", "2")
    )
    stored = np.loadtxt(result.out / "runs" / "Deer" / "paper" / "ope-seed02.txt", delimiter=",")
    expected = scores(stored, clips["Deer"].boxes)
    for name, value in expected._asdict().items():
        assert float(row[name]) == pytest.approx(value, rel=1e-3), name
    with np.load(result.out / "runs" / "Deer" / "paper" / "ope.npz") as file:
        np.testing.assert_allclose(file["boxes"][2], stored, atol=1e-3)
        assert file["boxes"].shape == (SEEDS, LENGTH, 4)
        assert file["confidence"].shape == (SEEDS, LENGTH)


def test_means_intervals_and_curves(done):
    result, _ = done
    summary = json.loads((result.out / "summary.json").read_text())
    assert set(summary["sequences"]) == {"Deer", "Toy"}
    setting = summary["settings"]["paper"]
    errors = {
        name: [
            row.scores.centre_error
            for row in result.summary.rows
            if (row.sequence, row.setting) == (name, "paper")
        ]
        for name in ("Deer", "Toy")
    }
    assert setting["sequences"]["Toy"]["centre_error"]["mean"] == pytest.approx(
        np.mean(errors["Toy"])
    )
    over_both = np.mean([errors["Deer"], errors["Toy"]], axis=0)
    overall = setting["overall"]["centre_error"]
    assert overall["mean"] == pytest.approx(over_both.mean())
    assert overall["sd"] == pytest.approx(over_both.std(ddof=1))
    assert overall["n"] == SEEDS
    assert overall["low"] < overall["mean"] < overall["high"]
    (success,) = setting["success_curve"]
    assert np.mean(success) == pytest.approx(setting["overall"]["auc"]["mean"])
    (precision,) = setting["precision_curve"]
    assert precision[20] == pytest.approx(setting["overall"]["precision"]["mean"])
    assert summary["settings"]["OpenCV MIL"]["overall"]["centre_error"]["sd"] is None


def test_settings_are_compared_on_the_same_seeds(done):
    result, _ = done
    pairs = {(c.first, c.second, c.sequence): c for c in result.summary.paired}
    found = pairs["paper", "other", "Toy"]
    errors = [
        [
            row.scores.centre_error
            for row in result.summary.rows
            if (row.sequence, row.setting) == ("Toy", setting)
        ]
        for setting in ("paper", "other")
    ]
    assert found.centre_error.n == SEEDS
    assert found.centre_error.difference == pytest.approx(np.mean(errors[0]) - np.mean(errors[1]))
    assert not any("OpenCV MIL" in key for key in pairs)  # it has one run


def test_published_results_go_by_the_papers_names(done):
    """Deer is the paper's animal; "toy" is not a name in the paper; other tables are ignored."""
    result, _ = done
    assert [(p.sequence, p.source, p.tracker) for p in result.summary.published] == [
        ("Deer", "authors", "dcs_with_l1"),
        ("Deer", "other", "frag"),
    ]
    (agreement,) = result.summary.agreement
    assert (agreement.sequence, agreement.setting) == ("Deer", "paper")
    ours = agreement.ours
    t = (ours.mean - 47.1) / (ours.sd**2 / SEEDS + 67.1**2 / 30) ** 0.5
    assert agreement.test.t == pytest.approx(t)
    (stored,) = json.loads((result.out / "summary.json").read_text())["agreement"]
    assert (stored["t"], stored["p"]) == agreement.test
    table = (result.out / "summary.md").read_text().splitlines()
    assert table[0] == (
        "| sequence | paper | other | OpenCV MIL | dcs_with_l1 (authors) | frag (other) |"
    )
    assert "47.1 / 0.67 | 86.9 / 0.04 |" in table[2]
    assert table[3].endswith("| - | - |")
    assert "**" in table[2]


def test_few_seeds_have_no_verdict_on_published_runs(done, tmp_path):
    result, _ = done
    record = Results(result.out).find("Deer", "paper", "ope")
    assert record is not None
    few = Results(tmp_path)
    few.write(record._replace(seeds=record.seeds[:-1], boxes=record.boxes[:-1]))
    few.write_published(result.summary.published)
    shutil.copytree(result.out / "sequences", tmp_path / "sequences")
    summary = summarise([few])
    (agreement,) = summary.agreement
    assert (agreement.ours.n, agreement.test) == (FEWEST_SEEDS - 1, None)
    (stored,) = as_dict(summary)["agreement"]
    assert (stored["t"], stored["p"]) == (None, None)


def test_the_summary_can_be_computed_from_the_folder(done, tmp_path):
    result, _ = done
    before = (result.out / "summary.json").read_text(), (result.out / "results.csv").read_text()
    write_summary(summarise([Results(result.out)]), tmp_path)
    assert (
        (tmp_path / "summary.json").read_text(),
        (tmp_path / "results.csv").read_text(),
    ) == before


def test_what_is_done_is_reused_and_seeds_are_added(root, tmp_path, monkeypatch):
    first = evaluate(root, tmp_path, sequences=["Toy"], settings=[SMALL], seeds=1)
    watch = Counting()
    more = evaluate(root, tmp_path, sequences=["Toy"], settings=[SMALL], seeds=3, watch=watch)
    assert (more.ran, more.reused) == (1, 0)
    assert watch.total == 2 * 30
    record = Results(tmp_path).find("Toy", SMALL, "ope")
    assert record is not None
    np.testing.assert_array_equal(record.seeds, [0, 1, 2])
    one = first.summary.rows[0].scores
    assert more.summary.rows[0].scores == one
    monkeypatch.setattr(experiment, "run_seeds", None)  # nothing is run
    same = evaluate(root, tmp_path, sequences=["Toy"], settings=[SMALL], seeds=2)
    assert (same.ran, same.reused) == (0, 1)
    assert same.summary.overall == more.summary.overall


def test_nothing_stale_is_reused(root, clips, tmp_path, monkeypatch):
    """A changed value under the same name, changed code and changed labels: each is run again."""
    write_otb(tmp_path / "root", "Toy", clips["Toy"])
    out = tmp_path / "out"

    def again(config):
        watch = Counting()
        result = evaluate(tmp_path / "root", out, settings={"mine": config}, seeds=1, watch=watch)
        return result.ran, watch.plan

    assert again(small()) == (1, (0, 0, 1))
    assert again(small()) == (0, (1, 0, 1))
    assert again(small(lam=0.5)) == (1, (0, 1, 1))
    monkeypatch.setattr(experiment._Seeded, "version", staticmethod(lambda: "newer"))
    assert again(small(lam=0.5)) == (1, (0, 1, 1))
    write_rows(tmp_path / "root" / "Toy" / "groundtruth_rect.txt", clips["Toy"].boxes + 1)
    assert again(small(lam=0.5)) == (1, (0, 1, 1))
    labels = Results(out).labels()["Toy"]
    np.testing.assert_allclose(labels.truth, clips["Toy"].boxes + 1, atol=1e-3)


def test_results_on_other_data_are_left_out_with_a_note(root, clips, tmp_path):
    write_otb(tmp_path / "root", "Toy", clips["Toy"])
    out = tmp_path / "out"
    evaluate(tmp_path / "root", out, settings={"old": small()}, seeds=1)
    write_rows(tmp_path / "root" / "Toy" / "groundtruth_rect.txt", clips["Toy"].boxes + 1)
    result = evaluate(tmp_path / "root", out, settings={"new": small()}, seeds=1)
    assert result.summary.settings == ["new"]
    (note,) = result.summary.notes
    assert "Toy / old / ope" in note
    assert "other data" in note


def test_a_broken_sequence_is_skipped_and_listed(root, clips, tmp_path):
    for name in ("Deer", "Toy", "Bad"):
        write_otb(tmp_path / "root", name, clips["Toy"])
    write_rows(tmp_path / "root" / "Bad" / "groundtruth_rect.txt", clips["Toy"].boxes[:-3])
    image = tmp_path / "root" / "Deer" / "img" / "0020.jpg"
    image.write_bytes(image.read_bytes()[:400])  # its size can still be read
    result = evaluate(tmp_path / "root", tmp_path / "out", settings=[SMALL], seeds=1)
    assert [broken.sequence for broken in result.broken] == ["Bad", "Deer"]
    assert "labels 27 frames" in result.broken[0].reason
    assert "0020.jpg" in result.broken[1].reason
    assert result.summary.sequences == ["Toy"]
    assert [note.split(": ")[0] for note in result.summary.notes] == ["skipped Bad", "skipped Deer"]


def test_what_was_skipped_is_noted_until_it_is_run_again(clips, tmp_path):
    options: dict[str, Any] = {"settings": [SMALL], "seeds": 1}
    for name in ("Bad", "Toy"):
        write_otb(tmp_path / "root", name, clips["Toy"])
    write_rows(tmp_path / "root" / "Bad" / "groundtruth_rect.txt", clips["Toy"].boxes[:-3])
    evaluate(tmp_path / "root", tmp_path / "out", **options)
    other = evaluate(tmp_path / "root", tmp_path / "out", sequences=["Toy"], **options)
    assert not other.broken
    (note,) = other.summary.notes
    assert note.startswith("skipped Bad: ")
    assert summarise([Results(tmp_path / "out")] * 2).notes.count(note) == 1
    write_rows(tmp_path / "root" / "Bad" / "groundtruth_rect.txt", clips["Toy"].boxes)
    assert evaluate(tmp_path / "root", tmp_path / "out", **options).summary.notes == []


def test_a_start_outside_the_frame_costs_only_itself(clips, tmp_path):
    """SRE moves a box at the edge completely out of the frame."""
    clip = clips["Toy"]
    write_otb(tmp_path / "root", "Toy", clip)
    rows = clip.boxes.astype(float)
    rows[0] = [-34, 10, 36, 30]
    write_rows(tmp_path / "root" / "Toy" / "groundtruth_rect.txt", rows)
    result = evaluate(
        tmp_path / "root", tmp_path / "out", settings=[SMALL], seeds=1, protocol="sre"
    )
    assert {broken.run.split(", ")[1] for broken in result.broken} == {
        *("sre00", "sre04", "sre06"),  # to the left
        "sre08",  # a smaller box in its middle
    }
    assert result.ran == 8


def test_temporal_robustness_runs_every_start(root, tmp_path):
    result = evaluate(root, tmp_path, sequences=["Toy"], settings=[SMALL], seeds=1, protocol="tre")
    starts = [(row.start, row.frames) for row in result.summary.rows]
    assert starts == [(f"tre{t:05d}", 30 - t) for t in range(11)]
    means = [row.scores.auc for row in result.summary.rows]
    assert result.summary.overall[SMALL]["auc"].mean == pytest.approx(np.mean(means))


def test_ctrl_c_keeps_what_is_done(root, tmp_path):
    class Impatient(Watch):
        def working(self, what):
            if what.startswith("Toy"):
                raise KeyboardInterrupt

    result = evaluate(root, tmp_path, settings=[SMALL], seeds=1, watch=Impatient())
    assert result.interrupted
    assert result.summary.sequences == ["Deer"]
    assert evaluate(root, tmp_path, settings=[SMALL], seeds=1).reused == 1


def test_folders_of_several_runs_become_one(root, clips, tmp_path):
    evaluate(root, tmp_path / "one", settings={"a": small()}, seeds=1)
    evaluate(root, tmp_path / "two", settings={"a": small(), "b": small(parts=1)}, seeds=1)
    merged = summarise([Results(tmp_path / "one"), Results(tmp_path / "two")])
    assert merged.settings == ["a", "b"]
    assert [(row.sequence, row.setting) for row in merged.rows].count(("Toy", "a")) == 1
    assert len([note for note in merged.notes if "the first one counts" in note]) == 2


def test_a_file_that_is_not_a_result_is_run_again(root, tmp_path):
    options: dict[str, Any] = {"sequences": ["Toy"], "settings": [SMALL], "seeds": 1}
    evaluate(root, tmp_path, **options)
    (path,) = tmp_path.glob("runs/*/*/*.npz")
    path.write_bytes(path.read_bytes()[:100])
    assert evaluate(root, tmp_path, **options).ran == 1


def test_opencv_mil_tracks(done, clips):
    result, _ = done
    (row,) = (r for r in result.summary.rows if (r.sequence, r.setting) == ("Deer", "OpenCV MIL"))
    assert row.seed == 0
    assert row.scores.success_rate > 0.3
    record = result.summary.records["Deer", "OpenCV MIL", "ope"]
    assert np.isnan(record.confidence).all()


def test_baselines_that_are_unknown_or_missing_are_refused(monkeypatch):
    assert "MIL" in baselines.available_baselines()
    assert baselines.select_baselines(["opencv", "MIL"]) == baselines.available_baselines()
    with pytest.raises(
        ValueError, match="'TLD' is not a baseline: expected opencv or some of MIL, KCF"
    ):
        baselines.select_baselines(["TLD"])
    monkeypatch.setitem(baselines.BASELINES, "CSRT", "TrackerThatIsNot_create")
    with pytest.raises(ValueError, match="CSRT is not in this OpenCV"):
        baselines.select_baselines(["CSRT"])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"seeds": 0}, "seeds must be at least 1, but is 0"),
        ({"protocol": "vot"}, "protocol must be one of ope, tre, sre"),
        ({"settings": ["best"]}, "'best' is not a preset"),
        ({"settings": []}, "nothing to run"),
        ({"sequences": ["Bolt"]}, "Bolt not found"),
        ({"baselines": ["TLD"]}, "not a baseline"),
    ],
)
def test_wrong_calls_are_refused_before_anything_is_written(root, tmp_path, options, message):
    with pytest.raises(ValueError, match=message):
        evaluate(root, tmp_path / "out", **options)
    assert not (tmp_path / "out").exists()


def test_published_tables_are_checked(tmp_path):
    with pytest.raises(ValueError, match="holds no CSV with the columns sequence, tracker"):
        read_published(tmp_path)
    (tmp_path / "bad.csv").write_text(
        "sequence,tracker,centre_error_px,success_rate,runs\nanimal,frag,much,0.04,5\n"
    )
    with pytest.raises(ValueError, match=r"bad.csv, line 2: .*'much'"):
        read_published(tmp_path)


def test_keys_do_not_depend_on_jax_arrays_in_a_config(root, tmp_path):
    options: dict[str, Any] = {"sequences": ["Toy"], "seeds": 1}

    def config(number):
        scale = dcs_jax.ScaleFilter(learning_rate=number(0.25))
        return small(lam=number(0.25), scale=scale)

    evaluate(root, tmp_path, settings={"a": config(float)}, **options)
    same = evaluate(root, tmp_path, settings={"a": config(jax.numpy.float32)}, **options)
    assert same.reused == 1
