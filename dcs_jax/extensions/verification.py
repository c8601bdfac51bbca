"""Verification: is the object where the search has found it?

The votes of the weak classifiers say where in a window the object most likely is, not whether it is
there at all: the best position of any window has a Noisy-OR near 1. So the patch at the candidate's
position is compared with templates of the object, and what is not verified is not learned.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from dcs_jax.config import Verification
from dcs_jax.types import Scalar, VerificationState

_ROUNDING = 1e-6


def init(description: Float[Array, " D"], box: Float[Array, "4"]) -> VerificationState:
    """The state after the first frame, from the initial box and its description."""
    none = jnp.zeros((), jnp.int32)
    return VerificationState(description, description, description, box, none, none)


@jax.named_scope("verification")
def similarity(
    state: VerificationState, description: Float[Array, " D"], settings: Verification
) -> Float[Array, ""]:
    """How alike a patch is to what the object is known to look like: [] in [-1, 1].

    The cosine to the initial template, or that to the online one less `template_penalty`.
    """
    online = state.online / jnp.sqrt(jnp.square(state.online).sum() + _ROUNDING)
    return jnp.maximum(
        (state.initial * description).sum(),
        (online * description).sum() - settings.template_penalty,
    )


@jax.named_scope("verification")
def recent_similarity(
    state: VerificationState, description: Float[Array, " D"], settings: Verification
) -> Float[Array, ""]:
    """How alike a patch is to what was followed of late: [] in [-1, 1].

    `similarity` with the recent template in place of the online one.
    """
    return similarity(state._replace(online=state.recent), description, settings)


def score(similarity: Float[Array, ""], settings: Verification) -> Float[Array, ""]:
    """The probability that the box overlaps the object by more than half: [] in [0, 1].

    A logistic function of the similarity, fitted to labelled tracks (see `Verification`).
    """
    return jax.nn.sigmoid(settings.slope * (similarity - settings.middle))


def combine(
    confidence: Float[Array, ""], responses: Float[Array, ""], settings: Verification
) -> Float[Array, ""]:
    """The same probability from the responses of the translation filter, too: [] in [0, 1].

    The filter sees what is around the object, and what was learned of late. Where it responds, an
    object that has turned is more likely still there; where it does not, what looks like the object
    is less likely the same. What is done about the object is by the similarity alone.

    responses: as of `translation.responses`.
    """
    slope = jnp.maximum(settings.slope, _ROUNDING)
    similarity = (jnp.log(confidence) - jnp.log1p(-confidence)) / slope  # above `middle`
    evidence = jnp.clip(similarity, -2, 2) + responses - settings.response_middle
    return jax.nn.sigmoid(settings.response_slope * evidence)


def is_missed(
    state: VerificationState, followed: Float[Array, ""], settings: Verification
) -> Bool[Array, ""]:
    """Whether the object is not verified: [] bool.

    One that was missed for some frames has to be recognised surely, a lost one as surely at its own
    position as elsewhere in the frame.

    followed: confidence by `recent_similarity`.
    """
    return followed <= _needed(state, settings.lost_below, settings)


def may_learn(
    state: VerificationState, followed: Float[Array, ""], settings: Verification
) -> Bool[Array, ""]:
    """Whether a frame is learned from: [] bool.

    A change is followed as far as it is gradual: one that was missed for some frames is behind
    something, or gone. What is followed of a lost one would be learned until it is recognised.
    """
    return followed > _needed(state, settings.learn_above, settings)


def may_rest(
    state: VerificationState, confidence: Float[Array, ""], settings: Verification
) -> Bool[Array, ""]:
    """Whether classifiers and filters do without a frame: [] bool.

    Neighbouring frames in which the object is recognised surely teach the same.

    confidence: of the candidate.
    """
    return (confidence > settings.rest_above) & (state.num_rested + 1 < settings.learn_every)


def update(
    state: VerificationState,
    description: Float[Array, " D"],
    box: Float[Array, "4"],
    rests: Bool[Array, ""],
    settings: Verification,
) -> tuple[VerificationState, Float[Array, ""], Bool[Array, ""]]:
    """The state after a frame whose box looks so, its confidence, and whether it may be learned.

    rests: whether classifiers and filters do without it.

    The confidence is by the templates of frames in which the object was surely recognised; what is
    done about the object, by the recent one too.
    """
    confidence = score(similarity(state, description, settings), settings)
    followed = score(recent_similarity(state, description, settings), settings)
    missed = is_missed(state, followed, settings)
    learn = may_learn(state, followed, settings)

    def learned(
        template: Float[Array, " D"], condition: Bool[Array, ""], rate: Scalar
    ) -> Float[Array, " D"]:
        return jnp.where(condition, template + rate * (description - template), template)

    after = VerificationState(
        state.initial,
        learned(state.online, ~missed & (confidence > settings.sure_above), settings.template_rate),
        learned(state.recent, learn, settings.recent_rate),
        jnp.where(missed, state.box, box),
        jnp.where(missed, state.num_missed + 1, 0),
        jnp.where(rests, state.num_rested + 1, 0),
    )
    return after, confidence, learn


def is_lost(state: VerificationState, settings: Verification) -> Bool[Array, ""]:
    """Whether the object has been missed for `patience` frames: [] bool."""
    return state.num_missed >= settings.patience


def _needed(state: VerificationState, held: Scalar, settings: Verification) -> Float[Array, ""]:
    """The confidence that an object needs: `held`, but for one that was missed for some frames."""
    in_doubt = jnp.where(2 * state.num_missed > settings.patience, settings.sure_above, held)
    return jnp.where(is_lost(state, settings), settings.recover_above, in_doubt)
