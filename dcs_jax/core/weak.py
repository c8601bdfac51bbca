"""Weak classifiers: a grey-level model of each class per feature (Algorithm 2, eq. 16)."""

import functools
import operator

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from dcs_jax.config import WeakRule
from dcs_jax.core.samples import LABELS, WEIGHTS
from dcs_jax.types import Pool, Weak

# The Kalman filter of on-line boosting (Grabner and Bischof, CVPR 2006).
_INITIAL_VARIANCE = 1000.0
_MEASUREMENT_VARIANCE = 0.01
_LEAST_GAIN = 0.001
_LEAST_SIGMA = 1.0


def init_weak(pool: Pool, rule: WeakRule) -> Weak:
    """The weak classifiers before the first update.

    The initial sigma is that of `boxes` independent sums of grey values uniform in 0..256.
    """
    features = pool.boxes.shape[0]
    sigma = jnp.sqrt(256.0**2 / 12 * pool.boxes.astype(jnp.float32))
    ones = jnp.ones(features, jnp.float32)
    return Weak(
        mean=jnp.zeros((2, features), jnp.float32),
        sigma=jnp.stack([sigma, sigma]) if rule == "gaussian" else None,
        variance=jnp.float32(_INITIAL_VARIANCE),
        correct=ones,
        wrong=ones,
    )


@jax.named_scope("weak classifiers")
def update_weak(weak: Weak, responses: Float[Array, "R F"]) -> tuple[Weak, Float[Array, "R F"]]:
    """Update the models with one frame's samples, then classify these and count (Algorithm 2).

    The means are Kalman-filtered sample by sample. The gain does not depend on the data: it is one
    scalar per sample for all features, about 1/t and then a floor.

    responses: [R, F], of the training patches. Returns the updated classifiers and their votes
        [R, F] in {-1, 1}.
    """
    mean, sigma, variance = weak.mean, weak.sigma, weak.variance
    for corner in range(1, len(LABELS)):
        # One sample of each class: the object's is the same each time.
        values = jnp.stack([responses[corner], responses[0]])  # [2, F]
        gain = jnp.maximum(variance / (variance + _MEASUREMENT_VARIANCE), _LEAST_GAIN)
        mean = mean + gain * (values - mean)
        if sigma is not None:
            square = gain * (values - mean) ** 2 + (1 - gain) * sigma**2
            sigma = jnp.maximum(jnp.sqrt(square), _LEAST_SIGMA)
        variance = variance * _MEASUREMENT_VARIANCE / (variance + _MEASUREMENT_VARIANCE)
    votes = vote(responses, mean, sigma)
    samples = sum(WEIGHTS)
    agreement = agreement_with_labels(votes)
    weak = Weak(
        mean=mean,
        sigma=sigma,
        variance=variance,
        correct=weak.correct + (samples + agreement) / 2,
        wrong=weak.wrong + (samples - agreement) / 2,
    )
    return weak, votes


def agreement_with_labels(votes: Float[Array, "R *classifiers"]) -> Float[Array, "*classifiers"]:
    """Samples on which each classifier is right less those on which it is wrong: [...].

    votes: [R, ...] in {-1, 1}, on the training patches.
    """
    # Unrolled: a matrix product of so few rows takes longer.
    counted = (
        weight * label * row for weight, label, row in zip(WEIGHTS, LABELS, votes, strict=True)
    )
    return functools.reduce(operator.add, counted)


def vote(
    responses: Float[Array, "*shape"],
    mean: Float[Array, "2 *classifiers"],
    sigma: Float[Array, "2 *classifiers"] | None,
) -> Float[Array, "*shape"]:
    """The classifiers' decisions on responses [...]: -1 (background) or 1 (object), ties 1.

    mean, sigma: [2, ...], of background and object. Without sigma the class whose mean is nearer
    decides, with sigma the likelier one (eq. 16).
    """
    background, target = (_align(center, responses) for center in mean)
    if sigma is None:
        decision = (responses - (background + target) / 2) * (target - background)
    else:
        log_density = [
            -0.5 * ((responses - center) / width) ** 2 - jnp.log(width)
            for center, width in (
                (background, _align(sigma[0], responses)),
                (target, _align(sigma[1], responses)),
            )
        ]
        decision = log_density[1] - log_density[0]
    return jnp.where(decision >= 0, jnp.float32(1), jnp.float32(-1))


def _align(
    values: Float[Array, "*classifiers"], responses: Float[Array, "*shape"]
) -> Float[Array, "*aligned"]:
    """The values with leading axes of length 1 for those that only the responses have."""
    return values.reshape((1,) * (responses.ndim - values.ndim) + values.shape)


def error(weak: Weak) -> Float[Array, " F"]:
    """Share of all training samples so far that each classifier got wrong: [F] in (0, 1)."""
    return weak.wrong / (weak.wrong + weak.correct)
