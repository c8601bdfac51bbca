"""The selection problem (eq. 14): non-negative l1 minimisation with a sparse label-noise term.

    min over beta >= 0 and e of  ||Phi beta + e - y||^2 + lambda (sum beta + sum |e|)

phi: [L, M], the votes of M weak classifiers on L samples. y: [L], the labels. beta: [M]. e: [L],
the label noise. lam: lambda.
"""

import numpy as np
from scipy.optimize import nnls

from .records import Floats

ORDERS = 5  # of the columns, in which the exact solver is tried
BOUND_POWER = 2  # p of the bound (sum of the eigenvalues to the p)^(1/p) on the largest one


def objective(phi: Floats, y: Floats, lam: float, beta: Floats, e: Floats) -> float:
    """||Phi beta + e - y||^2 + lambda (sum beta + sum |e|)."""
    residual = phi @ beta + e - y
    return float((residual**2).sum() + lam * (beta.sum() + np.abs(e).sum()))


def huber_objective(phi: Floats, y: Floats, lam: float, beta: Floats) -> float:
    """The least `objective` over e: lambda sum beta + sum of the Huber loss of y - Phi beta.

    The loss is r^2 up to |r| = lambda / 2 and lambda |r| - lambda^2 / 4 beyond.
    """
    total = lam * beta.sum()
    for r in y - phi @ beta:
        total += r**2 if abs(r) <= lam / 2 else lam * abs(r) - lam**2 / 4
    return float(total)


def duality_gap(phi: Floats, y: Floats, lam: float, beta: Floats, e: Floats) -> float:
    """An upper bound of how far `objective` at (beta, e) is above its minimum, 0 at the minimum.

    The dual problem is to maximise 2 y't - ||t||^2 over t with Phi't <= lambda / 2 and
    |t| <= lambda / 2. The residual, shrunk until it is feasible, is such a t.
    """
    residual = y - phi @ beta - e
    largest = max(float((phi.T @ residual).max()), float(np.abs(residual).max()))
    dual = residual * min(1.0, lam / 2 / largest) if largest > 0 else residual
    return objective(phi, y, lam, beta, e) - float(2 * y @ dual - dual @ dual)


def fista(phi: Floats, y: Floats, lam: float, iterations: int) -> tuple[Floats, Floats]:
    """Accelerated proximal gradient from zero, for a fixed number of iterations.

    A gradient step of 1 / (2 (lambda + 1)) from the extrapolated point, where lambda bounds the
    largest eigenvalue of Phi'Phi by the 2-norm of them all, then
    beta <- max(beta - step lambda, 0) and e <- soft(e, step lambda); the momentum is
    (t - 1) / t' with t' = (1 + sqrt(1 + 4 t^2)) / 2, from t = 1.

    phi: [..., L, M], many problems at once. Returns beta [..., M], e [..., L].
    """
    eigenvalues = np.linalg.eigvalsh(phi @ np.swapaxes(phi, -1, -2))
    step = 1 / (2 * (np.linalg.norm(eigenvalues, ord=BOUND_POWER, axis=-1) + 1))[..., None]
    beta = beta_ahead = np.zeros(phi.shape[:-2] + phi.shape[-1:])
    e = e_ahead = np.zeros(phi.shape[:-1])
    t = 1.0
    for _ in range(iterations):
        residual = np.einsum("...lm,...m->...l", phi, beta_ahead) + e_ahead - y
        beta_before, e_before = beta, e
        beta = beta_ahead - step * 2 * np.einsum("...lm,...l->...m", phi, residual)
        beta = np.maximum(beta - step * lam, 0)
        e = e_ahead - step * 2 * residual
        e = np.sign(e) * np.maximum(np.abs(e) - step * lam, 0)

        t_next = (1 + np.sqrt(1 + 4 * t**2)) / 2
        beta_ahead = beta + (t - 1) / t_next * (beta - beta_before)
        e_ahead = e + (t - 1) / t_next * (e - e_before)
        t = t_next
    return beta, e


def solve_exactly(
    phi: Floats,
    y: Floats,
    lam: float,
    lam_noise: float | None = None,
    weights: Floats | None = None,
) -> tuple[Floats, Floats]:
    """A minimiser beta [M], e [L], by a finite method that has nothing in common with `fista`.

    lam_noise: the noise's own lambda. weights: [L] positive, how often each sample counts.

    With W = [Phi I -I], c = [beta e+ e-] >= 0 the dual problem is to project y onto the polyhedron
    W't <= lambda / 2, and c are its multipliers. Least distance programming (Lawson and Hanson,
    Solving Least Squares Problems, chapter 23) turns this into one non-negative least squares
    problem. Of several minimisers it returns one.

    Raises RuntimeError if the duality gap of the result is not 0 to rounding.
    """
    samples, columns = phi.shape
    root = np.ones(samples) if weights is None else np.sqrt(weights)
    noise_limit = root * (lam if lam_noise is None else lam_noise) / 2
    limit = np.concatenate([np.full(columns, lam / 2), noise_limit, noise_limit])
    w = np.hstack([root[:, None] * phi, np.eye(samples), -np.eye(samples)])
    target = root * y
    # min ||z||, -W'z >= W'y - limit, z = t - y
    system = np.vstack([-w, w.T @ target - limit])
    corner = np.append(np.zeros(samples), 1.0)
    for attempt in range(ORDERS):
        # On votes, many of whose columns are equal, `nnls` stops short in one case in a thousand,
        # another one in another order of the columns.
        order = np.random.default_rng(attempt).permutation(system.shape[1])
        u = np.zeros(system.shape[1])
        u[order], _ = nnls(system[:, order], corner)
        residual = corner - system @ u
        c = u / residual[-1]
        dual = target + residual[:-1] / -residual[-1]
        violation = max(0.0, float((w.T @ dual - limit).max()))
        value = float(((target - w @ c) ** 2).sum() + 2 * limit @ c)
        gap = value - float(2 * target @ dual - dual @ dual)
        if gap + violation * 2 * c.sum() <= 1e-8 * (1 + target @ target):
            break
    else:
        raise RuntimeError(f"the reference solution has a duality gap of {gap}")
    beta, noise = c[:columns], c[columns : columns + samples] - c[columns + samples :]
    return beta, noise / root
