"""Statistics over seeds: intervals, and tests between settings and against published runs."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

LEVEL = 0.95
EXACT = 13  # differences of which all 8192 choices of signs are looked at
RESAMPLES = 9999  # random choices for more


class Spread(NamedTuple):
    """What n values of one number over seeds say.

    mean, sd: and standard deviation, with n - 1 below the root. least, greatest: of them.
    low, high: 95 % interval of the mean by Student's t. sd and interval are NaN for one value.
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
    half = float(special.stdtrit(n - 1, (1 + LEVEL) / 2)) * sd / n**0.5 if n > 1 else np.nan
    return Spread(mean, sd, float(known.min()), float(known.max()), mean - half, mean + half, n)


class Paired(NamedTuple):
    """The difference of two settings on the same n seeds.

    difference: mean of first minus second. low, high: its 95 % interval by Student's t.
    p: two-sided, that the signs of the differences are chance (a permutation test, so that no
        distribution is assumed: single runs are lost or not, which is far from normal).
    """

    difference: float
    low: float
    high: float
    p: float
    n: int


def paired(first: ArrayLike, second: ArrayLike) -> Paired:
    """Compare the values [n] of two settings, seed by seed.

    Raises ValueError for other shapes than two of [n] with n at least 2.
    """
    first, second = np.asarray(first, np.float64), np.asarray(second, np.float64)
    if first.shape != second.shape or first.ndim != 1 or len(first) < 2:
        raise ValueError(
            "a paired test needs two arrays [n] of the same seeds, n at least 2, "
            f"but has {first.shape} and {second.shape}"
        )
    differences = first - second
    values = spread(differences)
    if not differences.any():
        return Paired(0.0, 0.0, 0.0, 1.0, values.n)
    p = _sign_flip(differences)
    return Paired(values.mean, values.low, values.high, p, values.n)


def _sign_flip(differences: NDArray[np.float64]) -> float:
    """How often the sum [n] is as far from 0 with random signs: of all choices, or of many."""
    n = len(differences)
    if n <= EXACT:
        bits = np.arange(2**n)[:, None] >> np.arange(n) & 1
        drawn = 0
    else:
        bits = np.random.default_rng(0).integers(0, 2, (RESAMPLES, n))
        drawn = 1  # the signs as they are count as one of the draws
    sums = np.abs((1 - 2 * bits) @ differences)
    far = np.count_nonzero(sums >= abs(differences.sum()) * (1 - 1e-9))
    return float((far + drawn) / (len(bits) + drawn))


class ZTest(NamedTuple):
    """z, in standard errors of the difference of two means, and its two-sided p."""

    z: float
    p: float


def z_test(values: ArrayLike, mean: float, sd: float, n: int) -> ZTest:
    """Our values [m] against n published runs known by mean and standard deviation.

    Raises ValueError where neither has a deviation, which leaves nothing to compare with.
    """
    ours = spread(values)
    if ours.n < 2 or n < 2:
        raise ValueError(f"a z-test needs 2 runs or more on both sides, but has {ours.n} and {n}")
    error = (ours.sd**2 / ours.n + sd**2 / n) ** 0.5
    if error == 0:
        raise ValueError("a z-test needs a deviation on one side, but both are 0")
    z = (ours.mean - mean) / error
    return ZTest(float(z), float(2 * special.ndtr(-abs(z))))


def ranks(values: Sequence[float], least_is_best: bool) -> list[int]:
    """Rank of each value, 1 the best; equal ones share it. NaN has rank 0.

    Values are compared as given: round them first to how they are shown.
    """
    signed = np.asarray(values, np.float64) * (1 if least_is_best else -1)
    return [0 if np.isnan(v) else 1 + len({u for u in signed.tolist() if u < v}) for v in signed]
