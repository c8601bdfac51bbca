"""Correlation filters: ridge regression over all shifts at once, in the Fourier domain.

Bolme et al., "Visual object tracking using adaptive correlation filters", CVPR 2010; with several
channels and a running mean of numerator and denominator as in Danelljan et al., "Accurate scale
estimation for robust visual tracking", BMVC 2014.
"""

from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex

from dcs_jax.types import ColourState, Filter, Scalar

_Learned = TypeVar("_Learned", Filter, ColourState)


def train(
    spectrum: Complex[Array, "D *frequencies"], desired: Complex[Array, "*frequencies"]
) -> Filter:
    """The filter whose response to the features of this spectrum is the desired output.

    spectrum: [D, ...], of the features. desired: [...], spectrum of the desired output.
    """
    power = jnp.square(spectrum.real) + jnp.square(spectrum.imag)
    return Filter(desired[None] * spectrum.conj(), power.sum(0))


def response(
    trained: Filter, spectrum: Complex[Array, "D *frequencies"], ridge: Scalar
) -> Complex[Array, "*frequencies"]:
    """Spectrum of the filter's response to features of this spectrum: [...].

    ridge: what is added to the power, so that noise in the weak frequencies does not respond.
    """
    power = (trained.denominator + ridge).astype(trained.numerator.dtype)
    return (trained.numerator * spectrum).sum(0) / power


def interpolate(old: _Learned, new: _Learned, rate: Scalar) -> _Learned:
    """The mean of two filters, or other records, the new one with the weight `rate`, in [0, 1]."""
    return jax.tree.map(
        lambda before, now: before + jnp.asarray(rate, before.dtype) * (now - before), old, new
    )


def hann(length: int) -> np.ndarray:
    """Hann window without its zeros: [length]."""
    return np.hanning(length + 2)[1:-1]
