"""The scale filter: a one-dimensional correlation filter over scales of the object's patch.

Danelljan et al., "Accurate scale estimation for robust visual tracking", BMVC 2014 (DSST).
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from dcs_jax.config import ScaleFilter
from dcs_jax.core.search import parabola_peak
from dcs_jax.extensions import filters
from dcs_jax.types import Filter

# Standard deviation of the desired output, as a share of the root of the number of scales (DSST).
_SIGMA = 0.25
# Ridge, as it is, since descriptions are unit vectors.
_RIDGE = 0.01
# The object is not followed to a size below this, pixels: there is nothing left to see.
_LEAST_SIDE = 8.0


def factors(settings: ScaleFilter | None) -> np.ndarray:
    """Height and width of the scales to compare, the present one in the middle: [S, 2].

    Relative to the present one; that alone without a scale filter.
    """
    if settings is None:
        return np.ones((1, 2))
    scales = settings.step ** (np.arange(settings.num_scales) - settings.num_scales // 2.0)
    return np.stack([scales, scales], axis=1)


def init(descriptions: Float[Array, "S D"]) -> Filter:
    """The filter that responds at the middle of these scales: [D, S/2 + 1] and [S/2 + 1].

    descriptions: [S, D], of the object's patch at S scales, its own in the middle.
    """
    count = len(descriptions)
    steps = np.arange(count) - count // 2
    desired = np.fft.rfft(np.exp(-0.5 * np.square(steps / (_SIGMA * np.sqrt(count)))))
    return filters.train(_spectrum(descriptions), jnp.asarray(desired, jnp.complex64))


@jax.named_scope("scale")
def estimate(state: Filter, descriptions: Float[Array, "S D"]) -> Float[Array, ""]:
    """By how many steps the object has grown: [], between -S/2 and S/2, by a parabola's peak."""
    spectrum = filters.response(state, _spectrum(descriptions), _RIDGE)
    # The frequencies that a real response does not need count in the others.
    twice = np.where(np.arange(spectrum.shape[0]) == 0, 1, 2)[:, None]
    waves = _waves(len(descriptions)).conj() * twice / len(descriptions)
    response = spectrum.real @ jnp.asarray(waves.real, jnp.float32)
    response -= spectrum.imag @ jnp.asarray(waves.imag, jnp.float32)
    best = jnp.argmax(response[1:-1]).astype(jnp.int32) + 1
    offset = parabola_peak(response[best - 1], response[best], response[best + 1])
    return best.astype(jnp.float32) - len(descriptions) // 2 + offset


@jax.named_scope("scale")
def update(state: Filter, descriptions: Float[Array, "S D"], settings: ScaleFilter) -> Filter:
    """The filter after one more frame."""
    return filters.interpolate(state, init(descriptions), settings.learning_rate)


def pull(
    box: Float[Array, "4"],
    initial_size: Float[Array, "2"],
    similarity: Float[Array, ""],
    settings: ScaleFilter,
) -> Float[Array, ""]:
    """Steps back towards the initial scale: [], the more the less the object is alike.

    Small errors of the estimates would add up.
    """
    grown = 0.5 * jnp.log(box[2:] / initial_size).sum() / jnp.log(settings.step)
    return settings.initial_pull * (1 - similarity) * grown


def resize(
    box: Float[Array, "4"],
    steps: Float[Array, ""],
    frame_shape: tuple[int, ...],
    settings: ScaleFilter,
) -> Float[Array, "4"]:
    """The box so many steps larger around the same centre, at least 8 px, at most the frame."""
    x, y, w, h = box
    least = _LEAST_SIDE / jnp.minimum(w, h)
    most = jnp.minimum(frame_shape[1] / w, frame_shape[0] / h)
    # An initial box that is smaller or larger than that may still stay as it is.
    factor = jnp.clip(settings.step**steps, jnp.minimum(least, 1), jnp.maximum(most, 1))
    return jnp.stack([x + w * (1 - factor) / 2, y + h * (1 - factor) / 2, w * factor, h * factor])


def _spectrum(descriptions: Float[Array, "S D"]) -> Complex[Array, "D half"]:
    """Spectrum of the descriptions over the scales, faded out towards both ends: [D, S/2 + 1].

    By a product with the waves: of so few scales, in a third of the time of an FFT.
    """
    waves = _waves(len(descriptions)) * filters.hann(len(descriptions))
    real, imaginary = (
        (jnp.asarray(part, jnp.float32) @ descriptions).T for part in (waves.real, waves.imag)
    )
    return jax.lax.complex(real, imaginary)


def _waves(count: int) -> np.ndarray:
    """The waves of a discrete Fourier transform, of the frequencies from 0: [S/2 + 1, S]."""
    return np.exp(-2j * np.pi * np.outer(np.arange(count // 2 + 1), np.arange(count)) / count)
