"""Which weak classifier each selector takes from its pool (Algorithm 2, eq. 14 and 15)."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32

from dcs_jax.config import Config
from dcs_jax.core import apg
from dcs_jax.core.samples import LABELS, WEIGHTS

# Equal columns get equal coefficients up to rounding: maxima within this fraction are a tie.
TIE_TOLERANCE = 1e-3


def select(
    votes: Float[Array, "K N M R"], error: Float[Array, "K N M"], config: Config
) -> Int32[Array, "K N"]:
    """Choose a classifier for each selector: [K, N] int32 in [0, M).

    votes: [K, N, M, R] in {-1, 1}, the classifiers' votes on this frame's rows.
    error: [K, N, M], the fraction of all rows so far that they got wrong.
    """
    labels, weights = jnp.asarray(LABELS), jnp.asarray(WEIGHTS)
    agreement = votes @ (weights * labels)  # [K, N, M]
    match config.selector:
        case "error":
            scores = -error
        case "first":
            scores = agreement
        case "mil":
            return jax.vmap(_most_likely_bag)(votes)
        case "l1":
            return _l1(votes, config)
    return first_maximum(scores)


def _l1(votes: Float[Array, "K N M R"], config: Config) -> Int32[Array, "K N"]:
    """Non-negative l1 minimisation with label noise, all K * N problems at once: [K, N].

    R distinct rows leave 2^R columns that differ: each problem is solved for those with their
    counts (32 columns instead of the paper's 200: five times faster, the same coefficients).
    """
    rows = votes.shape[-1]
    bits = 1 << np.arange(rows)
    patterns = jnp.asarray(np.where(np.arange(2**rows)[:, None] & bits, 1.0, -1.0), votes.dtype)
    codes = jnp.where(votes > 0, jnp.asarray(bits, jnp.int32), 0).sum(-1)  # [K, N, M]
    labels, weights = jnp.asarray(LABELS), jnp.asarray(WEIGHTS)

    def score(counts: Float[Array, " patterns"]) -> Float[Array, " patterns"]:
        problem = apg.Problem(patterns, counts, labels, weights, config.lam)
        beta = jnp.where(counts > 0, apg.solve(problem, config.iterations).beta, 0)
        # Where the penalty leaves no classifier, the best correlated one stands in.
        return jnp.where(beta.max() > 0, beta, patterns @ (weights * labels))

    count = jax.vmap(lambda codes: jnp.zeros(2**rows, votes.dtype).at[codes].add(1.0))
    counts = count(codes.reshape(-1, codes.shape[-1]))  # [K * N, 2^R]
    # With the problems along the minor axis, the solver's products take two thirds of the time.
    scores = jax.vmap(score, in_axes=1, out_axes=1)(counts.T).T
    scores = scores.reshape(*codes.shape[:-1], 2**rows)
    return first_maximum(jnp.take_along_axis(scores, codes, axis=-1))


def first_maximum(scores: Float[Array, "*selectors M"]) -> Int32[Array, "*selectors"]:
    """Index of the first maximum along the last axis, up to a relative tolerance: [...] int32.

    The order decides which of several equal classifiers is taken, and the tracker lives on it: the
    first index among those without an error on this frame tracks, the least accumulated error
    among them loses the target.
    """
    return jnp.argmax(is_maximum(scores), axis=-1).astype(jnp.int32)


def is_maximum(scores: Float[Array, "*selectors M"]) -> Bool[Array, "*selectors M"]:
    """Which scores are maxima along the last axis, up to a relative tolerance: [..., M]."""
    best = scores.max(-1, keepdims=True)
    return scores >= best - TIE_TOLERANCE * jnp.abs(best)


def _most_likely_bag(votes: Float[Array, "N M R"]) -> Int32[Array, " N"]:
    """Greedy choice by the likelihood of the bags (Babenko et al., CVPR 2009, Algorithm 2): [N].

    votes: [N, M, R] of one part. The rows of the tracked box are one positive bag, every other row
    is a negative bag of its own; a row's probability is the logistic function of the summed votes.
    """
    weights = jnp.asarray(WEIGHTS)

    def choose(
        strong: Float[Array, " R"], candidates: Float[Array, "M R"]
    ) -> tuple[Float[Array, " R"], Int32[Array, ""]]:
        log_miss = -weights * jax.nn.softplus(strong + candidates)  # log prod (1 - p), [M, R]
        positive = jnp.log(-jnp.expm1(log_miss[:, 0]))
        likelihood = positive + log_miss[:, 1:].sum(-1)
        index = first_maximum(likelihood)
        return strong + candidates[index], index

    return jax.lax.scan(choose, jnp.zeros(votes.shape[-1]), votes)[1]
