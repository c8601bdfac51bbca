"""The weak classifier that each selector takes from its pool (Algorithm 2, eq. 14 and 15)."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int32

from dcs_jax.config import Config
from dcs_jax.core.samples import LABELS, WEIGHTS
from dcs_jax.core.weak import agreement_with_labels
from dcs_jax.solvers import apg
from dcs_jax.solvers.problem import Problem
from dcs_jax.solvers.ties import first_maximum, first_true, is_maximum


@jax.named_scope("selection")
def select(
    votes: Float[Array, "R M K N"], error: Float[Array, "M K N"], config: Config
) -> tuple[Int32[Array, "K N"], Float[Array, " R"]]:
    """Choose a classifier for each selector: [K, N] int32 in [0, M), and the label noise: [R].

    The noise is e of eq. 14, the model's correction of each sample's label, in the mean over the
    selectors; 0 where the selector is not "l1".

    votes: [R, M, K, N] in {-1, 1}, the classifiers' votes on this frame's training patches.
    error: [M, K, N], share of all training samples so far that they got wrong.
    """
    no_noise = jnp.zeros(len(votes), votes.dtype)
    match config.selector:
        case "error":
            return first_maximum(-error), no_noise
        case "first":
            return first_maximum(agreement_with_labels(votes)), no_noise
        case "mil":
            return jax.vmap(_most_likely_bag, in_axes=2)(votes), no_noise
        case "l1":
            return _l1(votes, error, config)


def _l1(
    votes: Float[Array, "R M K N"], error: Float[Array, "M K N"], config: Config
) -> tuple[Int32[Array, "K N"], Float[Array, " R"]]:
    """Non-negative l1 minimisation with label noise, all K * N problems at once: [K, N] and [R].

    On R distinct patches at most 2^R columns differ: each problem is solved for those with their
    counts (32 columns instead of the paper's 200: five times faster, the same coefficients). The
    problems lie along the minor axis throughout.
    """
    patches, pool_size, *_ = votes.shape
    bits = np.arange(2**patches) >> np.arange(patches)[:, None] & 1
    patterns = jnp.asarray(np.where(bits, 1.0, -1.0), votes.dtype)  # [R, 2^R]
    codes = sum((row > 0).astype(jnp.int32) << bit for bit, row in enumerate(votes))
    codes = codes.reshape(pool_size, -1)  # [M, K * N], which pattern each classifier votes
    problems = codes.shape[1]
    counts = jnp.zeros((2**patches, problems), votes.dtype).at[codes, np.arange(problems)].add(1.0)

    problem = Problem(
        patterns,
        counts,
        jnp.asarray(LABELS, jnp.float32),
        jnp.asarray(WEIGHTS, jnp.float32),
        config.lam,
    )
    solution = apg.solve(problem, config.iterations)
    beta = jnp.where(counts > 0, solution.beta, 0)  # [2^R, K * N]
    # Where the penalty leaves no classifier, the best correlated one is taken.
    scores = jnp.where(
        beta.max(0, keepdims=True) > 0, beta, agreement_with_labels(patterns)[:, None]
    )
    best = is_maximum(jnp.where(counts > 0, scores, -jnp.inf))
    # Of each problem, the best patterns are the bits of one number: a shift instead of a gather.
    bit = jnp.uint32(1) << jnp.arange(2**patches, dtype=jnp.uint32)[:, None]
    best = jnp.where(best, bit, jnp.uint32(0)).sum(0, dtype=jnp.uint32)
    chosen = ((best[None] >> codes.astype(jnp.uint32)) & 1 == 1).reshape(error.shape)
    if config.tie == "error":
        return first_maximum(jnp.where(chosen, -error, -jnp.inf)), solution.noise.mean(1)
    return first_true(chosen), solution.noise.mean(1)


def _most_likely_bag(votes: Float[Array, "R M N"]) -> Int32[Array, " N"]:
    """Greedy choice by the likelihood of the bags (Babenko et al., CVPR 2009, Algorithm 2): [N].

    votes: [R, M, N] of one part. The samples of the tracked box are one positive bag, every other
    sample is a negative bag of its own; a sample's probability is the logistic function of the
    summed votes.
    """
    weights = jnp.asarray(WEIGHTS, jnp.float32)[:, None]

    def choose(
        strong: Float[Array, " R"], candidates: Float[Array, "R M"]
    ) -> tuple[Float[Array, " R"], Int32[Array, ""]]:
        log_miss = -weights * jax.nn.softplus(strong[:, None] + candidates)  # log prod (1 - p)
        likelihood = jnp.log(-jnp.expm1(log_miss[0])) + log_miss[1:].sum(0)
        index = first_maximum(likelihood)
        return strong + candidates[:, index], index

    one_by_one = jnp.moveaxis(votes, 2, 0)
    return jax.lax.scan(choose, jnp.zeros(len(votes), jnp.float32), one_by_one)[1]
