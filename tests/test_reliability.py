"""What `benchmarks.reliability` says of the confidence."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks import reliability
from dcs_jax import Config

NONE = [np.nan] * 4


@given(
    confidence=st.lists(st.floats(0, 1), min_size=2, max_size=30),
    right=st.lists(st.booleans(), min_size=30, max_size=30),
)
def test_area_is_the_share_of_pairs_in_order(confidence, right):
    found = np.array(confidence), np.array(right[: len(confidence)], np.float64)
    of_right, of_wrong = found[0][found[1] == 1], found[0][found[1] == 0]
    if not len(of_right) or not len(of_wrong):
        assert np.isnan(reliability.failure_auc(*found))
        return
    above = of_right[:, None] > of_wrong[None]
    same = of_right[:, None] == of_wrong[None]
    assert reliability.failure_auc(*found) == pytest.approx((above + same / 2).mean())


def test_calibration_error_is_the_mean_distance_over_the_bins():
    confidence = np.array([0.05, 0.05, 0.95, 0.95])
    assert reliability.calibration_error(confidence, np.array([0.0, 0, 1, 1])) == pytest.approx(
        0.05
    )
    assert reliability.calibration_error(confidence, np.array([0.0, 1, 1, 1])) == pytest.approx(
        (0.45 + 0.05) / 2
    )


@pytest.mark.parametrize(
    ("labels", "expected"),
    [
        ([[0, 0, 20, 10], NONE, [7, 5, 20, 10]], True),
        ([[0, 0, 20, 10], [7, 5, 20.4, 10]], True),  # rounded
        ([[0, 0, 20, 10], NONE, [7, 5, 20, 11]], False),
        ([[0, 0, 20, 10], [7, 5, 22, 10]], False),
    ],
)
def test_labels_of_one_size(labels, expected):
    assert reliability.have_one_size(np.array(labels)) == expected


def test_a_box_is_compared_in_the_size_that_the_labels_have(monkeypatch, capsys, tmp_path):
    """Labels of one size say nothing of the size; others do."""
    sizes, starts = [], []

    class Runs:
        boxes = np.array([[[0.0, 0, 20, 10], [1, 1, 20, 10]]])
        confidence = np.array([[np.nan, 0.9]])

    def run_seeds(frames, box, seeds, config):
        sizes.append(config.output_size)
        starts.append(box.tolist())
        return Runs

    class Sequence:
        frames = None
        truth: np.ndarray

    class Entry:
        name = "some"

        def load(self):
            return Sequence

    monkeypatch.setattr(reliability, "run_seeds", run_seeds)
    monkeypatch.setattr(reliability, "find_sequences", lambda *_: [Entry()])
    for options, truth in (
        ([], [[0.0, 0, 20, 10], [2, 0, 20, 10]]),
        (["--estimated"], [[0.0, 0, 20, 10], [2, 0, 20, 10]]),
        ([], [[0.0, 0, 20, 10], [2, 0, 30, 10]]),
    ):
        Sequence.truth = np.array(truth)
        monkeypatch.setattr("sys.argv", ["reliability", str(tmp_path), *options])
        reliability.main()
    assert sizes == ["initial", "estimated", "estimated"]
    assert starts == [[0, 0, 20, 10]] * 3
    assert Config().output_size == "estimated"
    assert "| some | 1 | 1.000 | 0.900 |" in capsys.readouterr().out
