"""The confidence map over the search window and its peak (Algorithm 1, lines 1-3)."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32, Shaped

from dcs_jax.config import Config, Grid
from dcs_jax.core.haar import CORNERS_OF_BOXES, responses
from dcs_jax.core.weak import vote
from dcs_jax.core.window import Placed, reach, turned
from dcs_jax.types import Pool, Scalar, Strong, Weak

# 1 - p of a part is not taken below this, or one part would outvote all the others.
_LEAST_MISS = 1e-6
# A product of so many of them is still a normal float32.
_FACTORS = 6
# Numbers of 32 bits in a vector of the CPU (AVX2).
_VECTOR = 8
# Scores within this of the maximum belong to its plateau: well above what rounding makes of
# equal sums, well below one more vote.
_PLATEAU = 1e-3


class ConfidenceMap(NamedTuple):
    """How likely the object is at each candidate position in the window.

    parts: [K, C_y, C_x] in [0, 1], each part's smoothed probability (1 + H^k) / 2.
    unsmoothed: [C_y, C_x], -log(1 - p) of the Noisy-OR p = 1 - prod_k (1 - p_k).
    score_map: [C_y, C_x], the same smoothed.
    """

    parts: Float[Array, "K C_y C_x"]
    unsmoothed: Float[Array, "C_y C_x"]
    score_map: Float[Array, "C_y C_x"]

    def at(
        self, row: Int32[Array, ""], column: Int32[Array, ""], config: Config
    ) -> tuple[Float[Array, ""], Float[Array, " K"]]:
        """The Noisy-OR probability [] and the parts' probabilities [K] at one position."""
        # Smoothed once more from its neighbours, and not read from score_map: with a second reader
        # XLA no longer fuses that map into the sum with what extensions add to it.
        padded = jnp.pad(self.unsmoothed, 1, mode="edge")
        around = jax.lax.dynamic_slice(padded, (row, column), (3, 3))
        score = _smooth(around, config.smoothing)[1, 1]
        return -jnp.expm1(-score), self.parts[:, row, column]


@jax.named_scope("confidence map")
def confidence_map(
    integral: Float[Array, "lines_y lines_x"],
    pool: Pool,
    weak: Weak,
    strong: Strong,
    config: Config,
) -> ConfidenceMap:
    """Let the strong part classifiers vote at every position, smooth, and fuse by Noisy-OR.

    integral: [S_y + 1, S_x + 1], of the search window.
    """
    return _fuse(_part_votes(integral, pool, weak, strong, config.search_grid), config)


@jax.named_scope("confidence map")
def middle_confidence(
    integral: Float[Array, "lines_y lines_x"],
    pool: Pool,
    weak: Weak,
    strong: Strong,
    config: Config,
) -> tuple[Float[Array, ""], Float[Array, " K"]]:
    """`ConfidenceMap.at` in the middle of the window, from the few positions that count there.

    These are patches: no second map is compiled. Its values are the map's up to rounding.
    """
    grid = config.grid
    # Smoothed twice: the middle depends on two neighbours on each side.
    near = [min(margin, 2) for margin in (grid.margin_rows, grid.margin_columns)]
    tops = grid.margin_rows + np.arange(-near[0], near[0] + 1)
    lefts = grid.margin_columns + np.arange(-near[1], near[1] + 1)
    patches = jnp.stack(
        [
            integral[top : top + grid.rows + 1, left : left + grid.columns + 1].reshape(-1)
            for top in tops
            for left in lefts
        ],
        axis=-1,
    )
    chosen = _chosen(strong).reshape(-1)
    features = Pool(*(values[..., chosen] for values in pool))
    sigma = None if weak.sigma is None else weak.sigma[:, chosen]
    votes = vote(responses(patches, features), weak.mean[:, chosen], sigma)
    votes = votes.reshape(-1, *strong.alpha.shape)  # [C_y * C_x, K, N]
    total = strong.alpha.sum(1)
    votes = (strong.alpha[None] * votes).sum(2) / jnp.where(total > 0, total, 1)[None]
    maps = _fuse(votes.T.reshape(-1, len(tops), len(lefts)), config)
    return maps.at(jnp.int32(near[0]), jnp.int32(near[1]), config)


def _fuse(votes: Float[Array, "K C_y C_x"], config: Config) -> ConfidenceMap:
    """The map of the parts' votes, each in [-1, 1]."""
    parts = _smooth((1 + votes) / 2, config.smoothing)
    misses = list(jnp.maximum(1 - parts, _LEAST_MISS))
    # The logarithm of a product costs less than those of its factors.
    products = [
        functools.reduce(jnp.multiply, misses[first : first + _FACTORS])
        for first in range(0, len(misses), _FACTORS)
    ]
    unsmoothed = -functools.reduce(jnp.add, map(jnp.log, products))
    return ConfidenceMap(parts, unsmoothed, _smooth(unsmoothed, config.smoothing))


def search_window(
    integral: Float[Array, "lines_y lines_x"], middle: Int32[Array, "2"], config: Config
) -> Float[Array, "rows columns"]:
    """The search window within the whole one: [S_y + 1, S_x + 1], integral image.

    integral: [G_y + 1, G_x + 1]. middle: [2], displacement from its middle, down and right, cells.
    """
    whole, searched = config.grid, config.search_grid
    if whole == searched:
        return integral
    margins = [
        whole.margin_rows - searched.margin_rows,
        whole.margin_columns - searched.margin_columns,
    ]
    start = jnp.array(margins, jnp.int32) + middle
    return jax.lax.dynamic_slice(integral, start, [side + 1 for side in searched.window])


@jax.named_scope("peak")
def find_peak(
    score_map: Float[Array, "C_y C_x"],
    placed: Placed,
    frame_shape: tuple[int, ...],
    config: Config,
    *,
    subcell: bool,
    middle: Int32[Array, "2"],
    turn: Float[Array, "2 2"] | None = None,
) -> Float[Array, "2"]:
    """Displacement of the object from the last box: [2] down and right, cells.

    The best score, less the motion prior, often holds on a plateau, since votes are hard: of the
    best positions the one nearest to the last, and of the plateau around it the centroid. The
    first index would drift up and to the left even on a still scene.

    score_map: [C_y, C_x]. placed: the last box. frame_shape: (H, W) or (H, W, 3).
    middle: [2], displacement of the search window from the last box, down and right, cells.
    subcell: whether a single best position is refined by a parabola through its neighbours, for a
        score map that is smooth.
    turn: [2, 2], how the canvas is turned (`extensions.rotation`); displacements are on it.
    """
    down, right = displacements(config.search_grid, middle)
    down, right = down[:, None], right[None, :]
    score, best, nearest = best_positions(score_map, down, right, placed, frame_shape, config, turn)
    seed = (jnp.arange(best.size, dtype=jnp.int32) == nearest).reshape(best.shape)
    plateau = _connected(seed, best).astype(jnp.float32)
    centroid = jnp.stack([(plateau * down).sum(), (plateau * right).sum()]) / plateau.sum()
    if not subcell:
        return centroid
    row, column = nearest // score.shape[1], nearest % score.shape[1]
    around = jnp.pad(score, 1, constant_values=-jnp.inf)
    near = jax.lax.dynamic_slice(around, (row, column), (3, 3))
    offset = jnp.stack([parabola_peak(*near[:, 1]), parabola_peak(*near[1])])
    return jnp.where(plateau.sum() > 1, centroid, centroid + offset)


def displacements(
    grid: Grid, middle: Int32[Array, "2"]
) -> tuple[Float[Array, " C_y"], Float[Array, " C_x"]]:
    """Displacements of the candidate positions from the last box, down and right, cells.

    middle: [2], that of the window.
    """
    down, right = (
        jnp.arange(-margin, margin + 1, dtype=jnp.float32) + offset.astype(jnp.float32)
        for margin, offset in zip((grid.margin_rows, grid.margin_columns), middle, strict=True)
    )
    return down, right


def best_positions(
    score_map: Float[Array, "rows columns"],
    down: Float[Array, "rows 1"],
    right: Float[Array, "1 columns"],
    placed: Placed,
    frame_shape: tuple[int, ...],
    config: Config,
    turn: Float[Array, "2 2"] | None = None,
) -> tuple[Float[Array, "rows columns"], Bool[Array, "rows columns"], Int32[Array, ""]]:
    """The score with the motion prior, which positions share the best, and one of these.

    down, right: displacements of the positions from the last box, cells, on a canvas that is turned
    so (`extensions.rotation`). placed: the last box.
    Returns score_map - prior * d^2 / (w h), with d in pixels, and -inf where the box may not be
    (`reach`); where that is at its best; and of these positions the number of the least displaced.
    """
    _, _, w, h = placed.shown
    rows, columns = config.grid.rows, config.grid.columns
    squared = (down / rows) ** 2 * (h / w) + (right / columns) ** 2 * (w / h)
    low, high = (limit.astype(jnp.float32) for limit in reach(placed, frame_shape, config))
    if turn is not None:
        down, right = turned(turn, down, right)
    allowed = (low[0] <= down) & (down <= high[0]) & (low[1] <= right) & (right <= high[1])
    score = jnp.where(allowed, score_map - config.prior * squared, -jnp.inf)
    best = score >= score.max() - _PLATEAU
    nearest = jnp.argmin(jnp.where(best, squared, jnp.inf)).astype(jnp.int32)
    return score, best, nearest


def parabola_peak(
    before: Float[Array, ""], here: Float[Array, ""], after: Float[Array, ""]
) -> Float[Array, ""]:
    """Where a parabola through three neighbouring values has its peak: [] in [-0.5, 0.5]."""
    curvature = before - 2 * here + after
    # At the edge of what is allowed there is a neighbour less: -inf.
    peaked = (curvature < 0) & jnp.isfinite(curvature)
    return jnp.where(
        peaked, jnp.clip((before - after) / (2 * jnp.where(peaked, curvature, 1)), -0.5, 0.5), 0
    )


class _Classifiers(NamedTuple):
    """Selected weak classifiers: [K, N, ...], or [N, ...] of one part, or [...] one of them.

    A part's are in the order of their features' corners, the fewest first.

    rows, columns: [9] int32, the feature's corners in the patch. weights: [9]. mean: [2].
    sigma: [2] or None. alpha: [].
    """

    rows: Int32[Array, "*classifiers 9"]
    columns: Int32[Array, "*classifiers 9"]
    weights: Float[Array, "*classifiers 9"]
    mean: Float[Array, "*classifiers 2"]
    sigma: Float[Array, "*classifiers 2"] | None
    alpha: Float[Array, "*classifiers"]


def _part_votes(
    integral: Float[Array, "lines_y lines_x"], pool: Pool, weak: Weak, strong: Strong, grid: Grid
) -> Float[Array, "K C_y C_x"]:
    """H^k = sum_n alpha h / sum_n alpha at every position, 0 where all alpha are: [K, C_y, C_x].

    Under vmap the tracks take turns: slices at batched positions would become element-wise gathers.
    """
    chosen = _chosen(strong)
    boxes = pool.boxes[chosen]
    order = _stable_order(boxes)
    chosen, alpha = (jnp.take_along_axis(x, order, axis=1) for x in (chosen, strong.alpha))
    ends = jnp.stack(
        [(boxes <= number).sum(1, dtype=jnp.int32) for number in CORNERS_OF_BOXES], axis=1
    )  # [K, 3]

    def of_chosen(values: Shaped[Array, "fields F"]) -> Shaped[Array, "K N fields"]:
        return jnp.moveaxis(values[:, chosen], 0, -1)

    rows, columns = jnp.divmod(of_chosen(pool.corners).astype(jnp.int32), grid.columns + 1)
    weights = of_chosen(pool.coefficients).astype(jnp.float32) * pool.scale[chosen][..., None]
    sigma = None if weak.sigma is None else of_chosen(weak.sigma)
    classifiers = _Classifiers(rows, columns, weights, of_chosen(weak.mean), sigma, alpha)

    @jax.custom_batching.sequential_vmap
    def all_parts(
        integral: Float[Array, "lines_y lines_x"],
        classifiers: _Classifiers,
        ends: Int32[Array, "K 3"],
    ) -> Float[Array, "K C_y C_x"]:
        return jax.lax.map(
            lambda part: _sum_votes(integral, part[0], part[1], (height, padded)),
            (classifiers, ends),
        )

    height, width = grid.positions
    # Rows of whole vectors: 64 places take three quarters of the time of 61.
    padded = width + -width % _VECTOR
    total = strong.alpha.sum(1)[:, None, None]
    votes = all_parts(jnp.pad(integral, ((0, 0), (0, padded - width))), classifiers, ends)
    return votes[:, :, :width] / jnp.where(total > 0, total, 1)


def _chosen(strong: Strong) -> Int32[Array, "K N"]:
    """Numbers in 0..F of the selected features."""
    selectors = jnp.arange(strong.selected.size, dtype=jnp.int32).reshape(strong.selected.shape)
    return strong.selected * strong.selected.size + selectors


def _stable_order(keys: Int32[Array, "K N"]) -> Int32[Array, "K N"]:
    """`jnp.argsort` of each row, by comparing all with all: faster for rows this short."""
    number = jnp.arange(keys.shape[1], dtype=jnp.int32)
    keys = keys * len(number) + number[None]
    place = (keys[:, :, None] > keys[:, None]).sum(2, dtype=jnp.int32)
    return jnp.where(place[:, :, None] == number[None, None], number[None, :, None], 0).sum(
        1, dtype=jnp.int32
    )


def _sum_votes(
    integral: Float[Array, "lines_y lines_x"],
    classifiers: _Classifiers,
    ends: Int32[Array, "3"],
    positions: tuple[int, int],
) -> Float[Array, "C_y C_x"]:
    """sum_n alpha h of one part at every position: [C_y, C_x].

    A feature at all positions at once is as many shifted views of the integral image as it has
    corners, added up.

    ends: [3], how many of the classifiers have features of at most 2, 3 and 4 boxes.
    """
    total, first = jnp.zeros(positions, integral.dtype), jnp.int32(0)
    # One loop for each number of corners: nine views of every feature, some with weight 0, took
    # 1.1 times as long on 41 x 41 positions and 1.4 times on 97 x 77.
    for end, corners in zip(ends, CORNERS_OF_BOXES.values(), strict=True):

        def add(
            number: Int32[Array, ""], total: Float[Array, "C_y C_x"], corners: int = corners
        ) -> Float[Array, "C_y C_x"]:
            classifier = jax.tree.map(lambda values: values[number], classifiers)
            response = jnp.zeros(positions, integral.dtype)
            for corner in range(corners):
                start = (classifier.rows[corner], classifier.columns[corner])
                view = jax.lax.dynamic_slice(integral, start, positions)
                response += classifier.weights[corner] * view
            decided = vote(response, classifier.mean, classifier.sigma)
            return total + classifier.alpha * decided

        total, first = jax.lax.fori_loop(first, end, add, total), end
    return total


def _smooth(maps: Float[Array, "*maps C_y C_x"], sigma: Scalar) -> Float[Array, "*maps C_y C_x"]:
    """3x3 Gaussian of standard deviation sigma cells over the last two axes, edges repeated."""
    side = jnp.exp(-0.5 / jnp.square(jnp.asarray(sigma, jnp.float32)))  # 0 where sigma is
    for axis in (-2, -1):
        before, after = _neighbours(maps, axis, mode="edge")
        maps = (maps + side * (before + after)) / (1 + 2 * side)
    return maps


def _connected(
    seed: Bool[Array, "C_y C_x"], mask: Bool[Array, "C_y C_x"]
) -> Bool[Array, "C_y C_x"]:
    """The part of the mask [...] that is connected (diagonals too) with the seed: bool [...]."""

    def grow(
        carry: tuple[Bool[Array, "C_y C_x"], Bool[Array, ""]],
    ) -> tuple[Bool[Array, "C_y C_x"], Bool[Array, ""]]:
        region, _ = carry
        wider = region
        for axis in (-2, -1):
            before, after = _neighbours(wider, axis, mode="constant")
            wider = wider | before | after
        wider &= mask
        return wider, (wider != region).any()

    return jax.lax.while_loop(lambda carry: carry[1], grow, (seed, jnp.array(True)))[0]


def _neighbours(
    values: Shaped[Array, "*shape"], axis: int, mode: str
) -> tuple[Shaped[Array, "*shape"], Shaped[Array, "*shape"]]:
    """The values one position before and one after each position along an axis."""
    widths = [(0, 0)] * values.ndim
    widths[axis] = (1, 1)
    padded = jnp.pad(values, widths, mode=mode)
    size = values.shape[axis]
    return (
        jax.lax.slice_in_dim(padded, 0, size, axis=axis),
        jax.lax.slice_in_dim(padded, 2, size + 2, axis=axis),
    )
