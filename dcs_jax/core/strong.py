"""The strong part classifiers, weighted sums of the selected weak ones (Algorithm 2)."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int32

from dcs_jax.types import Strong


@jax.named_scope("strong classifiers")
def combine(selected: Int32[Array, "K N"], error: Float[Array, "M K N"]) -> Strong:
    """Weight the selected classifiers by alpha = max(0, ln((1 - e) / e)).

    selected: [K, N] int32 in [0, M). error: [M, K, N] in (0, 1), of all classifiers.
    """
    chosen = jnp.take_along_axis(error, selected[None], axis=0)[0]
    return Strong(selected=selected, alpha=jnp.maximum(jnp.log((1 - chosen) / chosen), 0))
