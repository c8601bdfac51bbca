"""Accelerated proximal gradient for the selection problem (the paper's eq. 14 and 15).

    min over beta >= 0, e of  sum_l w_l [(phi_l' beta + e_l - y_l)^2 + lam |e_l|] + lam sum_m beta_m

with w the multiplicities of equal rows. It is the paper's ||W c - y||^2 + lam 1'c over c >= 0
with W = [Phi I -I] and c = [beta e+ e-] (the paper prints argmax, argmin is meant), without ever
building the identities: e+ and e- are never both positive at an optimum, so e = e+ - e- has a soft
threshold.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

_POWER_ITERATIONS = 8
# The power iteration approaches the largest eigenvalue from below.
_EIGENVALUE_MARGIN = 1.05


class Problem(NamedTuple):
    """One selection problem; equal columns and equal rows may be given once, with their number.

    votes: [M, L] real, a row for each distinct classifier (Phi transposed).
    counts: [M], how many classifiers vote like this, not negative.
    labels: [L] real. weights: [L], how many rows are like this, not negative.
    lam: [], weight of the l1 penalty, not negative.
    """

    votes: jax.Array
    counts: jax.Array
    labels: jax.Array
    weights: jax.Array
    lam: float | jax.Array


class Solution(NamedTuple):
    """Where the solver stopped.

    beta: [M] coefficient of each of the classifiers that vote alike, not negative.
    noise: [L] e, by how much the model corrects each row's label.
    """

    beta: jax.Array
    noise: jax.Array


def solve(problem: Problem, iterations: int) -> Solution:
    """A fixed number of accelerated proximal gradient steps from zero, for one problem.

    Started from zero, equal columns have equal gradients and so equal coefficients in every
    iterate: solving for the distinct ones with their counts is the same computation.
    """
    votes, counts, labels, weights, lam = problem
    step = 1 / (2 * _EIGENVALUE_MARGIN * (_largest_eigenvalue(problem) + 1))

    def iterate(carry: _Carry, _: None) -> tuple[_Carry, None]:
        momentum_next = (1 + jnp.sqrt(1 + 4 * carry.momentum**2)) / 2
        inertia = (carry.momentum - 1) / momentum_next
        ahead = jax.tree.map(lambda x, last: x + inertia * (x - last), carry.now, carry.last)
        residual = (counts * ahead.beta) @ votes + ahead.noise - labels
        beta = ahead.beta - step * (2 * (votes @ (weights * residual)) + lam)
        noise = ahead.noise - 2 * step * residual
        now = Solution(
            beta=jnp.maximum(beta, 0),
            noise=jnp.sign(noise) * jnp.maximum(jnp.abs(noise) - step * lam, 0),
        )
        return _Carry(now, carry.now, momentum_next), None

    zero = Solution(jnp.zeros_like(counts), jnp.zeros_like(labels))
    first = _Carry(zero, zero, jnp.ones((), votes.dtype))
    return jax.lax.scan(iterate, first, length=iterations)[0].now


def objective(problem: Problem, solution: Solution) -> jax.Array:
    """Value of the problem at a solution: []."""
    votes, counts, labels, weights, lam = problem
    residual = (counts * solution.beta) @ votes + solution.noise - labels
    per_row = residual**2 + lam * jnp.abs(solution.noise)
    return weights @ per_row + lam * (counts @ solution.beta)


class _Carry(NamedTuple):
    """The loop of `solve`: the last two iterates and the momentum t of the first."""

    now: Solution
    last: Solution
    momentum: jax.Array


def _largest_eigenvalue(problem: Problem) -> jax.Array:
    """Largest eigenvalue of Phi' diag(w) Phi by power iteration on the small L x L side: []."""
    scaled = problem.votes * jnp.sqrt(problem.weights)
    gram = jnp.einsum("m,ml,mk->lk", problem.counts, scaled, scaled)
    # The largest column cannot be orthogonal to the leading eigenvector, as a fixed start may be.
    vector = gram[:, jnp.argmax(jnp.diagonal(gram))]
    tiny = jnp.finfo(scaled.dtype).tiny
    for _ in range(_POWER_ITERATIONS):
        vector = gram @ (vector / jnp.maximum(jnp.linalg.norm(vector), tiny))
    return jnp.linalg.norm(vector)
