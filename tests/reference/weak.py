"""The weak classifiers: Kalman-filtered class means, votes, and the counts of right and wrong."""

import numpy as np

from .records import Floats

FIRST_VARIANCE = 1000.0  # P of the Kalman filter before the first sample
NOISE = 0.01  # R of the Kalman filter
LEAST_GAIN = 0.001
LEAST_SIGMA = 1.0  # grey values


def first_sigma(boxes: np.ndarray) -> Floats:
    """Standard deviations before the first sample, [F, 2], of features of so many boxes [F].

    The values of one box are taken as uniform over 256 grey levels: variance 256^2 / 12.
    """
    sigma = np.sqrt(256.0**2 * np.asarray(boxes, np.float64) / 12)
    return np.stack([sigma, sigma], axis=1)


def kalman_update(
    responses: Floats, labels: Floats, means: Floats, sigma: Floats | None, variance: Floats
) -> tuple[Floats, Floats | None, Floats]:
    """The class models after all samples, one after the other.

    For a sample x of a class: K = max(P / (P + R), 0.001), mean += K (x - mean),
    sigma^2 <- K (x - mean)^2 + (1 - K) sigma^2 with the new mean, P <- P R / (P + R).

    responses: [F, L]. labels: [L], +1 object, -1 background. means, sigma: [F, 2], column 0
    background, column 1 object; sigma is None where it is not tracked. variance: [2], P of each
    class. Returns means, sigma, variance.
    """
    means, variance = means.copy(), variance.copy()
    sigma = None if sigma is None else sigma.copy()
    for sample, label in enumerate(labels):
        k = 1 if label > 0 else 0
        x, p = responses[:, sample], variance[k]
        gain = max(p / (p + NOISE), LEAST_GAIN)
        means[:, k] += gain * (x - means[:, k])
        if sigma is not None:
            squared = gain * (x - means[:, k]) ** 2 + (1 - gain) * sigma[:, k] ** 2
            sigma[:, k] = np.maximum(np.sqrt(squared), LEAST_SIGMA)
        variance[k] = p * NOISE / (p + NOISE)
    return means, sigma, variance


def vote_midpoint(x: Floats, background: Floats, target: Floats) -> Floats:
    """Votes h = sign((x - (mu+ + mu-) / 2) (mu+ - mu-)) with sign(0) = +1.

    x: responses. background, target: mu- and mu+; all broadcast. Returns +1 or -1.
    """
    return np.where((x - (target + background) / 2) * (target - background) >= 0, 1.0, -1.0)


def vote_gaussian(
    x: Floats, background: Floats, target: Floats, sigma_background: Floats, sigma_target: Floats
) -> Floats:
    """+1 where the object's Gaussian is at least as dense as the background's, else -1 (eq. 16)."""
    density_target = -(((x - target) / sigma_target) ** 2) / 2 - np.log(sigma_target)
    density_background = -(((x - background) / sigma_background) ** 2) / 2
    density_background = density_background - np.log(sigma_background)
    return np.where(density_target >= density_background, 1.0, -1.0)


def votes(responses: Floats, means: Floats, sigma: Floats | None) -> Floats:
    """Votes h of the weak classifiers, +1 or -1: "gaussian" where sigma is given, else "midpoint".

    responses: [F, L], any number of columns. means, sigma: [F, 2]. Returns [F, L].
    """
    background, target = means[:, 0, None], means[:, 1, None]
    if sigma is None:
        return vote_midpoint(responses, background, target)
    return vote_gaussian(responses, background, target, sigma[:, 0, None], sigma[:, 1, None])


def count(
    predicted: Floats, labels: Floats, correct: Floats, wrong: Floats
) -> tuple[Floats, Floats]:
    """The counts lambda_c, lambda_w [F] after these votes: predicted [F, L], labels [L]."""
    right = predicted == labels
    return correct + right.sum(axis=1), wrong + (~right).sum(axis=1)


def error(correct: Floats, wrong: Floats) -> Floats:
    """Accumulated error e = lambda_w / (lambda_w + lambda_c)."""
    return wrong / (wrong + correct)
