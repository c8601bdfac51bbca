"""The proximal gradient of the package jaxopt, for comparison.

It solves the problem as the paper prints it, with W = [Phi I -I] in memory.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from dcs_jax.solvers.iterate import Method
from dcs_jax.solvers.problem import Problem, noise_penalty


def method(problem: Problem, start: Float[Array, " M"]) -> Method:
    """The method with jaxopt's own step lengths, from these coefficients and no noise."""
    # Here, not above: the import takes half a second, and warns that jaxopt is not maintained.
    import jaxopt

    votes, counts, labels, weights, lam, _ = problem
    rows, columns = votes.shape
    root, identity = jnp.sqrt(weights), jnp.eye(rows, dtype=votes.dtype)
    w = jnp.concatenate([counts[None] * votes, identity, -identity], axis=1)
    noise = jnp.tile(noise_penalty(problem) * weights, 2)
    penalty = jnp.concatenate([lam * counts, noise])

    def squares(c: Float[Array, " unknowns"]) -> Float[Array, ""]:
        return jnp.sum((root * (w @ c - labels)) ** 2)

    solver = jaxopt.ProximalGradient(squares, jaxopt.prox.prox_non_negative_lasso, tol=0.0)
    c = jnp.concatenate([start, jnp.zeros(2 * rows, start.dtype)])
    return Method(
        jaxopt.OptStep(c, solver.init_state(c, hyperparams_prox=penalty)),
        lambda state: solver.update(*state, hyperparams_prox=penalty),
        lambda state: (state.params[:columns], None),
    )
