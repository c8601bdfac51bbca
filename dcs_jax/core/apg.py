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
from jaxtyping import Array, Float

# Up to so many rows the looser of the two bounds on the step is taken.
_FEW_ROWS = 8
_SQUARINGS = 4


class Problem(NamedTuple):
    """One selection problem; equal columns and equal rows may be given once, with their number.

    votes: [M, L] real, a row for each distinct classifier (Phi transposed).
    counts: [M], how many classifiers vote like this, not negative; or [M, B], B problems at once
        with the same distinct classifiers, each with counts of its own.
    labels: [L] real. weights: [L], how many rows are like this, not negative.
    lam: [], weight of the l1 penalty, not negative.
    """

    votes: Float[Array, "M L"]
    counts: Float[Array, "M *B"]
    labels: Float[Array, " L"]
    weights: Float[Array, " L"]
    lam: float | Float[Array, ""]


class Solution(NamedTuple):
    """Where the solver stopped.

    beta: [M] or [M, B], coefficient of each of the classifiers that vote alike, not negative.
    noise: [L] or [L, B], e, by how much the model corrects each row's label.
    """

    beta: Float[Array, "M *B"]
    noise: Float[Array, "L *B"]


def solve(problem: Problem, iterations: int) -> Solution:
    """A fixed number of accelerated proximal gradient steps from zero.

    Started from zero, equal columns have equal gradients and so equal coefficients in every
    iterate: solving for the distinct ones with their counts is the same computation.
    """
    votes, counts, labels, weights, lam = problem
    step = 1 / (2 * (_eigenvalue_bound(problem) + 1))  # [] or [B]
    labels, weights = (x.reshape(-1, *(1,) * step.ndim) for x in (labels, weights))

    def iterate(carry: _Carry, _: None) -> tuple[_Carry, None]:
        ahead = carry.ahead
        residual = votes.T @ (counts * ahead.beta) + ahead.noise - labels
        beta = ahead.beta - step * (2 * (votes @ (weights * residual)) + lam)
        noise = ahead.noise - 2 * step * residual
        now = Solution(
            beta=jnp.maximum(beta, 0),
            noise=jnp.sign(noise) * jnp.maximum(jnp.abs(noise) - step * lam, 0),
        )
        momentum = (1 + jnp.sqrt(1 + 4 * carry.momentum**2)) / 2
        inertia = (carry.momentum - 1) / momentum
        ahead = jax.tree.map(lambda x, last: x + inertia * (x - last), now, carry.now)
        return _Carry(now, ahead, momentum), None

    zero = Solution(jnp.zeros_like(counts), jnp.zeros_like(labels * step))
    first = _Carry(zero, zero, jnp.ones((), votes.dtype))
    # Unrolled once, the tracker's small problems take four fifths of the time.
    return jax.lax.scan(iterate, first, length=iterations, unroll=2)[0].now


def objective(problem: Problem, solution: Solution) -> Float[Array, ""]:
    """Value of one problem at a solution: []."""
    votes, counts, labels, weights, lam = problem
    residual = (counts * solution.beta) @ votes + solution.noise - labels
    per_row = residual**2 + lam * jnp.abs(solution.noise)
    return weights @ per_row + lam * (counts @ solution.beta)


class _Carry(NamedTuple):
    """The loop of `solve`: an iterate, the point it is extrapolated to, and the momentum t."""

    now: Solution
    ahead: Solution
    momentum: Float[Array, ""]


def _eigenvalue_bound(problem: Problem) -> Float[Array, "*B"]:
    """An upper bound of the largest eigenvalue of Phi' diag(w) Phi: [] or [B].

    tr(G^16)^(1/16), at most L^(1/16) times the eigenvalue, by squaring the small L x L Gram matrix
    four times; of a few rows tr(G^2)^(1/2), in a tenth of the time (on the tracker's votes 1.08
    times the eigenvalue in the mean and 1.15 at most). A power iteration comes from below instead:
    its step may be too long, and its error depends on the eigenvalues.
    """
    scaled = problem.votes * jnp.sqrt(problem.weights)
    if len(problem.labels) <= _FEW_ROWS:
        products = (scaled[:, :, None] * scaled[:, None, :]).reshape(len(scaled), -1)
        return jnp.sqrt(jnp.square(products.T @ problem.counts).sum(0))
    gram = jnp.einsum("m...,ml,mk->...lk", problem.counts, scaled, scaled)
    log_bound = jnp.zeros(gram.shape[:-2], gram.dtype)
    for squaring in range(_SQUARINGS + 1):
        # Scaled by the trace, no power leaves the range of floats.
        trace = jnp.trace(gram, axis1=-2, axis2=-1)
        trace = jnp.maximum(trace, jnp.finfo(gram.dtype).tiny)
        log_bound += jnp.log(trace) / 2**squaring
        gram = gram / trace[..., None, None]
        gram = gram @ gram
    return jnp.exp(log_bound)
