"""A primal-dual interior point method for the selection problem (Mehrotra's predictor-corrector).

In the scaled form a = sqrt(w) phi / (column norm), b = sqrt(w) y, the dual problem of `certificate`
is to project b onto a polyhedron,

    min over theta of ||theta - b||^2 / 2   where   G theta + s = h, s >= 0,

with the rows of G: the columns of Phi (theta' a_m <= lam / 2), I and -I (|theta| <= t). Its
multipliers x >= 0 are the coefficients and the noise, x = [beta e+ e-]: theta + G' x = b. The
L + 2 L + M unknowns of a Newton step reduce to L, or to M where that is less:

    (I + G' diag(x / s) G) dtheta = g,   I + G' diag(x / s) G = diag(.) + A' diag(beta / s) A.

Source: S. Mehrotra, On the implementation of a primal-dual interior point method (1992), with J.
Gondzio's centrality correctors (Multiple centrality corrections in a primal-dual method, 1996).
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from dcs_jax.solvers.iterate import Method
from dcs_jax.solvers.problem import Problem, noise_penalty

# A step goes this share of the way to the boundary.
_STEP = 0.99
# Least noise of a row at the start, in units of the largest label. 0.1 takes about one step less
# than 1, and coefficients of 1 / sqrt(M) take one step in ten less than 1 / M.
_LEAST_NOISE = 0.1
# Centrality corrections, of two triangular solves each. 100 problems of 100 x 200 take 185 ms with
# none, 152 with one, 159 with two, 182 with three.
_CORRECTIONS = 1
# Complementarity products are corrected to within this factor of their target.
_SPREAD = 10.0
# Weight of the quadratic (proximal) term that keeps each step's coefficients near the last ones, in
# bounds of their constraints. Without it float32 stalls at a gap of 1e-4 to 1e-3, or ends in NaN;
# with it 1e-6 is reached in as many steps. In units of the square root of rounding: 30 is 1e-2 in
# float32, where 1e-1 takes more steps and 1e-3 leaves some problems stalled.
_DAMPING = 30.0
# Least bound of a constraint, in units of rounding: with lam = 0 there would be no interior.
_LEAST_BOUND = 1.0


class _InteriorState(NamedTuple):
    """An interior iterate: theta [L], multipliers x and slacks s [M + 2 L] of the constraints."""

    theta: Float[Array, " L"]
    multiplier: Float[Array, " constraints"]
    slack: Float[Array, " constraints"]


class _Scaled(NamedTuple):
    """The problem in the scaled form: a [M, L], b [L], h [M + 2 L], and what undoes the scaling."""

    votes: Float[Array, "M L"]
    labels: Float[Array, " L"]
    bound: Float[Array, " constraints"]
    row_scale: Float[Array, " L"]
    column_scale: Float[Array, " M"]


def method(problem: Problem, start: Float[Array, " M"]) -> Method:
    """The method from a start of its own: theta = 0, and noise that takes up the labels.

    start: [M], not used: coefficients of 0 lie on the boundary, where the method cannot start.
    """
    scaled = _scale(problem)
    columns, rows = scaled.votes.shape
    beta = jnp.full(columns, columns**-0.5, scaled.votes.dtype)
    noise = scaled.labels - beta @ scaled.votes
    init = _InteriorState(
        jnp.zeros(rows, noise.dtype),
        jnp.concatenate(
            [beta, jnp.maximum(noise, 0) + _LEAST_NOISE, jnp.maximum(-noise, 0) + _LEAST_NOISE]
        ),
        scaled.bound,
    )

    def solution(state: _InteriorState) -> tuple[Float[Array, " M"], Float[Array, " L"]]:
        return state.multiplier[:columns] * scaled.column_scale, state.theta * scaled.row_scale

    return Method(init, functools.partial(_step, scaled), solution)


def _scale(problem: Problem) -> _Scaled:
    votes, counts, labels, weights, lam, _ = problem
    size = jnp.where(jnp.abs(labels).max() > 0, jnp.abs(labels).max(), 1)
    root = jnp.sqrt(weights)
    votes = jnp.where(counts[:, None] > 0, votes.T * root[None], 0)  # [M, L]
    largest = jnp.abs(votes).max(1)
    largest = jnp.where(largest > 0, largest, 1)
    present = weights > 0
    limit = noise_penalty(problem) / 2 / size * jnp.where(present, root, 1)
    votes, labels = votes / largest[:, None], labels * root / size
    least = _LEAST_BOUND * jnp.finfo(votes.dtype).eps * (jnp.abs(votes) @ limit)
    return _Scaled(
        votes,
        labels,
        jnp.concatenate([jnp.maximum(lam / 2 / size / largest, least), limit, limit]),
        jnp.where(present, size / jnp.where(present, root, 1), 0),
        size / largest / jnp.maximum(counts, 1),
    )


def _step(scaled: _Scaled, state: _InteriorState) -> _InteriorState:
    """One predictor-corrector step."""
    votes, labels, bound, *_ = scaled
    columns = votes.shape[0]
    theta, multiplier, slack = state
    damping = _DAMPING * jnp.finfo(bound.dtype).eps ** 0.5 * bound
    damping = jnp.where(jnp.arange(bound.shape[0]) < columns, damping, 0)
    denominator = slack + damping * multiplier
    ratio = multiplier / denominator
    solve = _factorise(votes, ratio)
    primal = labels - theta - _adjoint(votes, multiplier)
    dual = bound - slack - _forward(votes, theta)

    def direction(change: Float[Array, " constraints"]) -> _InteriorState:
        """The Newton step that changes the products x s by this much, to first order."""
        towards = change / denominator - ratio * dual
        d_theta = solve(primal, towards)
        forward = _forward(votes, d_theta)
        d_multiplier = towards + ratio * forward
        return _InteriorState(d_theta, d_multiplier, dual - forward + damping * d_multiplier)

    def length(step: _InteriorState) -> Float[Array, ""]:
        """How far the step may go, at most 1, before a multiplier or a slack is 0."""
        return 1 / jnp.maximum(
            jnp.maximum((-step.multiplier / multiplier).max(), (-step.slack / slack).max()), 1
        )

    product = multiplier * slack
    mean = product.mean()
    predictor = direction(-product)
    reach = length(predictor)
    reached = (multiplier + reach * predictor.multiplier) * (slack + reach * predictor.slack)
    # Mehrotra's target: the further the predictor gets, the less centring.
    target = (reached.mean() / mean) ** 3 * mean
    change = target - predictor.multiplier * predictor.slack - product
    step = direction(change)
    reach = length(step)
    for _ in range(_CORRECTIONS):
        # Gondzio's: aim a little further than the step reaches, correct what is far from target.
        trial = jnp.minimum(1.1 * reach + 0.1, 1)
        reached = (multiplier + trial * step.multiplier) * (slack + trial * step.slack)
        correction = jnp.clip(reached, target / _SPREAD, target * _SPREAD) - reached
        corrected_change = change + jnp.maximum(correction, -_SPREAD * target)
        corrected = direction(corrected_change)
        corrected_reach = length(corrected)
        better = corrected_reach > reach
        step, change, reach = jax.tree.map(
            lambda new, old, better=better: jnp.where(better, new, old),
            (corrected, corrected_change, corrected_reach),
            (step, change, reach),
        )
    return jax.tree.map(lambda x, dx: x + jnp.minimum(_STEP * reach, 1) * dx, state, step)


def _forward(votes: Float[Array, "M L"], theta: Float[Array, " L"]) -> Float[Array, " constraints"]:
    """G theta."""
    return jnp.concatenate([votes @ theta, theta, -theta])


def _adjoint(votes: Float[Array, "M L"], x: Float[Array, " constraints"]) -> Float[Array, " L"]:
    """G' x."""
    columns, rows = votes.shape
    return x[:columns] @ votes + x[columns : columns + rows] - x[columns + rows :]


def _factorise(
    votes: Float[Array, "M L"], ratio: Float[Array, " constraints"]
) -> Callable[[Float[Array, " L"], Float[Array, " constraints"]], Float[Array, " L"]]:
    """Function of p and x that returns the solution of (I + G' diag(ratio) G) d = p - G' x."""
    columns, rows = votes.shape
    inner = ratio[:columns]
    diagonal = 1 + ratio[columns : columns + rows] + ratio[columns + rows :]
    if rows <= columns:
        solve = _cholesky((votes * inner[:, None]).T @ votes, diagonal)
        return lambda p, x: solve(p - _adjoint(votes, x))
    solve = _cholesky((votes / diagonal[None]) @ votes.T, 1 / inner)

    def by_columns(p: Float[Array, " L"], x: Float[Array, " constraints"]) -> Float[Array, " L"]:
        # Solved for the change of beta: the two terms of the Woodbury formula cancel.
        rest = p - x[columns : columns + rows] + x[columns + rows :]
        beta = solve(x[:columns] / inner + votes @ (rest / diagonal))
        return (rest - beta @ votes) / diagonal

    return by_columns


def _cholesky(
    matrix: Float[Array, "n n"], diagonal: Float[Array, " n"]
) -> Callable[[Float[Array, " n"]], Float[Array, " n"]]:
    """Function that solves (matrix + diag(diagonal)) x = g."""
    factor = jax.lax.linalg.cholesky(matrix + jnp.diag(diagonal), symmetrize_input=False)

    def solve(g: Float[Array, " n"]) -> Float[Array, " n"]:
        half = jax.lax.linalg.triangular_solve(factor, g[:, None], left_side=True, lower=True)
        return jax.lax.linalg.triangular_solve(
            factor, half, left_side=True, lower=True, transpose_a=True
        )[:, 0]

    return solve
