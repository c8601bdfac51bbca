"""The tracker: one frame in, one box out (Algorithm 1), with what it learns there (Algorithm 2).

The functions are pure and can be jitted, vmapped and scanned: `sequence.py` scans over a video.
What the paper does not have stands in `extras.py`.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from dcs_jax.checks import check_box, check_frame
from dcs_jax.config import Config, Grid
from dcs_jax.core.haar import draw_pool, responses
from dcs_jax.core.samples import LABELS, training_patches
from dcs_jax.core.search import ConfidenceMap, confidence_map, find_peak
from dcs_jax.core.selection import select
from dcs_jax.core.strong import combine
from dcs_jax.core.weak import error, init_weak, update_weak
from dcs_jax.core.window import ColumnSums, column_sums, window_integral
from dcs_jax.extensions import extras
from dcs_jax.types import BoxLike, ImageLike, Pool, Sighting, State, StepInfo, Strong, Weak


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
    window = window_integral(sums, box, config.grid)
    values = responses(training_patches(window, box, sums.shape, config), pool)
    weak = init_weak(pool, config.weak)
    # The last of the updates is the one that also selects.
    weak = jax.lax.fori_loop(
        1, config.first_updates, lambda _, weak: update_weak(weak, values)[0], weak
    )
    weak, strong, _ = _learn(values, weak, config)
    return State(
        box, box[2:], pool, weak, strong, extras.begin(window, config) if config.extras else None
    )


def step(state: State, frame: ImageLike | ColumnSums, config: Config) -> tuple[State, StepInfo]:
    """Follow the object into the next frame (Algorithm 1) and learn it there.

    frame: as given to `init`, of the same size as before.
    config: as given to `init`; its numbers may change from frame to frame.
    """
    sums = _sums(frame)
    # Lines 1-3: where in the window around its last place is the object most likely?
    seen = _find(state, state.box, sums, config)
    if state.extras is not None:
        seen = extras.seek(_find, state, seen, sums, config)
    # Line 4: the patches there and around are the new training rows (Algorithm 2).
    window = window_integral(sums, seen.box, config.grid)
    values = responses(training_patches(window, seen.box, sums.shape, config), state.pool)
    weak, strong, noise = _learn(values, state.weak, config)
    learned = state._replace(box=seen.box, weak=weak, strong=strong)
    if state.extras is not None:
        learned, seen = extras.learn(state, learned, seen, window, config)
    return learned, _info(learned, seen, noise, config)


def score(state: State, frame: ImageLike | ColumnSums, config: Config) -> StepInfo:
    """What the classifiers make of a frame at the place where the state has its box.

    After `init` this is the first row of a track, whose box is given and not searched for.
    """
    sums = _sums(frame)
    window = window_integral(sums, state.box, config.grid)
    votes = confidence_map(window, state.pool, state.weak, state.strong, config)
    nowhere = jnp.zeros(2, jnp.float32)
    seen = _sight(state, state.box, nowhere, votes, window, sums.shape, config)
    return _info(state, seen._replace(box=state.box), jnp.zeros(len(LABELS), jnp.float32), config)


def _find(state: State, box: Float[Array, "4"], sums: ColumnSums, config: Config) -> Sighting:
    """The most likely place of the object in the window around a box (lines 1-3)."""
    window = window_integral(sums, box, config.grid)
    votes = confidence_map(window, state.pool, state.weak, state.strong, config)
    evidence = votes.evidence
    if state.extras is not None:
        evidence += extras.witness(state.extras, window, config)
    displacement = find_peak(evidence, box, sums.shape, config)
    return _sight(state, box, displacement, votes, window, sums.shape, config)


def _sight(
    state: State,
    box: Float[Array, "4"],
    displacement: Float[Array, "2"],
    votes: ConfidenceMap,
    window: Float[Array, "lines_y lines_x"],
    frame_shape: tuple[int, ...],
    config: Config,
) -> Sighting:
    """What there is at a displacement, in cells, from the middle of the window around a box.

    The map is read at the candidate place nearest to it.
    """
    grid = config.grid
    middle = jnp.array([grid.margin_rows, grid.margin_columns], jnp.int32)
    row, column = jnp.round(displacement).astype(jnp.int32) + middle
    seen = Sighting(_move(box, displacement, frame_shape, grid), *votes.at(row, column))
    if state.extras is not None:
        seen = extras.recognise(
            state.extras, seen, state.given, window, displacement, frame_shape, config
        )
    return seen


def _sums(frame: ImageLike | ColumnSums) -> ColumnSums:
    if isinstance(frame, ColumnSums):
        return frame
    check_frame(frame)
    return column_sums(jnp.asarray(frame))


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


def _learn(
    values: Float[Array, "R F"], weak: Weak, config: Config
) -> tuple[Weak, Strong, Float[Array, " R"]]:
    """Algorithm 2: update all weak classifiers, select among them, add up the selected.

    values: [R, F], the features' responses on this frame's training patches. Returns also the
    selection's label noise, [R].
    """
    weak, votes = update_weak(weak, values)
    shape = (config.pool_size, config.parts, config.selectors)
    errors = error(weak).reshape(shape)
    selected, noise = select(votes.reshape(-1, *shape), errors, config)
    return weak, combine(selected, errors), noise


def _info(state: State, seen: Sighting, noise: Float[Array, " R"], config: Config) -> StepInfo:
    """The record of one frame."""
    lost = jnp.array(False)
    box = seen.box
    if state.extras is not None:
        lost = extras.is_lost(state.extras, config)
        if not config.scale:
            box = jnp.concatenate([box[:2] + (box[2:] - state.given) / 2, state.given])
    return StepInfo(box, seen.confidence, seen.part_scores, lost, noise)
