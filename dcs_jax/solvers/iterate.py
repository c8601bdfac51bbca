"""Iterate until a duality gap is small enough: the same loop for every method."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32

from dcs_jax.solvers.certificate import Certificate, certify
from dcs_jax.solvers.problem import Problem

# An objective this small a part of that of beta = 0 is 0 but for rounding: a gap is relative to
# this part then.
SMALLEST_OBJECTIVE = 1e-6


class Method(NamedTuple):
    """An iterative method on one problem.

    first: the state before the first iteration, any pytree.
    advance: the state after a static number of further iterations.
    solution: a state's coefficients beta [M], and a dual point theta [L] or None.
    """

    first: Any
    advance: Callable[[Any, int], Any]
    solution: Callable[[Any], tuple[Float[Array, " M"], Float[Array, " L"] | None]]


class Outcome(NamedTuple):
    """The best coefficients seen, and what is known of them.

    beta: [M]. noise: [L]. objective: [], the least one of all iterates looked at.
    gap: [], an upper bound of (objective - minimum) / objective, not negative; relative to
        `SMALLEST_OBJECTIVE` times the objective of beta = 0 where that is more.
    iterations: [] int32.
    """

    beta: Float[Array, " M"]
    noise: Float[Array, " L"]
    objective: Float[Array, ""]
    gap: Float[Array, ""]
    iterations: Int32[Array, ""]


class _Carry(NamedTuple):
    """The loop: the method's state, the best solution and bound so far, if all is finite."""

    state: Any
    beta: Float[Array, " M"]
    noise: Float[Array, " L"]
    objective: Float[Array, ""]
    bound: Float[Array, ""]
    iterations: Int32[Array, ""]
    finite: Bool[Array, ""]


def iterate(
    problem: Problem,
    method: Method,
    start: Float[Array, " M"] | None,
    tol: float | Float[Array, ""],
    max_iterations: int,
    every: int,
) -> Outcome:
    """Run a method until the gap is at most tol, or for a number of iterations.

    start: [M], coefficients to fall back on, looked at first beside beta = 0; or None.
    every: iterations between two looks at the gap; `max_iterations` is rounded up to it.

    A method whose numbers are no longer finite ends, with the best it had.
    """
    zero = jnp.zeros_like(problem.counts)
    at_zero = certify(problem, zero)
    scale = SMALLEST_OBJECTIVE * at_zero.objective
    first = _Carry(
        method.first,
        zero,
        at_zero.noise,
        at_zero.objective,
        at_zero.bound,
        jnp.zeros((), jnp.int32),
        jnp.ones((), bool),
    )
    if start is not None:
        first = _better(first, start, certify(problem, start))

    def gap(carry: _Carry) -> Float[Array, ""]:
        largest = jnp.maximum(jnp.maximum(carry.objective, scale), jnp.finfo(scale.dtype).tiny)
        return jnp.maximum(carry.objective - carry.bound, 0) / largest

    def unfinished(carry: _Carry) -> Bool[Array, ""]:
        return carry.finite & (gap(carry) > tol) & (carry.iterations < max_iterations)

    def advance(carry: _Carry) -> _Carry:
        state = method.advance(carry.state, every)
        beta, theta = method.solution(state)
        known = certify(problem, beta, theta)
        return _better(carry, beta, known)._replace(
            state=state,
            iterations=carry.iterations + every,
            finite=jnp.isfinite(known.objective),
        )

    last = jax.lax.while_loop(unfinished, advance, first)
    return Outcome(last.beta, last.noise, last.objective, gap(last), last.iterations)


def _better(carry: _Carry, beta: Float[Array, " M"], known: Certificate) -> _Carry:
    """The loop with these coefficients where they are better than the best so far."""
    better = known.objective < carry.objective
    return carry._replace(
        beta=jnp.where(better, beta, carry.beta),
        noise=jnp.where(better, known.noise, carry.noise),
        objective=jnp.where(better, known.objective, carry.objective),
        bound=jnp.where(known.bound > carry.bound, known.bound, carry.bound),
    )
