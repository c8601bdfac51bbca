"""The records that pass between the functions: NamedTuples of arrays, so every one is a pytree.

Dimensions, used in every docstring and shape comment of the library:

    T  frames                              H, W  rows and columns of a frame, pixels
    K  parts of the object                 N  selectors per part
    M  weak classifiers in a selector's pool, all different features
    F  = M * K * N, all features of a track, in this order: what is done for each selector at
       once then runs along contiguous memory
    R  distinct training patches of a frame (5); they are L = 8 samples, one of them four times
    G  cells per side of a window          C  candidate positions per axis
    S  scales of the object                D  values of a description
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Bool, Complex, Float, Int8, Int32, Integer, UInt8

# A number of the settings, in float32 whatever JAX's settings are (`single_precision`).
Scalar = float | np.floating | Float[Array, ""]
Frame = UInt8[Array, "H W *channels"]
Frames = UInt8[Array, "T H W *channels"]
# What users may pass; shapes and values are checked with errors of our own.
ImageLike = jax.Array | np.ndarray
BoxLike = jax.Array | np.ndarray | Sequence[float]


class Pool(NamedTuple):
    """Haar-like features, each the weighted sum of at most 9 corners of an integral image.

    The largest arrays of a state, in the smallest types: reading them takes a good part of a step.

    corners: [9, F] uint16 (int32 where a patch has more cells), flat index of the corner in a
        patch's integral image, whose rows are one longer than the object's canvas is wide. Unused
        corners repeat the first.
    coefficients: [9, F] int8, what each corner counts; 0 where unused.
    scale: [F] float32, what the sum is multiplied with: one over the cells of the base block.
    boxes: [F] int32, number of boxes the feature compares (2, 3 or 4).
    """

    corners: Integer[Array, "9 F"]
    coefficients: Int8[Array, "9 F"]
    scale: Float[Array, " F"]
    boxes: Int32[Array, " F"]


class Weak(NamedTuple):
    """The weak classifiers: one Kalman-filtered grey-level model per feature and class.

    mean: [2, F] float32, mean response on the background (row 0) and on the object (row 1).
    sigma: [2, F] float32, its standard deviation, or None with `weak="midpoint"`.
    variance: [] float32, variance P of the estimated means: it does not depend on the data, so
        all features of both classes share it.
    correct, wrong: [F] float32, number of training samples classified right and wrong so far,
        each counted from 1 (lambda_c and lambda_w of online boosting).
    """

    mean: Float[Array, "2 F"]
    sigma: Float[Array, "2 F"] | None
    variance: Float[Array, ""]
    correct: Float[Array, " F"]
    wrong: Float[Array, " F"]


class Strong(NamedTuple):
    """The K strong part classifiers, H^k = sum_n alpha h / sum_n alpha.

    selected: [K, N] int32 in [0, M), the weak classifier each selector has chosen from its pool.
    alpha: [K, N] float32, its voting weight, not negative.
    """

    selected: Int32[Array, "K N"]
    alpha: Float[Array, "K N"]


class Filter(NamedTuple):
    """A correlation filter over one or two axes, numerator over denominator for each frequency.

    The last axis has half of the frequencies, as of a real signal's spectrum.

    numerator: [D, ...] complex64, the desired output times the conjugate of the spectrum.
    denominator: [...] float32, the power of the spectrum.
    """

    numerator: Complex[Array, "D *frequencies"]
    denominator: Float[Array, "*frequencies"]


class TranslationState(NamedTuple):
    """The translation filter.

    running: its running mean. first_frame: the filter of the first frame, which never changes.
    """

    running: Filter
    first_frame: Filter


class RotationState(NamedTuple):
    """The rotation filter.

    angle: [] float32 in [-pi, pi), radians, by which the object has turned since the first frame,
        clockwise; 0 as long as it is upright. gain: [] float32, running mean of how much more it is
        like its initial template turned back by that. first_frame: the filter, which never changes.
    """

    angle: Float[Array, ""]
    gain: Float[Array, ""]
    first_frame: Filter


class ColourState(NamedTuple):
    """How frequent each colour is, by the number of its bin.

    inside: [bins] float32, running mean of the histogram of the object. outside: [bins], of what is
        around it. Each has the sum 1; 0 in a video without channels.
    colourful: [] float32 in [0, 1], how much the cue counts, by the colours of the first frame.
    """

    inside: Float[Array, " bins"]
    outside: Float[Array, " bins"]
    colourful: Float[Array, ""]


class VerificationState(NamedTuple):
    """What the object looks like, where it was last, and for how long it has been missed.

    initial: [D] float32, template of the first frame, a unit vector without its mean.
    online: [D] float32, running mean of the templates of the frames in which it was recognised.
    recent: [D] float32, a quicker mean, of all frames that were learned from.
    box: [4] float32, x, y, w, h in pixels, where it was verified last.
    num_missed: [] int32, frames in a row in which the object was not verified.
    num_rested: [] int32, frames since the last one that there was something to learn from.
    """

    initial: Float[Array, " D"]
    online: Float[Array, " D"]
    recent: Float[Array, " D"]
    box: Float[Array, "4"]
    num_missed: Int32[Array, ""]
    num_rested: Int32[Array, ""]


class State(NamedTuple):
    """All that one track carries from frame to frame.

    box: [4] float32, x, y, w, h in pixels, (x, y) the top-left corner: position and estimated size.
    initial_size: [2] float32, w and h of the initial box, pixels.
    translation, colour, scale, rotation, verification: of the components; None where one is
        switched off.
    """

    box: Float[Array, "4"]
    initial_size: Float[Array, "2"]
    pool: Pool
    weak: Weak
    strong: Strong
    translation: TranslationState | None
    colour: ColourState | None
    scale: Filter | None
    rotation: RotationState | None
    verification: VerificationState | None


class Candidate(NamedTuple):
    """Where in a frame the object may be.

    box: [4] float32, x, y, w, h in pixels. noisy_or: [], confidence: [] and part_scores: [K] as in
    `StepInfo`, but for the confidence, which is by the similarity alone. description: [D] float32,
    of its patch, a unit vector; None without verification. responses: [] float32, the sum of those
    of the translation filter, as it is and as of the first frame; None without. rotation: of the
    state after it; None without.
    """

    box: Float[Array, "4"]
    noisy_or: Float[Array, ""]
    confidence: Float[Array, ""]
    part_scores: Float[Array, " K"]
    description: Float[Array, " D"] | None = None
    responses: Float[Array, ""] | None = None
    rotation: RotationState | None = None


class StepInfo(NamedTuple):
    """What one frame yields.

    box: [4] float32, x, y, w, h in pixels, of the best candidate: also where the object is missed.
    confidence: [] float32 in [0, 1], probability that the box overlaps the object by more than
        half; NaN without verification, as in the paper's setting.
    noisy_or: [] float32 in [0, 1], the Noisy-OR of the parts at the position, the paper's
        confidence: near 1 whether the object is there or not.
    part_scores: [K] float32 in [0, 1], each part's probability there.
    lost: [] bool, whether the object has not been verified for `Verification.patience` frames; a
        similarity whose confidence is above `recover_above` ends it. False without verification.
    noise: [R] float32, the selection's e for the frame's training samples, the mean over selectors
        (eq. 14): how much the model corrects the label of the tracked box, sample 0, and of the
        four corners of the window. 0 for a selector other than "l1", and in a frame that is not
        learned from as the object is recognised surely (`Verification.rest_above`).
    """

    box: Float[Array, "4"]
    confidence: Float[Array, ""]
    noisy_or: Float[Array, ""]
    part_scores: Float[Array, " K"]
    lost: Bool[Array, ""]
    noise: Float[Array, " R"]


class Track(NamedTuple):
    """A whole sequence: `StepInfo` stacked over its frames.

    boxes: [T, 4] float32, x, y, w, h in pixels; the first row is the initial box.
    confidence: [T] float32 in [0, 1], probability that each box overlaps the object by more than
        half; NaN without verification.
    noisy_or: [T] float32 in [0, 1], the Noisy-OR of the parts.
    part_scores: [T, K] float32 in [0, 1], each part's probability.
    lost: [T] bool, whether the object is lost; False without verification.
    noise: [T, R] float32, how much the selection corrects the label of each training sample.
    """

    boxes: Float[Array, "T 4"]
    confidence: Float[Array, " T"]
    noisy_or: Float[Array, " T"]
    part_scores: Float[Array, "T K"]
    lost: Bool[Array, " T"]
    noise: Float[Array, "T R"]
