"""Certificate of a solution of the selection problem: its objective, and a bound on the minimum.

The noise e can be eliminated from the problem of `problem`: the best one for a residual
r = y - Phi beta is r shrunk by t = lam_noise / 2, which leaves

    P(beta) = sum_l w_l h(r_l) + lam sum_m beta_m,   h(r) = r^2 if |r| <= t else 2 t |r| - t^2,

Huber's loss. As h(r) = max over |theta| <= t of 2 theta r - theta^2, the dual problem is

    max over theta of D(theta) = sum_l w_l (2 theta_l y_l - theta_l^2)
    where |theta_l| <= t and sum_l w_l phi_lm theta_l <= lam / 2 for every classifier m.

Every feasible theta bounds the minimum from below, so P(beta) - D(theta) bounds how far P(beta)
is above it.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from dcs_jax.solvers.problem import Problem, noise_penalty


class Certificate(NamedTuple):
    """What is known of a solution.

    noise: [L], the best e for these coefficients. objective: [], P(beta).
    bound: [], D of the dual point, a lower bound of the objective of any coefficients.
    """

    noise: Float[Array, " L"]
    objective: Float[Array, ""]
    bound: Float[Array, ""]


def certify(
    problem: Problem, beta: Float[Array, " M"], theta: Float[Array, " L"] | None = None
) -> Certificate:
    """Bound the distance of beta to the optimum with a dual point.

    theta: [L], numbers near a solution of the dual problem, which are clipped and scaled until they
        are feasible. By default the residual of beta, which at the optimum solves the dual problem.
    """
    votes, counts, labels, weights, lam, _ = problem
    limit = noise_penalty(problem) / 2
    residual = labels - votes @ (counts * beta)
    clipped = jnp.clip(residual, -limit, limit)
    theta = clipped if theta is None else jnp.clip(theta, -limit, limit)
    correlation = jnp.where(counts > 0, (weights * theta) @ votes, 0)
    # The rounding errors of a correlation and of an objective count, or the bound is not valid.
    eps = jnp.finfo(correlation.dtype).eps
    rounding = eps * jnp.abs(votes).max(0) * jnp.linalg.norm(weights * theta)
    largest = (correlation + jnp.where(counts > 0, rounding, 0)).max()
    scale = jnp.where(largest > lam / 2, lam / 2 / jnp.where(largest > 0, largest, 1), 1)
    theta, correlation = scale * theta, scale * correlation
    # P - D as a sum of terms that are not negative, as the difference of two sums would lose the
    # digits that matter: row by row h(r) + theta^2 - 2 theta r, column by column beta (lam - 2 c).
    rows = (clipped - theta) * (2 * residual - clipped - theta)
    columns = counts * beta * (lam - 2 * correlation)
    gap = weights @ jnp.maximum(rows, 0) + jnp.maximum(columns, 0).sum()
    limited = weights @ (clipped * (2 * residual - clipped))  # Huber's loss
    objective = limited + lam * (counts @ beta)
    return Certificate(residual - clipped, objective, objective * (1 - 4 * eps) - gap)
