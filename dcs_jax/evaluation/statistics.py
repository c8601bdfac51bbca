"""Statistics over seeds: intervals, and tests between settings and against published runs."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy  # which imports scipy.stats at its first use: it takes 0.8 s, too long for --help
from numpy.typing import ArrayLike, NDArray

LEVEL = 0.95
FEWEST_SEEDS = 5  # of a verdict on published runs: a deviation from fewer is hardly known
RESAMPLES = 9999  # random choices of signs; up to 13 differences have fewer, and all are counted


class Spread(NamedTuple):
    """A summary of n values of one number over seeds.

    sd: standard deviation, with n - 1 below the root; NaN for one value.
    low, high: 95 % interval of the mean by Student's t; NaN for one value.
    """

    mean: float
    sd: float
    least: float
    greatest: float
    low: float
    high: float
    n: int


def spread(values: ArrayLike) -> Spread:
    """Summarise the values [n] of one number over seeds; NaN values are left out."""
    known: NDArray[np.float64] = np.asarray(values, np.float64)
    known = known[~np.isnan(known)]
    n = len(known)
    if n == 0:
        return Spread(np.nan, np.nan, np.nan, np.nan, np.nan, np.nan, 0)
    mean, sd = float(known.mean()), float(known.std(ddof=1)) if n > 1 else np.nan
    half = float(scipy.special.stdtrit(n - 1, (1 + LEVEL) / 2)) * sd / n**0.5 if n > 1 else np.nan
    return Spread(mean, sd, float(known.min()), float(known.max()), mean - half, mean + half, n)


class Paired(NamedTuple):
    """The difference of two settings on the same n seeds.

    difference: mean of first minus second.
    low, high: its 95 % interval by Student's t.
    p: two-sided, that the signs of the differences are chance. A permutation test, which assumes no
        distribution: a run loses its target or does not, which is far from normal.
    """

    difference: float
    low: float
    high: float
    p: float
    n: int


def paired(first: ArrayLike, second: ArrayLike) -> Paired:
    """Compare the values [n] of two settings, seed by seed.

    Raises ValueError unless both have the same shape [n], n at least 2.
    """
    first, second = np.asarray(first, np.float64), np.asarray(second, np.float64)
    if first.shape != second.shape or first.ndim != 1 or len(first) < 2:
        raise ValueError(
            "a paired test needs two arrays [n] of the same seeds, n at least 2, "
            f"but has {first.shape} and {second.shape}"
        )
    differences = first - second
    values = spread(differences)
    test = scipy.stats.permutation_test(
        (differences,),
        np.sum,
        permutation_type="samples",
        n_resamples=RESAMPLES,
        rng=np.random.default_rng(0),
    )
    return Paired(values.mean, values.low, values.high, float(test.pvalue), values.n)


class WelchTest(NamedTuple):
    """t, in standard errors of the difference of two means, and its two-sided p."""

    t: float
    p: float


def welch_test(values: ArrayLike, mean: float, sd: float, n: int) -> WelchTest:
    """Our values [m] against n published runs known by mean and standard deviation.

    Welch's t-test: it does not assume that both have the same deviation.

    Raises ValueError for fewer than `FEWEST_SEEDS` values or 2 runs, or where both deviations are
    0, so that there is nothing to compare with.
    """
    ours = spread(values)
    if ours.n < FEWEST_SEEDS or n < 2:
        raise ValueError(
            f"Welch's test needs {FEWEST_SEEDS} seeds and 2 published runs, "
            f"but has {ours.n} and {n}"
        )
    if ours.sd == sd == 0:
        raise ValueError("Welch's test needs a deviation on one side, but both are 0")
    test = scipy.stats.ttest_ind_from_stats(
        ours.mean, ours.sd, ours.n, mean, sd, n, equal_var=False
    )
    return WelchTest(float(test.statistic), float(test.pvalue))


def ranks(values: Sequence[float], least_is_best: bool) -> list[int]:
    """Rank of each value, 1 for the best. Equal values share a rank; NaN has rank 0.

    Values are compared exactly: round them before, as they are shown.
    """
    signed = np.asarray(values, np.float64) * (1 if least_is_best else -1)
    found = scipy.stats.rankdata(signed, method="dense", nan_policy="omit")
    return [int(rank) for rank in np.nan_to_num(found)]
