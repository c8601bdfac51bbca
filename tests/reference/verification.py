"""Verification: is the object where the search has found it?"""

from typing import NamedTuple

import numpy as np

from .records import Floats, Verification

LEAST_SQUARE = 1e-6


class VerificationState(NamedTuple):
    """Templates of the object, unit vectors or a mean of them, and where and when it was seen.

    initial, online, recent: [D]. box: [4], of the last frame in which it was verified.
    num_missed: frames in a row in which the object was not verified. num_rested: frames since the
    last one of which classifiers and filters have learned, or would have.
    """

    initial: Floats
    online: Floats
    recent: Floats
    box: Floats
    num_missed: int
    num_rested: int


def init(description: Floats, box: Floats) -> VerificationState:
    """The state after the first frame; description: [D], of the initial box [4]."""
    return VerificationState(description, description, description, box, 0, 0)


def similarity(state: VerificationState, description: Floats, settings: Verification) -> float:
    """Cosine to the initial template, or that to the online one less the penalty if larger."""
    online = state.online / np.sqrt(state.online @ state.online + LEAST_SQUARE)
    to_online = online @ description - settings.template_penalty
    return max(float(state.initial @ description), float(to_online))


def recent_similarity(
    state: VerificationState, description: Floats, settings: Verification
) -> float:
    """The same with the recent template in place of the online one."""
    return similarity(state._replace(online=state.recent), description, settings)


def score(similarity: float, settings: Verification) -> float:
    """The confidence in [0, 1]: the logistic function of a similarity."""
    return float(1 / (1 + np.exp(-settings.slope * (similarity - settings.middle))))


def combine(confidence: float, responses: float, settings: Verification) -> float:
    """The confidence with the responses of the translation filter added to the similarity."""
    similarity = np.log(confidence / (1 - confidence)) / settings.slope  # less the middle
    evidence = similarity + responses - settings.response_middle
    return float(1 / (1 + np.exp(-settings.response_slope * evidence)))


def is_missed(state: VerificationState, followed: float, settings: Verification) -> bool:
    """Whether the object is not verified by the confidence of what was followed of late.

    One that is lost needs more than `recover_above`, one that was missed for more than half of the
    frames until then more than `sure_above`, any other more than `lost_below`.
    """
    least = settings.sure_above if in_doubt(state, settings) else settings.lost_below
    return followed <= (settings.recover_above if is_lost(state, settings) else least)


def may_learn(state: VerificationState, followed: float, settings: Verification) -> bool:
    """Whether a frame is learned from.

    In doubt only where the object is surely recognised, and lost only where it is held again.
    """
    least = settings.sure_above if in_doubt(state, settings) else settings.learn_above
    return followed > (settings.recover_above if is_lost(state, settings) else least)


def may_rest(state: VerificationState, confidence: float, settings: Verification) -> bool:
    """Whether classifiers and filters do without a frame in which the object is recognised surely.

    They learn from one of `learn_every` of such frames in a row.
    """
    return confidence > settings.rest_above and state.num_rested + 1 < settings.learn_every


def update(
    state: VerificationState,
    description: Floats,
    box: Floats,
    rests: bool,
    settings: Verification,
) -> tuple[VerificationState, float, bool]:
    """The state after a frame, the confidence, and whether the rest learns from the frame.

    description: [D], of the candidate, which has this box [4]. rests: whether the rest does not
    learn from the frame anyway.

    The online template is a running mean of what was surely recognised by it and the initial one,
    the recent one of all that was learned from.
    """
    confidence = score(similarity(state, description, settings), settings)
    followed = score(recent_similarity(state, description, settings), settings)
    learn = may_learn(state, followed, settings)
    online, recent = state.online, state.recent
    missed = is_missed(state, followed, settings)
    if confidence > settings.sure_above and not missed:
        rate = settings.template_rate
        online = (1 - rate) * online + rate * description
    if learn:
        rate = settings.recent_rate
        recent = (1 - rate) * recent + rate * description
    after = VerificationState(
        state.initial,
        online,
        recent,
        state.box if missed else box,
        state.num_missed + 1 if missed else 0,
        state.num_rested + 1 if rests else 0,
    )
    return after, confidence, learn


def in_doubt(state: VerificationState, settings: Verification) -> bool:
    """Whether the object has been missed for more than half of the frames until it is lost."""
    return 2 * state.num_missed > settings.patience


def is_lost(state: VerificationState, settings: Verification) -> bool:
    """Whether the object has been missed for `patience` frames in a row."""
    return state.num_missed >= settings.patience
