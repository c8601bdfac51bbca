"""Iteration until the duality gap is small enough: the same loop around every method."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32

from dcs_jax.solvers.certificate import Certificate, certify
from dcs_jax.solvers.problem import Problem
from dcs_jax.types import Scalar

# An objective below this share of that of beta = 0 is 0 up to rounding: the gap is then relative to
# this share.
SMALLEST_OBJECTIVE = 1e-6


class Method(NamedTuple):
    """An iterative method on one problem, as each solver's `method(problem, start)` makes it.

    init: state before the first iteration, any pytree.
    step: function of a state that returns the one after one more iteration.
    solution: function of a state that returns its coefficients beta [M], and a dual point
        theta [L] or None.
    """

    init: Any
    step: Callable[[Any], Any]
    solution: Callable[[Any], tuple[Float[Array, " M"], Float[Array, " L"] | None]]


class Solved(NamedTuple):
    """The best coefficients seen, and what is known of them.

    beta: [M]. noise: [L]. objective: [], the least of all iterates looked at.
    gap: [], upper bound of (objective - minimum) / objective, not negative; relative to
        `SMALLEST_OBJECTIVE` times the objective of beta = 0 where that is more.
    iterations: [] int32.
    """

    beta: Float[Array, " M"]
    noise: Float[Array, " L"]
    objective: Float[Array, ""]
    gap: Float[Array, ""]
    iterations: Int32[Array, ""]


class _LoopState(NamedTuple):
    """The method's state, the best solution and bound so far, and whether all is finite."""

    method_state: Any
    beta: Float[Array, " M"]
    noise: Float[Array, " L"]
    objective: Float[Array, ""]
    bound: Float[Array, ""]
    iterations: Int32[Array, ""]
    finite: Bool[Array, ""]


def scan(method: Method, state: Any, iterations: int) -> Any:
    """The state after a static number of further iterations."""
    # Unrolled once, the tracker's small problems take four fifths of the time.
    return jax.lax.scan(
        lambda state, _: (method.step(state), None), state, length=iterations, unroll=2
    )[0]


def iterate(
    problem: Problem,
    method: Method,
    start: Float[Array, " M"] | None,
    tol: Scalar,
    max_iterations: int,
    every: int,
) -> Solved:
    """Run a method until the gap is at most tol, or for a number of iterations.

    start: [M], coefficients to compare with the method's, as beta = 0 is always; or None.
    every: iterations between two looks at the gap; `max_iterations` is rounded up to it.

    A method ends early where its numbers are no longer finite. The best solution so far counts.
    """
    zero = jnp.zeros_like(problem.counts)
    at_zero = certify(problem, zero)
    scale = SMALLEST_OBJECTIVE * at_zero.objective
    init = _LoopState(
        method.init,
        zero,
        at_zero.noise,
        at_zero.objective,
        at_zero.bound,
        jnp.zeros((), jnp.int32),
        jnp.ones((), bool),
    )
    if start is not None:
        init = _better(init, start, certify(problem, start))

    def gap(state: _LoopState) -> Float[Array, ""]:
        largest = jnp.maximum(jnp.maximum(state.objective, scale), jnp.finfo(scale.dtype).tiny)
        return jnp.maximum(state.objective - state.bound, 0) / largest

    def unfinished(state: _LoopState) -> Bool[Array, ""]:
        return state.finite & (gap(state) > tol) & (state.iterations < max_iterations)

    def step(state: _LoopState) -> _LoopState:
        method_state = scan(method, state.method_state, every)
        beta, theta = method.solution(method_state)
        known = certify(problem, beta, theta)
        return _better(state, beta, known)._replace(
            method_state=method_state,
            iterations=state.iterations + every,
            finite=jnp.isfinite(known.objective),
        )

    last = jax.lax.while_loop(unfinished, step, init)
    return Solved(last.beta, last.noise, last.objective, gap(last), last.iterations)


def _better(state: _LoopState, beta: Float[Array, " M"], known: Certificate) -> _LoopState:
    """The state with these coefficients where they are better than the best so far."""
    better = known.objective < state.objective
    return state._replace(
        beta=jnp.where(better, beta, state.beta),
        noise=jnp.where(better, known.noise, state.noise),
        objective=jnp.where(better, known.objective, state.objective),
        bound=jnp.where(known.bound > state.bound, known.bound, state.bound),
    )
