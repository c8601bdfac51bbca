"""The selection problem (the paper's eq. 14 and 15), its objective and a bound on its curvature.

    min over beta >= 0, e of
        sum_l w_l [(phi_l' beta + e_l - y_l)^2 + lam_noise |e_l|] + lam sum_m beta_m

with w the multiplicities of equal rows. With lam_noise = lam it is the paper's
||W c - y||^2 + lam 1'c over c >= 0 with W = [Phi I -I] and c = [beta e+ e-] (the paper prints
argmax, argmin is meant), without ever building the identities: e+ and e- are never both positive at
an optimum, so e = e+ - e- has a soft threshold.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from dcs_jax.types import Scalar

# Up to this many rows the looser bound is used, in a tenth of the time.
_FEW_ROWS = 8
_SQUARINGS = 4


class Problem(NamedTuple):
    """One selection problem. Equal columns and equal rows may be given once, with their number.

    votes: [L, M] real, Phi: a row for each distinct sample, a column for each distinct classifier.
    counts: [M], number of classifiers that vote like this, not negative; or [M, B], B problems at
        once with the same distinct classifiers, each with counts of its own.
    labels: [L] real, y. weights: [L], number of samples like this, not negative.
    lam: [], weight of the l1 penalty on the coefficients, not negative.
    lam_noise: [], weight of the l1 penalty on the noise, not negative; None: lam, as in the paper.
    """

    votes: Float[Array, "L M"]
    counts: Float[Array, "M *B"]
    labels: Float[Array, " L"]
    weights: Float[Array, " L"]
    lam: Scalar
    lam_noise: Scalar | None = None


class Solution(NamedTuple):
    """Where the solver stopped.

    beta: [M] or [M, B], coefficient of each of the classifiers that vote alike, not negative.
    noise: [L] or [L, B], e, the model's correction of each sample's label.
    """

    beta: Float[Array, "M *B"]
    noise: Float[Array, "L *B"]


def noise_penalty(problem: Problem) -> Scalar:
    """The weight of the penalty on the noise: []."""
    return problem.lam if problem.lam_noise is None else problem.lam_noise


def objective(problem: Problem, solution: Solution) -> Float[Array, ""]:
    """Value of one problem at a solution: []."""
    votes, counts, labels, weights, lam, _ = problem
    residual = votes @ (counts * solution.beta) + solution.noise - labels
    per_row = residual**2 + noise_penalty(problem) * jnp.abs(solution.noise)
    return weights @ per_row + lam * (counts @ solution.beta)


def eigenvalue_bound(problem: Problem) -> Float[Array, "*B"]:
    """An upper bound of the largest eigenvalue of Phi' diag(w) Phi: [] or [B].

    tr(G^16)^(1/16), at most L^(1/16) times the eigenvalue, by squaring the small L x L Gram matrix
    four times; for few rows tr(G^2)^(1/2), in a tenth of the time (on the tracker's votes 1.08
    times the eigenvalue in the mean and 1.15 at most). A power iteration approaches the eigenvalue
    from below: a step from it may be too long, and its error depends on the eigenvalues.
    """
    scaled = problem.votes * jnp.sqrt(problem.weights)[:, None]
    if problem.counts.ndim == 1:
        gram = (scaled * problem.counts[None]) @ scaled.T
    else:
        products = scaled[:, None] * scaled[None]  # [L, L, M]
        gram = jnp.moveaxis(products @ problem.counts, -1, 0)
    if len(problem.labels) <= _FEW_ROWS:
        return jnp.sqrt(jnp.square(gram).sum((-2, -1)))
    log_bound = jnp.zeros(gram.shape[:-2], gram.dtype)
    for squaring in range(_SQUARINGS + 1):
        # Scaled by the trace, no power leaves the range of floats.
        trace = jnp.trace(gram, axis1=-2, axis2=-1)
        trace = jnp.maximum(trace, jnp.finfo(gram.dtype).tiny)
        log_bound += jnp.log(trace) / 2**squaring
        gram = gram / trace[..., None, None]
        gram = gram @ gram
    return jnp.exp(log_bound)
