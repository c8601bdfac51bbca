"""Iterate until a duality gap is small enough: the same loop for every method."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32

from dcs_jax.core.apg import Problem
from dcs_jax.core.certificate import Certificate, certify

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
    objective: Float[Array, ""]
    bound: Float[Array, ""]
    iterations: Int32[Array, ""]
    finite: Bool[Array, ""]


def iterate(
    problem: Problem,
    method: Method,
    start: Float[Array, " M"],
    tol: float | Float[Array, ""],
    max_iterations: int,
    every: int,
) -> Outcome:
    """Run a method until the gap is at most tol, or for a number of iterations.

    start: [M], coefficients to fall back on; with those of beta = 0 they are looked at first.
    every: iterations between two looks at the gap; `max_iterations` is rounded up to it.

    A method whose numbers are no longer finite ends, with the best it had.
    """
    at_zero, at_start = (certify(problem, beta) for beta in (jnp.zeros_like(start), start))
    scale = SMALLEST_OBJECTIVE * at_zero.objective
    first = _Carry(
        method.first,
        jnp.where(at_start.objective < at_zero.objective, start, 0),
        jnp.minimum(at_start.objective, at_zero.objective),
        jnp.maximum(at_start.bound, at_zero.bound),
        jnp.zeros((), jnp.int32),
        jnp.ones((), bool),
    )

    def gap(carry: _Carry) -> Float[Array, ""]:
        largest = jnp.maximum(jnp.maximum(carry.objective, scale), jnp.finfo(scale.dtype).tiny)
        return jnp.maximum(carry.objective - carry.bound, 0) / largest

    def unfinished(carry: _Carry) -> Bool[Array, ""]:
        return carry.finite & (gap(carry) > tol) & (carry.iterations < max_iterations)

    def advance(carry: _Carry) -> _Carry:
        state = method.advance(carry.state, every)
        beta, theta = method.solution(state)
        known: Certificate = certify(problem, beta, theta)
        better = known.objective < carry.objective
        return _Carry(
            state,
            jnp.where(better, beta, carry.beta),
            jnp.where(better, known.objective, carry.objective),
            jnp.where(known.bound > carry.bound, known.bound, carry.bound),
            carry.iterations + every,
            jnp.isfinite(known.objective),
        )

    last = jax.lax.while_loop(unfinished, advance, first)
    noise = certify(problem, last.beta).noise
    return Outcome(last.beta, noise, last.objective, gap(last), last.iterations)
