"""Verification: is the object where the search has found it?"""

from typing import NamedTuple

import numpy as np

from .records import Floats, Verification

LEAST_SQUARE = 1e-6


class VerificationState(NamedTuple):
    """Templates of the object, unit vectors or a mean of them, and the frames since it was seen.

    initial, online: [D]. num_missed: frames in a row in which the object was not verified.
    """

    initial: Floats
    online: Floats
    num_missed: int


def init(description: Floats) -> VerificationState:
    """The state after the first frame; description: [D], of the initial box."""
    return VerificationState(description, description, 0)


def similarity(state: VerificationState, description: Floats, settings: Verification) -> float:
    """Cosine to the initial template, or that to the online one less the penalty if larger."""
    online = state.online / np.sqrt(state.online @ state.online + LEAST_SQUARE)
    to_online = online @ description - settings.template_penalty
    return max(float(state.initial @ description), float(to_online))


def score(similarity: float, settings: Verification) -> float:
    """The confidence in [0, 1]: the logistic function of a similarity."""
    return float(1 / (1 + np.exp(-settings.slope * (similarity - settings.middle))))


def step(state: VerificationState, confidence: float, settings: Verification) -> VerificationState:
    """The state with num_missed after a frame: 0 where the object is verified, else one more.

    One that is lost needs more than `recover_above` for that, any other more than `lost_below`.
    """
    least = settings.recover_above if is_lost(state, settings) else settings.lost_below
    return state._replace(num_missed=0 if confidence > least else state.num_missed + 1)


def update(
    state: VerificationState, description: Floats, settings: Verification
) -> VerificationState:
    """The state after a frame that is learned from: the online template is a running mean."""
    rate = settings.template_rate
    return state._replace(online=(1 - rate) * state.online + rate * description)


def is_lost(state: VerificationState, settings: Verification) -> bool:
    """Whether the object has been missed for `patience` frames in a row."""
    return state.num_missed >= settings.patience
