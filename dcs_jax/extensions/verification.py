"""Verification: is the object where the search has found it?

The votes of the weak classifiers say where in a window the object most likely is, not whether it is
there at all: the best position of any window has a Noisy-OR near 1. So the patch at the candidate's
position is compared with templates of the object, and what is not verified is not learned.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from dcs_jax.config import Verification
from dcs_jax.types import VerificationState

_ROUNDING = 1e-6


def init(description: Float[Array, " D"]) -> VerificationState:
    """The state after the first frame, from the description of the initial box."""
    return VerificationState(description, description, jnp.zeros((), jnp.int32))


@jax.named_scope("verification")
def similarity(
    state: VerificationState, description: Float[Array, " D"], settings: Verification
) -> Float[Array, ""]:
    """How alike a patch is to the object's templates: [] in [-1, 1].

    The cosine to the initial template, or that to the online one less `template_penalty`.
    """
    online = state.online / jnp.sqrt(jnp.square(state.online).sum() + _ROUNDING)
    return jnp.maximum(
        (state.initial * description).sum(),
        (online * description).sum() - settings.template_penalty,
    )


def score(similarity: Float[Array, ""], settings: Verification) -> Float[Array, ""]:
    """The probability that the box overlaps the object by more than half: [] in [0, 1].

    A logistic function of the similarity, fitted to labelled tracks (see `Verification`).
    """
    return jax.nn.sigmoid(settings.slope * (similarity - settings.middle))


def step(
    state: VerificationState, confidence: Float[Array, ""], settings: Verification
) -> VerificationState:
    """The state with the frames in which the object was missed, 0 where it is verified.

    A lost object has to be verified as surely at its own position as elsewhere in the frame.
    """
    least = jnp.where(is_lost(state, settings), settings.recover_above, settings.lost_below)
    return state._replace(num_missed=jnp.where(confidence > least, 0, state.num_missed + 1))


def update(
    state: VerificationState, description: Float[Array, " D"], settings: Verification
) -> VerificationState:
    """The state after a frame that is learned from."""
    online = state.online + settings.template_rate * (description - state.online)
    return state._replace(online=online)


def is_lost(state: VerificationState, settings: Verification) -> Bool[Array, ""]:
    """Whether the object has been missed for `patience` frames: [] bool."""
    return state.num_missed >= settings.patience
