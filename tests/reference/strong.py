"""The strong part classifiers: their weights, their maps, and the fusion of the parts."""

import math

import numpy as np

from .haar import haar_map
from .records import Floats, Grid, Integers
from .weak import votes

LEAST_MISS = 1e-6  # 1 - p of a part is not taken below this


def voting_weight(error: Floats) -> Floats:
    """Weights alpha = max(0, ln((1 - e) / e)) for accumulated errors e in (0, 1)."""
    return np.maximum(0.0, np.log((1 - error) / error))


def strong_map(
    window_integral: Floats,
    corners: Integers,
    weights: Floats,
    means: Floats,
    sigma: Floats | None,
    alpha: Floats,
    grid: Grid,
) -> Floats:
    """H^k = sum_n alpha_n h_n / sum_n alpha_n of one part at every position, [Cy, Cx] in [-1, 1].

    window_integral: [Gy + 1, Gx + 1]. The rest belongs to the part's N selected features: corners
    and weights [N, 9], means and sigma [N, 2], alpha [N]. 0 everywhere if all alpha are 0.
    """
    total = np.zeros(grid.positions)
    for n in range(len(alpha)):
        values = haar_map(window_integral, corners[n], weights[n], grid).reshape(1, -1)
        h = votes(values, means[n : n + 1], None if sigma is None else sigma[n : n + 1])
        total += alpha[n] * h.reshape(grid.positions)
    return total / alpha.sum() if alpha.sum() > 0 else total


def smooth(values: Floats, smoothing: float) -> Floats:
    """A map [Cy, Cx] under a 3x3 Gaussian of this standard deviation in cells, edges repeated.

    Per axis the weights are [a, 1, a] / (1 + 2 a), a = exp(-1 / (2 smoothing^2)), 0 for 0.
    """
    a = math.exp(-1 / (2 * smoothing**2)) if smoothing > 0 else 0.0
    rows = np.pad(values, ((1, 1), (0, 0)), mode="edge")
    values = (a * rows[:-2] + rows[1:-1] + a * rows[2:]) / (1 + 2 * a)
    columns = np.pad(values, ((0, 0), (1, 1)), mode="edge")
    return (a * columns[:, :-2] + columns[:, 1:-1] + a * columns[:, 2:]) / (1 + 2 * a)


def part_probabilities(strong: Floats, smoothing: float) -> Floats:
    """Smoothed probabilities (1 + H) / 2 of the parts, [K, Cy, Cx]; strong: [K, Cy, Cx], H."""
    return np.stack([smooth((1 + part) / 2, smoothing) for part in strong])


def score_map(probabilities: Floats, smoothing: float) -> Floats:
    """The score map [Cy, Cx]: -sum_k ln(max(1 - p_k, 1e-6)), smoothed.

    probabilities: [K, Cy, Cx]. The Noisy-OR of the parts is 1 - exp(-score).
    """
    total = np.zeros(probabilities.shape[1:])
    for part in probabilities:
        total -= np.log(np.maximum(1 - part, LEAST_MISS))
    return smooth(total, smoothing)
