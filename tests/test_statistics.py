"""Intervals and tests against textbook cases and other ways of computing them."""

import math

import numpy as np
import pytest
from scipy import stats

from dcs_jax.evaluation.statistics import FEWEST_SEEDS, paired, ranks, spread, welch_test


def test_spread_of_three_values():
    """Student's t for 2 degrees of freedom and 95 % is 4.3027."""
    found = spread([1, 2, 3])
    assert (found.mean, found.sd, found.least, found.greatest, found.n) == (2, 1, 1, 3, 3)
    assert found.high - 2 == pytest.approx(4.3027 / 3**0.5, abs=1e-4)
    assert found.low == pytest.approx(4 - found.high)


def test_spread_of_one_value_and_of_none():
    one, none = spread([5, np.nan]), spread([])
    assert (one.mean, one.n, none.n) == (5, 1, 0)
    assert all(map(math.isnan, (one.sd, one.low, one.high, none.mean)))


def test_the_interval_holds_the_mean_as_often_as_it_says():
    rng = np.random.default_rng(0)
    found = [spread(values) for values in rng.normal(3, 2, (4000, 10))]
    held = np.mean([s.low < 3 < s.high for s in found])
    assert held == pytest.approx(0.95, abs=0.01)


def test_paired_by_hand():
    """Differences 1, 2 and 3: of the 8 choices of signs, 2 are as far from 0."""
    found = paired([2, 4, 6], [1, 2, 3])
    assert (found.difference, found.n) == (2, 3)
    assert found.p == pytest.approx(2 / 8)
    assert (found.low, found.high) == spread([1, 2, 3])[4:6]


def test_paired_agrees_with_the_t_test_on_normal_values():
    rng = np.random.default_rng(1)
    first = rng.normal(0, 1, 30)
    second = first + rng.normal(0.3, 1, 30)
    found = paired(first, second)
    assert found.p == pytest.approx(stats.ttest_rel(first, second).pvalue, abs=0.02)
    assert paired(second, first).difference == -found.difference


@pytest.mark.parametrize("n", [13, 14])
def test_the_p_value_is_that_of_scipys_permutation_test(n):
    """Exact up to 13 differences, drawn for more."""
    differences = np.random.default_rng(n).normal(0.4, 1, n)
    test = stats.permutation_test(
        (differences,), np.mean, permutation_type="samples", n_resamples=np.inf
    )
    assert paired(differences, np.zeros(n)).p == pytest.approx(
        test.pvalue, abs=1e-12 if n == 13 else 0.015
    )


def test_equal_settings_do_not_differ():
    assert paired([0.5, 1, 1], [0.5, 1, 1])[:4] == (0, 0, 0, 1)


@pytest.mark.parametrize(("first", "second"), [([1], [2]), ([1, 2], [1, 2, 3]), ([[1, 2]],) * 2])
def test_what_is_not_paired_is_refused(first, second):
    with pytest.raises(ValueError, match="two arrays"):
        paired(first, second)


def test_welch_by_hand():
    """Means 12 and 10, deviations 2 and 3, 5 and 9 runs: 2 / sqrt(4 / 5 + 1)."""
    values = 12 + np.array([2, 2, 0, -2, -2])
    found = welch_test(values, 10, 3, 9)
    assert found.t == pytest.approx(2 / (4 / 5 + 1) ** 0.5)
    freedom = (4 / 5 + 1) ** 2 / ((4 / 5) ** 2 / 4 + 1 / 8)
    assert found.p == pytest.approx(2 * stats.t.sf(found.t, freedom))


@pytest.mark.parametrize("n", [FEWEST_SEEDS, 30])
def test_the_published_mean_and_deviation_stand_for_the_runs(n):
    rng = np.random.default_rng(n)
    ours, theirs = rng.normal(10, 2, n), rng.normal(12, 5, 30)
    found = welch_test(ours, theirs.mean(), theirs.std(ddof=1), len(theirs))
    expected = stats.ttest_ind(ours, theirs, equal_var=False)
    assert (found.t, found.p) == pytest.approx((expected.statistic, expected.pvalue))


@pytest.mark.parametrize(
    ("values", "sd", "n", "message"),
    [
        ([10, 10.1], 1, 30, "needs 5 seeds and 2 published runs, but has 2 and 30"),
        ([1, 2, 3, 4, math.nan], 1, 30, "but has 4 and 30"),
        ([1, 2, 3, 4, 5], 1, 1, "but has 5 and 1"),
        ([1] * 5, 0, 30, "needs a deviation on one side"),
    ],
)
def test_welch_needs_runs_and_a_deviation(values, sd, n, message):
    with pytest.raises(ValueError, match=message):
        welch_test(values, 1, sd, n)


def test_equal_values_share_a_rank_and_nan_has_none():
    assert ranks([3, 1, 1, 2, math.nan], least_is_best=True) == [3, 1, 1, 2, 0]
    assert ranks([3, 1, 1, 2], least_is_best=False) == [1, 3, 3, 2]
