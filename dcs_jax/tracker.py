"""One track through one frame: the paper's Algorithm 1, and Algorithm 2 in `_learn`.

`init` and `step` are pure functions of arrays; `runners` scan over a video with them. What the
paper does not have stands in `extensions`, one `if` for each component here. The pieces are jitted,
so that each is traced once, however many programs it is part of.
"""

import dataclasses
import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, UInt8

from dcs_jax.checks import check_box, check_frame, check_key, shown
from dcs_jax.config import COMPONENTS, Config, single_precision
from dcs_jax.core.haar import CORNERS, draw_pool, responses
from dcs_jax.core.samples import LABELS, training_patches
from dcs_jax.core.search import (
    confidence_map,
    displacements,
    find_peak,
    middle_confidence,
    search_window,
)
from dcs_jax.core.selection import select
from dcs_jax.core.strong import combine
from dcs_jax.core.weak import error, init_weak, update_weak
from dcs_jax.core.window import (
    ColumnSums,
    Placed,
    VideoFrame,
    cell_aspect,
    one_frame,
    place,
    turned,
    window_integral,
)
from dcs_jax.extensions import (
    aspect,
    colour,
    redetection,
    rotation,
    scale,
    translation,
    verification,
)
from dcs_jax.extensions.descriptors import describe
from dcs_jax.types import (
    BoxLike,
    Candidate,
    ImageLike,
    Pool,
    State,
    StepInfo,
    Strong,
    VerificationState,
    Weak,
)


class _View(NamedTuple):
    """The window around a box, for the search in it and for learning from it.

    window: [G_y + 1, G_x + 1], its integral image. features: what the translation filter sees of
    it, or None. colours: what the histograms of colours see of it, or None.
    """

    window: Float[Array, "lines_y lines_x"]
    features: Float[Array, "8 Y X"] | None
    colours: UInt8[Array, "rows columns 3"] | None


def init(
    frame: ImageLike | VideoFrame | ColumnSums, box: BoxLike, key: jax.Array | Pool, config: Config
) -> State:
    """Start a track: draw the features and learn the object from its first frame.

    frame: [H, W] grey or [H, W, 3] RGB, uint8; or its `column_sums`, which all tracks of one video
        can share, or a `VideoFrame`, of which only what is looked at is read.
    box: [4], x, y, w, h in pixels, of 4 to 1e6 a side, at least partly in the frame.
    key: decides the features, and with them everything else; or the features themselves.
    config: with canvas="native", as `config.resolve(box)` gives it.

    Raises ValueError where shapes, types or the box are not as stated. Under jit the values of the
    box are not known, and not checked.
    """
    return _begin(frame, box, key, config)[0]


def start(
    frame: ImageLike | VideoFrame | ColumnSums, box: BoxLike, key: jax.Array | Pool, config: Config
) -> tuple[State, StepInfo]:
    """`init`, and the first row of the track, `score` of the same frame, from one window."""
    state, view = _begin(frame, box, key, config)
    return state, _score(state, view, config)


def _begin(
    frame: ImageLike | VideoFrame | ColumnSums, box: BoxLike, key: jax.Array | Pool, config: Config
) -> tuple[State, _View]:
    """The first state, and what is seen around its box."""
    frame = _readable(frame)
    check_box(box, frame.shape)
    if not isinstance(key, Pool):
        check_key(key)
    config = single_precision(config)
    box = jnp.asarray(box, jnp.float32)
    pool = key if isinstance(key, Pool) else draw_pool(key, config)
    view = _look(frame, config, box[2:], box, None)
    return _first_state(view, box, pool, frame.shape, config), view


@jax.jit
def _look(
    frame: VideoFrame | ColumnSums,
    config: Config,
    initial_size: Float[Array, "2"],
    box: Float[Array, "4"],
    angle: Float[Array, ""] | None,
) -> _View:
    """What is seen around a box; angle: by which the canvas is turned, None where it never is."""
    shown = place(box, config, initial_size).shown
    window = window_integral(frame, shown, config.grid)
    turn = _turn(angle, shown, config)
    if angle is not None and turn is not None:
        window = rotation.turn_window(window, angle, turn)
    return _View(
        window,
        None if config.translation is None else translation.features(window, config.grid),
        None if config.colour is None else colour.look(frame, shown, config.grid, turn),
    )


@functools.partial(jax.jit, static_argnames="frame_shape")
def _first_state(
    view: _View,
    box: Float[Array, "4"],
    pool: Pool,
    frame_shape: tuple[int, ...],
    config: Config,
) -> State:
    """The state that has learned the object from the window around its first box."""
    placed = place(box, config)
    values = responses(training_patches(view.window, placed, frame_shape, config), pool)
    weak = init_weak(pool, config.weak)
    # The last of the updates is the one that also selects.
    weak = jax.lax.fori_loop(
        1, config.first_updates, lambda _, weak: update_weak(weak, values)[0], weak
    )
    weak, strong, _ = _learn(values, weak, config)
    nowhere = jnp.zeros(2, jnp.float32)
    descriptions = _describe(view.window, nowhere, config)
    learned = rotated = None
    if config.translation is not None:
        assert view.features is not None
        learned = translation.init(view.features, config.translation, config.grid)
    if config.rotation is not None:
        polar = rotation.polar(
            view.window, nowhere, cell_aspect(placed.shown, config.grid), config.grid
        )
        rotated = rotation.init(polar)
    return State(
        box,
        box[2:],
        pool,
        weak,
        strong,
        learned,
        None if config.colour is None else colour.init(view.colours, placed, config),
        None if config.scale is None else scale.init(descriptions),
        rotated,
        None if config.verification is None else verification.init(_own_scale(descriptions), box),
    )


def step(
    state: State, frame: ImageLike | VideoFrame | ColumnSums, config: Config
) -> tuple[State, StepInfo]:
    """Follow the object into the next frame (Algorithm 1) and learn it there.

    frame: as given to `init`, of the same size as before.
    config: as given to `init`; its numbers may change from frame to frame.

    Raises ValueError where types, shapes or the components of state and config are not as stated.
    """
    frame = _readable(frame)
    config = single_precision(config)
    check_state(state, config)
    return _step(state, frame, config)


@jax.jit
def _step(state: State, frame: VideoFrame | ColumnSums, config: Config) -> tuple[State, StepInfo]:
    # Lines 1-3: where in the window around its last position is the object most likely?
    look = jax.tree_util.Partial(_look, frame, config, state.initial_size)
    localise = jax.tree_util.Partial(_localise, state, frame, config)
    known = state.verification
    rests = jax.tree_util.Partial(_rests, known, config)
    best, view = redetection.search(
        look,
        localise,
        rests,
        state.box,
        state.initial_size,
        _angle(state),
        known,
        frame.shape,
        config,
    )
    # Line 4: the patches there and around are the new training samples (Algorithm 2).
    updated, best, noise = jax.lax.cond(
        rests(best),
        lambda: _followed(state, best, config),
        lambda: _learned(state, best, view, frame.shape, config),
    )
    return updated, _info(updated, best, noise, config)


def score(state: State, frame: ImageLike | VideoFrame | ColumnSums, config: Config) -> StepInfo:
    """What the classifiers make of a frame at the position where the state has its box.

    After `init` this is the first row of a track, whose box is the initial one, not searched for.

    Raises ValueError as `step` does.
    """
    frame = _readable(frame)
    config = single_precision(config)
    check_state(state, config)
    view = _look(frame, config, state.initial_size, state.box, _angle(state))
    return _score(state, view, config)


@jax.jit
def _score(state: State, view: _View, config: Config) -> StepInfo:
    """`score` from what is seen around the box."""
    noisy_or, part_scores = middle_confidence(
        view.window, state.pool, state.weak, state.strong, config
    )
    confidence = jnp.full_like(noisy_or, jnp.nan)
    nowhere = jnp.zeros(2, jnp.float32)
    if state.verification and config.verification:
        description = _own_scale(_describe(view.window, nowhere, config))
        similarity = verification.similarity(state.verification, description, config.verification)
        confidence = verification.score(similarity, config.verification)
    of_filter = _of_filter(state, view, nowhere, config)
    here = Candidate(state.box, noisy_or, confidence, part_scores, responses=of_filter)
    return _info(state, here, jnp.zeros(len(LABELS), jnp.float32), config)


@jax.jit
def _localise(
    state: State,
    frame: VideoFrame | ColumnSums,
    config: Config,
    box: Float[Array, "4"],
    view: _View,
    by_first: Bool[Array, ""],
) -> Candidate:
    """The most likely position of the object in the window around a box (lines 1-3).

    by_first: whether the translation filter is that of the first frame alone.
    """
    middle = jnp.zeros(2, jnp.int32)
    placed = place(box, config, state.initial_size)
    turn = _turn(_angle(state), placed.shown, config)
    response = by_colour = None
    if state.colour and config.colour and view.colours is not None:
        of_object = colour.respond(state.colour, view.colours, config.colour)
        by_colour = functools.partial(colour.score, of_object, placed, config)
    if state.translation and config.translation:
        assert view.features is not None
        share = jnp.where(by_first, 1.0, config.translation.first_frame)
        settings = dataclasses.replace(config.translation, first_frame=share)
        response = translation.respond(state.translation, view.features, settings)
        middle = translation.search_middle(response, placed, frame.shape, config, by_colour, turn)
    window = search_window(view.window, middle, config)
    maps = confidence_map(window, state.pool, state.weak, state.strong, config)
    score_map = maps.score_map
    if response is not None:
        score_map += translation.score(response, middle, config)
    # Last: the sum before is then rounded as it is in a video without channels.
    if by_colour is not None:
        score_map += by_colour(*displacements(config.search_grid, middle))
    # The translation filter's response is smooth, which the votes are not.
    subcell = response is not None
    displacement = find_peak(
        score_map, placed, frame.shape, config, subcell=subcell, middle=middle, turn=turn
    )
    row, column = jnp.round(displacement).astype(jnp.int32) - middle
    noisy_or, part_scores = maps.at(
        row + config.search_grid.margin_rows, column + config.search_grid.margin_columns, config
    )
    moved = _move(placed, displacement, turn, frame.shape, config)
    unknown = jnp.full_like(noisy_or, jnp.nan)
    of_filter = _of_filter(state, view, displacement, config)
    here = Candidate(moved, noisy_or, unknown, part_scores, responses=of_filter)
    of_cell = cell_aspect(placed.shown, config.grid)
    return _measured(state, here, displacement, view, of_cell, frame.shape, config)


def _of_filter(
    state: State, view: _View, displacement: Float[Array, "2"], config: Config
) -> Float[Array, ""] | None:
    """What the translation filter responds at a displacement, in cells: [], None without it."""
    if not (state.translation and config.translation):
        return None
    assert view.features is not None
    return translation.responses(state.translation, view.features, displacement, config.grid)


def _measured(
    state: State,
    candidate: Candidate,
    displacement: Float[Array, "2"],
    view: _View,
    of_cell: Float[Array, ""],
    frame_shape: tuple[int, ...],
    config: Config,
) -> Candidate:
    """The candidate with its size, angle, confidence and description.

    displacement: [2], of the candidate from the middle of the window, cells. of_cell: aspect ratio
    of these, height over width.
    """
    box, confidence, description = candidate.box, candidate.confidence, None
    descriptions = _describe(view.window, displacement, config)
    similarity = similar_to_first = jnp.ones_like(confidence)
    resized = jnp.array(True)
    if state.verification and config.verification:
        description = _own_scale(descriptions)
        similarity = verification.similarity(state.verification, description, config.verification)
        confidence = verification.score(similarity, config.verification)
        # Where the object is not recognised, behind something perhaps, it keeps its size.
        resized = confidence > config.verification.sure_above
        similar_to_first = state.verification.initial @ description
        if state.rotation:
            # And so it does turned, unless by the template which says that it has turned: the
            # online one may have learned what is in front of it.
            of_first = verification.score(similar_to_first, config.verification)
            resized &= (state.rotation.angle == 0) | (of_first > config.verification.lost_below)
    if state.scale and config.scale:
        steps = scale.estimate(state.scale, descriptions)
        if config.verification is not None:
            steps -= scale.pull(box, state.initial_size, similarity, config.scale)
            steps = jnp.where(resized, steps, 0)
        box = scale.resize(box, steps, frame_shape, config.scale)
    if state.verification and config.verification and config.aspect:
        box = aspect.follow(
            box,
            state.initial_size,
            state.verification,
            similar_to_first,
            resized,
            view.window,
            displacement,
            config.aspect,
            config.grid,
        )
    candidate = candidate._replace(box=box, confidence=confidence, description=description)
    if not (state.rotation and state.verification and config.rotation):
        return candidate._replace(rotation=state.rotation)
    assert description is not None
    rotated = rotation.follow(
        state.rotation,
        description,
        state.verification.initial,
        confidence,
        view.window,
        displacement,
        of_cell,
        config.rotation,
        config.grid,
    )
    return candidate._replace(rotation=rotated)


def _angle(state: State) -> Float[Array, ""] | None:
    """By which the canvas is turned, None where it never is."""
    return None if state.rotation is None else state.rotation.angle


def _turn(
    angle: Float[Array, ""] | None, shown: Float[Array, "4"], config: Config
) -> Float[Array, "2 2"] | None:
    """How it is turned, for displacements on it, or None; shown: what it shows."""
    return None if angle is None else rotation.turn_by(angle, cell_aspect(shown, config.grid))


def _rests(
    known: VerificationState | None, config: Config, candidate: Candidate
) -> Bool[Array, ""]:
    """Whether the frame of this candidate is not learned from."""
    if known is None or config.verification is None:
        return jnp.array(False)
    return verification.may_rest(known, candidate.confidence, config.verification)


def _followed(
    state: State, best: Candidate, config: Config
) -> tuple[State, Candidate, Float[Array, " R"]]:
    """The state that is where the candidate is, and has learned no more than its templates."""
    if state.verification and config.verification:
        assert best.description is not None
        known, _, _ = verification.update(
            state.verification, best.description, best.box, jnp.array(True), config.verification
        )
        state = state._replace(verification=known)
    return _moved(state, best), best, jnp.zeros(len(LABELS), jnp.float32)


def _catching_up(known: VerificationState | None, config: Config) -> Config:
    """The settings by which a frame counts for those before it that were not learned from, too."""
    if known is None:
        return config
    frames = 1 + known.num_rested.astype(jnp.float32)
    groups: dict[str, Any] = {}
    for name in COMPONENTS:
        group = getattr(config, name)
        if hasattr(group, "learning_rate"):
            rate = 1 - (1 - jnp.asarray(group.learning_rate)) ** frames
            groups[name] = dataclasses.replace(group, learning_rate=rate)
    return dataclasses.replace(config, **groups)


def _learned(
    state: State,
    best: Candidate,
    view: _View,
    frame_shape: tuple[int, ...],
    config: Config,
) -> tuple[State, Candidate, Float[Array, " R"]]:
    """The state that has learned the object from the window around its new box, and the noise.

    It has learned nothing where the object is not verified. That is done once more in this window,
    as the size has changed; the candidate has this confidence. It is followed all the same: an
    object that turns is no longer recognised, and still there.
    """
    descriptions = _describe(view.window, jnp.zeros(2, jnp.float32), config)
    caught_up = _catching_up(state.verification, config)
    updated, noise = _update(state, best, view, descriptions, frame_shape, caught_up)
    if not (state.verification and config.verification):
        return updated, best, noise
    with jax.named_scope("gating"):
        known, confidence, learn = verification.update(
            state.verification,
            _own_scale(descriptions),
            best.box,
            jnp.array(False),
            config.verification,
        )

        def choose(new: Any, old: Any) -> Any:
            # What is the same in both, the features above all, is not copied.
            return old if new is old else jnp.where(learn, new, old)

        chosen = jax.tree.map(choose, updated, _moved(state, best))
    return chosen._replace(verification=known), best._replace(confidence=confidence), noise


def _update(
    state: State,
    best: Candidate,
    view: _View,
    descriptions: Float[Array, "S D"],
    frame_shape: tuple[int, ...],
    config: Config,
) -> tuple[State, Float[Array, " R"]]:
    """The state that has learned the object from the window around its new box, and the noise."""
    placed = place(best.box, config, state.initial_size)
    values = responses(training_patches(view.window, placed, frame_shape, config), state.pool)
    weak, strong, noise = _learn(values, state.weak, config)
    updated = _moved(state, best)._replace(weak=weak, strong=strong)
    if state.translation and config.translation:
        assert view.features is not None
        updated = updated._replace(
            translation=translation.update(
                state.translation, view.features, config.translation, config.grid
            )
        )
    if state.colour and config.colour and view.colours is not None:
        updated = updated._replace(
            colour=colour.update(state.colour, view.colours, config.colour, placed, config)
        )
    if state.scale and config.scale:
        updated = updated._replace(scale=scale.update(state.scale, descriptions, config.scale))
    return updated, noise


def _moved(state: State, best: Candidate) -> State:
    """The state that is where the candidate is."""
    return state._replace(box=best.box, rotation=best.rotation)


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


def check_state(state: Any, config: Config) -> None:
    """ValueError unless the state is one that `init` gives with the static fields of config."""
    if not isinstance(state, State):
        raise ValueError(f"state must be a dcs_jax.State, as init gives it, but is {shown(state)}")
    K, N = config.parts, config.selectors
    F = config.pool_size * K * N
    for name, leaf, expected in (
        ("box", state.box, (4,)),
        ("strong.selected", state.strong.selected, (K, N)),
        ("pool.corners", state.pool.corners, (CORNERS, F)),
        ("weak.mean", state.weak.mean, (2, F)),
    ):
        if np.shape(leaf) != expected:
            raise ValueError(
                f"state.{name} must have the shape {expected}, of parts={K}, selectors={N} and "
                f"pool_size={config.pool_size}, but has {np.shape(leaf)}"
            )
    if (state.weak.sigma is None) != (config.weak == "midpoint"):
        raise ValueError(
            f"config.weak is {config.weak!r}, but the state was initialised with another rule"
        )
    for name in ("translation", "colour", "scale", "rotation", "verification"):
        has, wants = getattr(state, name) is not None, getattr(config, name) is not None
        if has != wants:
            raise ValueError(
                f"config.{name} is {'set' if wants else 'None'}, but the state was initialised "
                f"{'with' if has else 'without'} it: expected the components given to init"
            )

    if state.translation and config.translation:
        expected, found = (
            translation.spectrum_shape(config.grid),
            np.shape(state.translation.running.denominator),
        )
        if found != expected:
            raise ValueError(
                f"state.translation must have spectra of the shape {expected}, of the canvas and "
                f"translation.window_factor={config.translation.window_factor:g}, but they have "
                f"{found}"
            )


def _readable(frame: ImageLike | VideoFrame | ColumnSums) -> VideoFrame | ColumnSums:
    if isinstance(frame, (VideoFrame, ColumnSums)):
        return frame
    check_frame(frame)
    return one_frame(jnp.asarray(frame))


def _move(
    placed: Placed,
    displacement: Float[Array, "2"],
    turn: Float[Array, "2 2"] | None,
    frame_shape: tuple[int, ...],
    config: Config,
) -> Float[Array, "4"]:
    """The box moved by a displacement in cells of the canvas; its centre stays in the frame."""
    x, y, w, h = placed.box
    down, right = displacement if turn is None else turned(turn, *displacement)
    _, _, shown_w, shown_h = placed.shown
    x = jnp.clip(x + right * shown_w / config.grid.columns, -w / 2, frame_shape[1] - w / 2)
    y = jnp.clip(y + down * shown_h / config.grid.rows, -h / 2, frame_shape[0] - h / 2)
    return jnp.stack([x, y, w, h])


@jax.jit
def _describe(
    window: Float[Array, "lines_y lines_x"], displacement: Float[Array, "2"], config: Config
) -> Float[Array, "S D"]:
    """What scale filter and verification look at: the patch there at S scales, or at its own."""
    return describe(window, displacement, scale.factors(config.scale), config.grid)


def _own_scale(descriptions: Float[Array, "S D"]) -> Float[Array, " D"]:
    return descriptions[len(descriptions) // 2]


def _info(state: State, best: Candidate, noise: Float[Array, " R"], config: Config) -> StepInfo:
    """The record of one frame."""
    lost, confidence = jnp.array(False), best.confidence
    if state.verification and config.verification:
        lost = verification.is_lost(state.verification, config.verification)
        if best.responses is not None:
            confidence = verification.combine(confidence, best.responses, config.verification)
    box = best.box
    if config.output_size == "initial":
        size = state.initial_size
        box = jnp.concatenate([box[:2] + (box[2:] - size) / 2, size])
    if state.rotation:
        box = rotation.hull(box, state.rotation.angle)
    # Smoothing rounds some scores to just outside.
    noisy_or, part_scores = (jnp.clip(x, 0, 1) for x in (best.noisy_or, best.part_scores))
    return StepInfo(box, confidence, noisy_or, part_scores, lost, noise)
