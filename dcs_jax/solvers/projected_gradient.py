"""The plain projected gradient method for the selection problem, for comparison.

It minimises the form in which the noise is eliminated (`certificate`): over beta >= 0 alone, with
the gradient lam - 2 Phi' W clip(y - Phi beta, -t, t).
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from dcs_jax.solvers.iterate import Method
from dcs_jax.solvers.problem import Problem, eigenvalue_bound, noise_penalty


def method(problem: Problem, start: Float[Array, " M"]) -> Method:
    """The method from these coefficients; its state is the coefficients."""
    votes, counts, labels, weights, lam, _ = problem
    limit = noise_penalty(problem) / 2
    # The bound is 0 where all votes are.
    step_size = 1 / (2 * jnp.maximum(eigenvalue_bound(problem), jnp.finfo(start.dtype).tiny))

    def step(beta: Float[Array, " M"]) -> Float[Array, " M"]:
        clipped = jnp.clip(labels - votes @ (counts * beta), -limit, limit)
        gradient = lam - 2 * ((weights * clipped) @ votes)
        return jnp.maximum(beta - step_size * gradient, 0)

    return Method(start, step, lambda beta: (beta, None))
