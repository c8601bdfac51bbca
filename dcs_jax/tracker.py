"""The tracker: one frame in, one box out (Algorithm 1), with what it learns there (Algorithm 2).

The functions are pure and can be jitted, vmapped and scanned: `sequence.py` scans over a video.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from dcs_jax.checks import check_box, check_frame
from dcs_jax.config import Config, Grid
from dcs_jax.core.haar import draw_pool, responses
from dcs_jax.core.samples import training_patches
from dcs_jax.core.search import ConfidenceMap, confidence_map, find_peak
from dcs_jax.core.selection import select
from dcs_jax.core.strong import combine
from dcs_jax.core.weak import error, init_weak, update_weak
from dcs_jax.core.window import ColumnSums, column_sums, window_integral
from dcs_jax.types import BoxLike, ImageLike, Pool, State, StepInfo, Strong, Weak


def init(
    frame: ImageLike | ColumnSums, box: BoxLike, key: jax.Array | Pool, config: Config
) -> State:
    """Start a track: draw the features and learn the object from its first frame.

    frame: [H, W] grey or [H, W, 3] RGB, uint8; or its `column_sums`, which all tracks of one video
        can share.
    box: [4], x, y, w, h in pixels, float32.
    key: decides the features, and with them everything else; or the features themselves.
    config: with canvas="native", as `config.resolve(box)` gives it.

    Raises ValueError where shapes, types or the box are not as stated.
    """
    sums = _sums(frame)
    check_box(box, sums.shape)
    box = jnp.asarray(box, jnp.float32)
    pool = key if isinstance(key, Pool) else draw_pool(key, config)
    values = _training_responses(sums, box, pool, config)
    weak = init_weak(pool, config.weak)
    # The last of the updates is the one that also selects.
    weak = jax.lax.fori_loop(
        1, config.first_updates, lambda _, weak: update_weak(weak, values)[0], weak
    )
    return State(box, pool, *_learn(values, weak, config))


def step(state: State, frame: ImageLike | ColumnSums, config: Config) -> tuple[State, StepInfo]:
    """Follow the object into the next frame (Algorithm 1) and learn it there.

    frame: as given to `init`, of the same size as before.
    config: as given to `init`; its numbers may change from frame to frame.
    """
    sums = _sums(frame)
    # Lines 1-3: where in the window around its last place is the object most likely?
    confidence = _look(state, sums, config)
    displacement = find_peak(confidence.evidence, state.box, sums.shape, config)
    box = _move(state.box, displacement, sums.shape, config.grid)
    # Line 4: the patches there and around are the new training rows (Algorithm 2).
    values = _training_responses(sums, box, state.pool, config)
    weak, strong = _learn(values, state.weak, config)
    return State(box, state.pool, weak, strong), _info(box, confidence, displacement, config.grid)


def score(state: State, frame: ImageLike | ColumnSums, config: Config) -> StepInfo:
    """What the classifiers make of a frame at the place where the state has its box.

    After `init` this is the first row of a track, whose box is given and not searched for.
    """
    confidence = _look(state, _sums(frame), config)
    return _info(state.box, confidence, jnp.zeros(2, jnp.float32), config.grid)


def _sums(frame: ImageLike | ColumnSums) -> ColumnSums:
    if isinstance(frame, ColumnSums):
        return frame
    check_frame(frame)
    return column_sums(jnp.asarray(frame))


def _look(state: State, sums: ColumnSums, config: Config) -> ConfidenceMap:
    window = window_integral(sums, state.box, config.grid)
    return confidence_map(window, state.pool, state.weak, state.strong, config)


def _move(
    box: Float[Array, "4"],
    displacement: Float[Array, "2"],
    frame_shape: tuple[int, ...],
    grid: Grid,
) -> Float[Array, "4"]:
    """The box moved by a displacement in cells; its centre stays in the frame."""
    x, y, w, h = box
    down, right = displacement
    x = jnp.clip(x + right * w / grid.columns, -w / 2, frame_shape[1] - w / 2)
    y = jnp.clip(y + down * h / grid.rows, -h / 2, frame_shape[0] - h / 2)
    return jnp.stack([x, y, w, h])


def _training_responses(
    sums: ColumnSums, box: Float[Array, "4"], pool: Pool, config: Config
) -> Float[Array, "R F"]:
    """Responses of all features on the R training patches of a frame: [R, F]."""
    window = window_integral(sums, box, config.grid)
    return responses(training_patches(window, box, sums.grey.shape, config), pool)


def _learn(values: Float[Array, "R F"], weak: Weak, config: Config) -> tuple[Weak, Strong]:
    """Algorithm 2: update all weak classifiers, select among them, add up the selected.

    values: [R, F], the features' responses on this frame's training patches.
    """
    weak, votes = update_weak(weak, values)
    shape = (config.pool_size, config.parts, config.selectors)
    errors = error(weak).reshape(shape)
    selected = select(votes.reshape(-1, *shape), errors, config)
    return weak, combine(selected, errors)


def _info(
    box: Float[Array, "4"], confidence: ConfidenceMap, displacement: Float[Array, "2"], grid: Grid
) -> StepInfo:
    """The record of one frame: the map is read at the cell nearest to the chosen place."""
    middle = jnp.array([grid.margin_rows, grid.margin_columns], jnp.int32)
    row, column = jnp.round(displacement).astype(jnp.int32) + middle
    return StepInfo(box, *confidence.at(row, column))
