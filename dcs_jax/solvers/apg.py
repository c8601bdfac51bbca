"""Accelerated proximal gradient for the selection problem of `problem`: the tracker's solver.

A. Beck and M. Teboulle, A fast iterative shrinkage-thresholding algorithm (2009).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from dcs_jax.solvers.problem import Problem, Solution, eigenvalue_bound, noise_penalty


class Carry(NamedTuple):
    """Between two iterations: an iterate, the point it is extrapolated to, momentum t and step."""

    now: Solution
    ahead: Solution
    momentum: Float[Array, ""]
    step: Float[Array, "*B"]


def solve(problem: Problem, iterations: int) -> Solution:
    """A fixed number of accelerated proximal gradient steps from zero.

    Started from zero, equal columns have equal gradients and so equal coefficients in every
    iterate: solving for the distinct ones with their counts is the same computation.
    """
    return advance(problem, begin(problem, jnp.zeros_like(problem.counts)), iterations).now


def begin(problem: Problem, beta: Float[Array, "M *B"]) -> Carry:
    """The state before the first iteration, from these coefficients and no noise."""
    noise = jnp.zeros((len(problem.labels), *beta.shape[1:]), beta.dtype)
    first = Solution(beta, noise)
    step = 1 / (2 * (eigenvalue_bound(problem) + 1))
    return Carry(first, first, jnp.ones((), beta.dtype), step)


def advance(problem: Problem, carry: Carry, iterations: int) -> Carry:
    """A fixed number of iterations: calls in a row are one call with the sum of their numbers."""
    votes, counts, labels, weights, lam, _ = problem
    lam_noise = noise_penalty(problem)
    step = carry.step
    labels, weights = (x.reshape(-1, *(1,) * step.ndim) for x in (labels, weights))

    def iterate(carry: Carry, _: None) -> tuple[Carry, None]:
        ahead = carry.ahead
        residual = votes @ (counts * ahead.beta) + ahead.noise - labels
        beta = ahead.beta - step * (2 * (votes.T @ (weights * residual)) + lam)
        noise = ahead.noise - 2 * step * residual
        now = Solution(
            beta=jnp.maximum(beta, 0),
            noise=jnp.sign(noise) * jnp.maximum(jnp.abs(noise) - step * lam_noise, 0),
        )
        momentum = (1 + jnp.sqrt(1 + 4 * carry.momentum**2)) / 2
        inertia = (carry.momentum - 1) / momentum
        ahead = jax.tree.map(lambda x, last: x + inertia * (x - last), now, carry.now)
        return Carry(now, ahead, momentum, step), None

    # Unrolled once, the tracker's small problems take four fifths of the time.
    return jax.lax.scan(iterate, carry, length=iterations, unroll=2)[0]
