"""How a selector chooses one weak classifier from its own pool (Algorithm 2).

phi: [..., L, M], the votes of each selector's pool on the training samples, +1 or -1. y: [L], the
labels. Every function returns [...], indices in [0, M). Ties matter: the winner is always the
first whose score is within a relative tolerance of the best.
"""

import numpy as np

from .records import Floats, Integers
from .solver import fista

TIE = 1e-3  # scores this close, relative to the best, are equal


def first_best(scores: Floats) -> int:
    """Index of the first of the scores [M] that is at least best - 1e-3 |best|."""
    best = scores.max()
    for index, score in enumerate(scores):
        if score >= best - TIE * abs(best):
            return index
    raise ValueError("scores that are not numbers have no best")


def select_l1(
    phi: Floats, y: Floats, lam: float, iterations: int, errors: Floats | None = None
) -> Integers:
    """The first column with the largest coefficient beta after so many FISTA iterations.

    Where all coefficients are zero: the first column that agrees best with the labels. With errors
    [..., M], of the columns with the largest coefficient the one with the least error.
    """
    beta, _ = fista(phi, y, lam, iterations)
    chosen = np.zeros(phi.shape[:-2], np.int64)
    for problem in np.ndindex(chosen.shape):
        scores = beta[problem] if beta[problem].max() > 0 else phi[problem].T @ y
        chosen[problem] = first_best(scores)
        if errors is not None:
            tied = scores >= scores.max() - TIE * abs(scores.max())
            chosen[problem] = first_best(np.where(tied, -errors[problem], -np.inf))
    return chosen


def label_noise(phi: Floats, y: Floats, lam: float, iterations: int) -> Floats:
    """The noise e of the box and of the corners, [5], in the mean over all problems.

    phi: [..., L, M]. The box is the first four samples, whose e are the same.
    """
    _, e = fista(phi, y, lam, iterations)
    return e.reshape(-1, len(y)).mean(axis=0)[[0, 4, 5, 6, 7]]


def select_error(errors: Floats) -> Integers:
    """The first column with the least accumulated error e; errors: [..., M]."""
    chosen = np.zeros(errors.shape[:-1], np.int64)
    for problem in np.ndindex(chosen.shape):
        chosen[problem] = first_best(-errors[problem])
    return chosen


def select_first(phi: Floats, y: Floats) -> Integers:
    """The first column that is right on the most samples of this frame."""
    chosen = np.zeros(phi.shape[:-2], np.int64)
    for problem in np.ndindex(chosen.shape):
        chosen[problem] = first_best((phi[problem] == y[:, None]).sum(axis=0).astype(np.float64))
    return chosen


def select_mil(phi: Floats, y: Floats) -> Integers:
    """Greedy multiple-instance boosting (Babenko et al., CVPR 2009), selector after selector.

    Selector n of a part adds the column h_m that makes the bags likeliest, given the sum H of the
    votes its predecessors in this part have chosen.

    phi: [K, N, L, M]. Returns [K, N].
    """
    parts, selectors, samples, _ = phi.shape
    chosen = np.zeros((parts, selectors), np.int64)
    for k in range(parts):
        strong = np.zeros(samples)
        for n in range(selectors):
            totals = strong[:, None] + phi[k, n]
            chosen[k, n] = first_best(bag_log_likelihood(totals, y))
            strong = totals[:, chosen[k, n]]
    return chosen


def bag_log_likelihood(totals: Floats, y: Floats) -> Floats:
    """Log likelihood [M] of the bags under sample probabilities p = logistic(total).

    All samples labelled +1 are one positive bag of probability 1 - prod (1 - p_i); every sample
    labelled -1 is a negative bag.

    totals: [L, M], H + h_m. y: [L].
    """
    log_not_p = -np.logaddexp(0, totals)
    log_none = log_not_p[y > 0].sum(axis=0)
    return np.array([_log_of_rest(x) for x in log_none]) + log_not_p[y < 0].sum(axis=0)


def _log_of_rest(x: float) -> float:
    """ln(1 - exp(x)) for x < 0, to full accuracy near 0 as well as far from it."""
    return float(np.log(-np.expm1(x)) if x > -np.log(2) else np.log1p(-np.exp(x)))
