"""Accelerated proximal gradient for the selection problem of `problem`: the tracker's solver.

A. Beck and M. Teboulle, A fast iterative shrinkage-thresholding algorithm (2009).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from dcs_jax.solvers.iterate import Method, scan
from dcs_jax.solvers.problem import Problem, Solution, eigenvalue_bound, noise_penalty


class _ApgState(NamedTuple):
    """An iterate, the point that it is extrapolated to, and the momentum t."""

    solution: Solution
    extrapolated: Solution
    momentum: Float[Array, ""]


def solve(problem: Problem, iterations: int) -> Solution:
    """A fixed number of accelerated proximal gradient steps from zero.

    Started from zero, equal columns have equal gradients and so equal coefficients in every
    iterate: solving for the distinct ones with their counts is the same computation.
    """
    apg = method(problem, jnp.zeros_like(problem.counts))
    state: _ApgState = scan(apg, apg.init, iterations)
    return state.solution


def method(problem: Problem, start: Float[Array, "M *B"]) -> Method:
    """The method from these coefficients and no noise."""
    votes, counts, labels, weights, lam, _ = problem
    lam_noise = noise_penalty(problem)
    # One over the Lipschitz constant of the gradient. The identities in W add 1 to the eigenvalue.
    step_size = 1 / (2 * (eigenvalue_bound(problem) + 1))
    labels, weights = (x.reshape(-1, *(1,) * step_size.ndim) for x in (labels, weights))
    step_size = step_size.reshape(-1, *start.shape[1:])

    def step(state: _ApgState) -> _ApgState:
        ahead = state.extrapolated
        # As in the problem written out, where each equal row has a noise of its own and each equal
        # column a coefficient: the step of the noise has no weights, that of beta no counts.
        residual = votes @ (counts * ahead.beta) + ahead.noise - labels
        beta = ahead.beta - step_size * (2 * (votes.T @ (weights * residual)) + lam)
        noise = ahead.noise - 2 * step_size * residual
        solution = Solution(
            beta=jnp.maximum(beta, 0),
            noise=jnp.sign(noise) * jnp.maximum(jnp.abs(noise) - step_size * lam_noise, 0),
        )
        momentum = (1 + jnp.sqrt(1 + 4 * state.momentum**2)) / 2
        inertia = (state.momentum - 1) / momentum
        ahead = jax.tree.map(lambda x, last: x + inertia * (x - last), solution, state.solution)
        return _ApgState(solution, ahead, momentum)

    solution = Solution(start, jnp.zeros((len(labels), *start.shape[1:]), start.dtype))
    return Method(
        _ApgState(solution, solution, jnp.ones((), start.dtype)),
        step,
        lambda state: (state.solution.beta, None),
    )
