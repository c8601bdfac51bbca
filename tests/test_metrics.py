"""Metrics against cases computed by hand."""

import numpy as np
import pytest

from dcs_jax.evaluation.metrics import centre_error, mean_centre_error, overlap, success_rate

BOXES = np.array([[0, 0, 10, 10], [0, 0, 10, 10], [0, 0, 10, 10], [0, 0, 10, 10]], float)
TRUTH = np.array([[0, 0, 10, 10], [3, 4, 10, 10], [0, 5, 10, 10], [np.nan] * 4])


def test_centre_error_is_the_distance_of_the_centres():
    np.testing.assert_array_equal(centre_error(BOXES, TRUTH), [0, 5, 5, np.nan])
    assert mean_centre_error(BOXES, TRUTH) == pytest.approx(10 / 3)


def test_overlap_is_intersection_over_union():
    np.testing.assert_allclose(overlap(BOXES, TRUTH), [1, 42 / 158, 1 / 3, np.nan])
    assert overlap(BOXES[:1], BOXES[:1] + np.array([20, 0, 0, 0])) == 0


def test_success_is_strictly_above_the_threshold():
    half = np.array([[0, 0, 10, 5]], float)
    assert overlap(BOXES[:1], half) == 0.5
    assert success_rate(BOXES[:1], half) == 0
    assert success_rate(BOXES, TRUTH) == pytest.approx(1 / 3)
    assert success_rate(BOXES, TRUTH, threshold=0.3) == pytest.approx(2 / 3)


def test_what_cannot_be_compared_is_refused():
    with pytest.raises(ValueError, match=r"\(4, 4\) and \(3, 4\)"):
        centre_error(BOXES, TRUTH[:3])
    with pytest.raises(ValueError, match="labels no frame"):
        success_rate(BOXES[:1], TRUTH[3:])
