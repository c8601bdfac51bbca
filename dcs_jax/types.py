"""The records that pass between the functions: NamedTuples of arrays, so every one is a pytree.

Dimensions, used in every docstring and shape comment of the library:

    T  frames                              H, W  rows and columns of a frame, pixels
    K  parts of the object                 N  selectors per part
    M  weak classifiers in a selector's pool, all different features
    F  = K * N * M, all features of a track, ordered part by part, selector by selector
    R  distinct training patches of a frame (5); they stand for L = 8 rows, one of them four times
    G  cells per side of a window          C  candidate positions per axis
"""

from typing import NamedTuple

import jax


class Pool(NamedTuple):
    """Haar-like features, each the weighted sum of at most 9 corners of an integral image.

    corners: [F, 9] int32, flat index of the corner in a patch's integral image, whose rows
        are one longer than the object's canvas is wide. Unused corners repeat the first.
    weights: [F, 9] float32, weight of each corner in grey values per cell; 0 where unused.
    boxes: [F] int32, number of boxes the feature compares (2, 3 or 4).
    """

    corners: jax.Array
    weights: jax.Array
    boxes: jax.Array


class Weak(NamedTuple):
    """The weak classifiers: one Kalman-filtered grey-level model per feature and class.

    mean: [F, 2] float32, mean response on the background (column 0) and on the object (column 1).
    sigma: [F, 2] float32, its standard deviation, or None with `weak="midpoint"`.
    variance: [] float32, variance P of the estimated means: it does not depend on the data, so
        all features of both classes share it.
    correct, wrong: [F] float32, number of training rows classified right and wrong so far,
        each counted from 1 (lambda_c and lambda_w of online boosting).
    """

    mean: jax.Array
    sigma: jax.Array | None
    variance: jax.Array
    correct: jax.Array
    wrong: jax.Array


class Strong(NamedTuple):
    """The K strong part classifiers, H^k = sum_n alpha h / sum_n alpha.

    selected: [K, N] int32 in [0, M), the weak classifier each selector has chosen from its pool.
    alpha: [K, N] float32, its voting weight, not negative.
    """

    selected: jax.Array
    alpha: jax.Array


class State(NamedTuple):
    """All that one track carries from frame to frame.

    box: [4] float32, x, y, w, h in pixels, (x, y) the top-left corner.
    """

    box: jax.Array
    pool: Pool
    weak: Weak
    strong: Strong


class StepInfo(NamedTuple):
    """What one frame yields.

    box: [4] float32, x, y, w, h in pixels.
    confidence: [] float32 in [0, 1], the Noisy-OR probability at the chosen place.
    part_scores: [K] float32 in [0, 1], each part's probability there.
    """

    box: jax.Array
    confidence: jax.Array
    part_scores: jax.Array


class Track(NamedTuple):
    """A whole sequence: `StepInfo` stacked over its frames.

    boxes: [T, 4] float32, x, y, w, h in pixels; the first row is the given box.
    confidence: [T] float32 in [0, 1], the Noisy-OR probability at the chosen place.
    part_scores: [T, K] float32 in [0, 1], each part's probability there.
    """

    boxes: jax.Array
    confidence: jax.Array
    part_scores: jax.Array
