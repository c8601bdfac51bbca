"""Metrics against cases computed by hand and against the package got10k."""

import numpy as np
import pytest

from dcs_jax.evaluation.metrics import (
    centre_error,
    failures,
    mean_centre_error,
    normalised_precision_curve,
    overlap,
    precision_curve,
    scores,
    success_curve,
    success_rate,
)

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


def test_curves_by_hand():
    """Overlaps 1, 42/158 and 1/3; centre errors 0, 5 and 5 px, 0, 0.5 and 0.5 sides."""
    success = success_curve(BOXES, TRUTH)
    assert success.shape == (21,)
    np.testing.assert_allclose(success[[0, 5, 6, 7, 19, 20]], np.array([3, 3, 2, 1, 1, 0]) / 3)
    precision = precision_curve(BOXES, TRUTH)
    assert precision.shape == (51,)
    np.testing.assert_allclose(precision[[0, 4, 5, 50]], np.array([1, 1, 3, 3]) / 3)
    normalised = normalised_precision_curve(BOXES, TRUTH)
    assert normalised.shape == (51,)
    np.testing.assert_allclose(normalised[[0, 49, 50]], np.array([1, 1, 3]) / 3)


def test_normalised_precision_has_each_axis_in_its_own_side():
    truth = np.array([[0, 0, 100, 10]], float)
    for offset in ((20, 0, 0, 0), (0, 2, 0, 0)):  # a fifth of the side on its axis
        boxes = truth + np.array(offset)
        curve = normalised_precision_curve(boxes, truth)
        np.testing.assert_array_equal(curve, np.linspace(0, 0.5, 51) >= 0.2)


def test_failures_have_hysteresis():
    """Lost at 2; 0.3 is not yet held; held at 5, lost again at 7."""
    truth = np.tile([0.0, 0, 10, 10], (9, 1))
    truth[3] = np.nan
    boxes = truth.copy()
    for t, value in enumerate([1, 0.2, 0.05, 1, 0.3, 0.6, 0.2, 0.1, 0]):
        boxes[t] = [0, 0, 10, 10 * value or 1]
    boxes[8, 0] = 50
    assert failures(boxes, truth) == [2, 7]


def test_scores_are_the_summaries():
    found = scores(BOXES, TRUTH)
    assert found.centre_error == mean_centre_error(BOXES, TRUTH)
    assert found.success_rate == success_rate(BOXES, TRUTH)
    assert found.auc == success_curve(BOXES, TRUTH).mean()
    assert found.precision == precision_curve(BOXES, TRUTH)[20] == 1
    assert found.normalised_precision == normalised_precision_curve(BOXES, TRUTH).mean()
    assert found.failures == 0


def random_boxes(rng, count):
    corners = rng.uniform(-20, 100, (count, 2)).round(1)
    return np.concatenate([corners, rng.uniform(5, 60, (count, 2)).round(1)], axis=1)


def test_metrics_are_those_of_got10k():
    """10 000 pairs of boxes, near and far.

    Its centres are half a pixel further to the top left, for both boxes; its overlap has a
    machine epsilon in the denominator.
    """
    reference = pytest.importorskip("got10k.utils.metrics", reason="got10k is not installed")
    rng = np.random.default_rng(0)
    truth = random_boxes(rng, 10_000)
    boxes = truth + rng.normal(0, rng.choice([0, 3, 30], (10_000, 1)), truth.shape)
    boxes[:, 2:] = np.maximum(boxes[:, 2:], 1)
    ious, errors = reference.rect_iou(boxes, truth), reference.center_error(boxes, truth)
    np.testing.assert_allclose(overlap(boxes, truth), ious, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(centre_error(boxes, truth), errors, rtol=1e-9, atol=1e-9)


def test_curves_are_those_of_got10k():
    """Its method for one sequence, called without the data set that the class wants."""
    otb = pytest.importorskip("got10k.experiments.otb", reason="got10k is not installed")
    reference = pytest.importorskip("got10k.utils.metrics", reason="got10k is not installed")

    class Experiment:
        nbins_iou, nbins_ce = 21, 51

    rng = np.random.default_rng(1)
    for _ in range(50):
        truth = random_boxes(rng, 100)
        boxes = truth + rng.normal(0, 8, truth.shape)
        boxes[:, 2:] = np.maximum(boxes[:, 2:], 1)
        success, precision = otb.ExperimentOTB._calc_curves(
            Experiment, reference.rect_iou(boxes, truth), reference.center_error(boxes, truth)
        )
        np.testing.assert_allclose(success_curve(boxes, truth), success)
        np.testing.assert_allclose(precision_curve(boxes, truth), precision)
