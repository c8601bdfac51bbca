"""Tie rules: which of several equally good classifiers is taken."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32

# Equal columns get equal coefficients up to rounding: maxima within this fraction are a tie.
TIE_TOLERANCE = 1e-3


def first_maximum(scores: Float[Array, "M *selectors"]) -> Int32[Array, "*selectors"]:
    """Index of the first maximum along the first axis, up to a relative tolerance: [...] int32.

    The order decides which of several equal classifiers is taken, and the tracker depends on it.
    With the first index among those without an error on this frame the success rate is 0.88, with
    the least accumulated error among them, which prefers the same few in every frame, 0.61.
    """
    return first_true(is_maximum(scores))


def is_maximum(scores: Float[Array, "M *selectors"]) -> Bool[Array, "M *selectors"]:
    """Which scores are maxima along the first axis, up to a relative tolerance: [M, ...]."""
    best = scores.max(0, keepdims=True)
    return scores >= best - TIE_TOLERANCE * jnp.abs(best)


def first_true(chosen: Bool[Array, "M *selectors"]) -> Int32[Array, "*selectors"]:
    """Index of the first True along the first axis: [...] int32."""
    # On the CPU a minimum along contiguous memory is vectorised, an argmax is not.
    index = jnp.arange(len(chosen), dtype=jnp.int32).reshape(-1, *(1,) * (chosen.ndim - 1))
    return jnp.where(chosen, index, len(chosen)).min(0)
