"""What `dcs_jax` holds, stored for speed, as the reference has it.

Features: dcs_jax has f = (m, k, n) along the last axis, the reference f = (k, n, m) along the
first. Filters: dcs_jax has half of the frequencies along the last axis, the reference has all.
"""

import dataclasses
from typing import Any

import numpy as np
import reference
from reference.colour import ColourState
from reference.filters import Filter
from reference.rotation import RotationState
from reference.translation import TranslationState
from reference.verification import VerificationState

import dcs_jax
from dcs_jax.config import Config
from dcs_jax.types import Filter as HalfFilter
from dcs_jax.types import Pool

_GROUPS: dict[str, Any] = {
    "translation": reference.TranslationFilter,
    "colour": reference.ColourHistograms,
    "scale": reference.ScaleFilter,
    "verification": reference.Verification,
    "aspect": reference.AspectRatio,
    "rotation": reference.RotationFilter,
    "redetection": reference.Redetection,
}


def in_reference_order(values, config: Config) -> np.ndarray:
    """Values [..., F] of the features of `dcs_jax`, as the reference has them: [F, ...]."""
    values = np.asarray(values)
    values = values.reshape(-1, config.pool_size, config.parts * config.selectors)
    ordered = values.transpose(2, 1, 0).reshape(-1, values.shape[0])
    return ordered if ordered.shape[1] > 1 else ordered[:, 0]


def reference_pool(pool: Pool, config: Config) -> reference.Pool:
    """The same features as weighted corners."""
    return reference.Pool(
        in_reference_order(pool.corners, config),
        in_reference_order(np.asarray(pool.coefficients, float) * np.asarray(pool.scale), config),
        in_reference_order(pool.boxes, config),
    )


def reference_settings(config: Config) -> reference.Settings:
    """The same settings, in groups of the same names."""
    names = {field.name for field in dataclasses.fields(reference.Settings)} - {"initial_size"}
    fields = {name: getattr(config, name) for name in names}
    for name, group in _GROUPS.items():
        if fields[name] is not None:
            fields[name] = group(**dataclasses.asdict(fields[name]))
    return reference.Settings(**fields)


def reference_filter(half: HalfFilter, shape: tuple[int, ...]) -> Filter:
    """The same filter over a signal of this shape, with all of its frequencies.

    Numerator and denominator are spectra of real signals, of which a half says all.
    """
    numerator, denominator = (np.asarray(part, np.complex128) for part in half)
    axes = tuple(range(-len(shape), 0))
    whole = [
        np.fft.fftn(np.fft.irfftn(part, shape, axes), axes=axes)
        for part in (numerator, denominator)
    ]
    return Filter(whole[0], whole[1].real)


def reference_at(state: dcs_jax.State, config: Config) -> reference.Tracker:
    """The reference, set up with the state of a JAX track."""
    weak, grid = state.weak, config.grid
    tracker = reference.Tracker(
        reference_settings(config),
        state.box,
        state.initial_size,
        reference_pool(state.pool, config),
        in_reference_order(weak.mean, config),
        None if weak.sigma is None else in_reference_order(weak.sigma, config),
        weak.variance,
        in_reference_order(weak.correct, config),
        in_reference_order(weak.wrong, config),
        state.strong.selected,
        state.strong.alpha,
    )
    if state.translation:
        side = reference.translation.cell_side(tracker.settings.grid)
        shape = tuple(cells // side for cells in grid.window)
        tracker.translation = TranslationState(
            *(reference_filter(part, shape) for part in state.translation)
        )
    if state.colour:
        inside, outside, colourful = state.colour
        tracker.colour = ColourState(
            np.asarray(inside, float), np.asarray(outside, float), float(colourful)
        )
    if state.scale and config.scale:
        tracker.scale = reference_filter(state.scale, (config.scale.num_scales,))
    if state.rotation:
        tracker.rotation = RotationState(
            float(state.rotation.angle),
            float(state.rotation.gain),
            reference_filter(state.rotation.first_frame, (reference.rotation.ANGLES,)),
        )
    if state.verification:
        initial, online, recent, box, num_missed, num_rested = state.verification
        tracker.verification = VerificationState(
            np.asarray(initial, float),
            np.asarray(online, float),
            np.asarray(recent, float),
            np.asarray(box, float),
            int(num_missed),
            int(num_rested),
        )
    return tracker
