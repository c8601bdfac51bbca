"""Correlation filters: ridge regression over all shifts of an example, in the Fourier domain.

Bolme et al., "Visual object tracking using adaptive correlation filters", CVPR 2010; with D
channels, Danelljan et al., "Accurate scale estimation for robust visual tracking", BMVC 2014. All
frequencies of a spectrum are kept, along one axis or two.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .records import Floats

Spectrum = NDArray[np.complex128]


class Filter(NamedTuple):
    """One filter, numerator [D, ...] over denominator [...]."""

    numerator: Spectrum
    denominator: Floats


def hann(length: int) -> Floats:
    """A Hann window [length] without its two zeros."""
    return np.array([np.sin(np.pi * (i + 1) / (length + 1)) ** 2 for i in range(length)])


def spectrum(features: Floats) -> Spectrum:
    """Discrete Fourier transform of each channel of features [D, ...]."""
    return np.fft.fftn(features, axes=range(1, features.ndim))


def train(features: Floats, desired: Floats) -> Filter:
    """The filter of one example: G conj(F^l) over sum_l F^l conj(F^l).

    features: [D, ...], with the spectra F^l. desired: [...], the desired output, its peak at index
    0, with the spectrum G.
    """
    f = spectrum(features)
    return Filter(np.fft.fftn(desired) * f.conj(), (np.abs(f) ** 2).sum(axis=0))


def response(trained: Filter, features: Floats, ridge: float) -> Spectrum:
    """Spectrum [...] of the response to features [D, ...]; ridge is added to the denominator."""
    total = (trained.numerator * spectrum(features)).sum(axis=0)
    return total / (trained.denominator + ridge)


def interpolate(old: Filter, new: Filter, rate: float) -> Filter:
    """The mean of two filters, the new one with the weight `rate`."""
    return Filter(
        (1 - rate) * old.numerator + rate * new.numerator,
        (1 - rate) * old.denominator + rate * new.denominator,
    )
