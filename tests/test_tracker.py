"""init and step as a whole: against the reference, and what must not change a track."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from hypothesis import given
from hypothesis import strategies as st
from layout import in_reference_order, reference_at, reference_pool, reference_settings
from sequences import load
from settings import SMALL, SMALL_DEFAULT, WITHOUT_COMPONENTS

import dcs_jax
from dcs_jax import Config
from dcs_jax.core.haar import draw_pool
from dcs_jax.evaluation.metrics import mean_centre_error, overlap
from dcs_jax.runners.sequence import init_track
from dcs_jax.synthetic import render

init = jax.jit(dcs_jax.init)
step = jax.jit(dcs_jax.step)


@pytest.fixture(scope="module")
def clip():
    return render(40, (120, 160), (36, 30))


def column_patterns(tracker: reference.Tracker, frame, selected) -> np.ndarray:
    """The votes [K, N, L] of the selected columns on the frame's training samples."""
    tracker.selected = np.asarray(selected, np.int64)
    samples = tracker.training_samples(tracker.window(frame, tracker.box), frame.shape)
    votes = reference.votes(samples, tracker.means, tracker.sigma)
    return votes[tracker.selected_features()]


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"weak": "gaussian"},
        {"selector": "error"},
        {"selector": "first"},
        {"selector": "mil"},
        {"parts": 9},
        {"overhang": 0.3, "prior": 0.0},
        {"canvas": (23, 17), "window_factor": 2.5},
    ],
    ids=lambda changes: "-".join(f"{name}={value}" for name, value in changes.items()) or "small",
)
def test_a_step_from_the_same_state_is_that_of_the_reference(clip, changes):
    config = dataclasses.replace(SMALL, **changes)
    state = init(clip.frames[0], clip.boxes[0], jax.random.key(1), config)
    for frame in clip.frames[1:6]:
        tracker = reference_at(state, config)
        expected = tracker.step(frame)
        state, info = step(state, frame, config)
        np.testing.assert_allclose(info.box, expected.box, atol=1e-3)
        np.testing.assert_allclose(info.part_scores, expected.part_scores, atol=0.02)
        assert info.noisy_or == pytest.approx(expected.noisy_or, abs=1e-3)
        means = in_reference_order(state.weak.mean, config)
        np.testing.assert_allclose(means, tracker.means, atol=0.05)
        np.testing.assert_array_equal(
            column_patterns(tracker, frame, state.strong.selected),
            column_patterns(tracker, frame, tracker.selected),
        )


def test_init_is_that_of_the_reference(clip):
    # Of this key no vote is on a threshold, where rounding would decide it.
    state = init(clip.frames[0], clip.boxes[0], jax.random.key(3), SMALL)
    pool = reference_pool(draw_pool(jax.random.key(3), SMALL), SMALL)
    tracker = reference.Tracker.init(clip.frames[0], clip.boxes[0], pool, reference_settings(SMALL))
    means, correct = (in_reference_order(x, SMALL) for x in (state.weak.mean, state.weak.correct))
    np.testing.assert_allclose(means, tracker.means, rtol=1e-3, atol=0.02)
    np.testing.assert_allclose(correct, tracker.correct)
    np.testing.assert_array_equal(state.strong.selected, tracker.selected)
    np.testing.assert_allclose(state.strong.alpha, tracker.alpha, rtol=1e-4)


def assert_30_frames_equal(frames, box):
    config = Config(**WITHOUT_COMPONENTS)
    state = init(frames[0], np.float32(box), jax.random.key(0), config)
    tracker = reference_at(state, config)
    _, infos = dcs_jax.track_chunk(state, frames[1:31], config)
    expected = [tracker.step(frame).box for frame in frames[1:31]]
    np.testing.assert_allclose(infos.box, expected, atol=0.05)


def test_30_frames_of_a_rendered_clip_are_those_of_the_reference():
    clip = render(31, seed=3)
    assert_30_frames_equal(clip.frames, clip.boxes[0])


def test_30_frames_of_a_real_sequence_are_those_of_the_reference():
    frames, truth = load("david", 31)
    assert_30_frames_equal(frames, truth[0])


def test_30_frames_on_the_pixel_grid_are_each_that_of_the_reference():
    frames, truth = load("david", 31)
    config = Config.paper().resolve(truth[0])
    state = init(frames[0], np.float32(truth[0]), jax.random.key(0), config)
    for frame in frames[1:]:
        # From the same state each time: on whole pixels some responses lie right on a threshold,
        # so that rounding decides a vote in ten thousand, and two runs would part by a pixel.
        expected = reference_at(state, config).step(frame).box
        state, info = step(state, frame, config)
        np.testing.assert_allclose(info.box, expected, atol=0.05)


@pytest.mark.parametrize("preset", [Config(), Config.paper()], ids=["default", "paper"])
def test_moving_frame_and_box_together_moves_the_track(preset):
    clip = render(12, (160, 200), (40, 32), seed=1)
    wide = np.pad(clip.frames, ((0, 0), (7, 0), (12, 0), (0, 0)), mode="edge")
    here = dcs_jax.track_sequence(clip.frames, clip.boxes[0], config=preset)
    there = dcs_jax.track_sequence(wide, clip.boxes[0] + np.float32([12, 7, 0, 0]), config=preset)
    np.testing.assert_allclose(there.boxes, here.boxes + np.float32([12, 7, 0, 0]), atol=0.1)


@pytest.mark.parametrize(
    "preset",
    [Config(), Config.paper(), Config(selector="error"), Config(weak="gaussian")],
    ids=["default", "paper", "error", "gaussian"],
)
def test_a_still_scene_never_drifts(preset):
    clip = render(1, (160, 200), (40, 32), speed=0, noise=0)
    still = np.repeat(clip.frames, 101, axis=0)
    track = dcs_jax.track_sequence(still, clip.boxes[0], config=preset)
    assert np.abs(track.boxes - clip.boxes[0]).max() < 0.5


def test_a_narrow_box_is_followed_when_the_camera_jerks_by_more_than_its_width():
    clip = render(40, (160, 220), (64, 14), speed=1, occlusion=0, lookalike=False, cloud=0, seed=2)
    jerks = 18 * (np.arange(40) // 3 % 2)
    frames = [np.roll(frame, jerk, axis=1) for frame, jerk in zip(clip.frames, jerks, strict=True)]
    truth = clip.boxes + jerks[:, None] * np.float32([1, 0, 0, 0])

    def errors(config):
        track = dcs_jax.track_sequence(np.stack(frames), truth[0], config=config)
        return np.linalg.norm(track.boxes[:, :2] - truth[:, :2], axis=1)

    assert errors(Config()).max() < 2
    # By its shape alone, for the rendered target is also known by its colours.
    assert errors(Config(colour=None)).max() < 2
    # The window around the box itself is as narrow as the box.
    assert errors(Config(colour=None, squareness=0.0)).max() > 14


def test_a_box_may_be_four_numbers_under_jit(clip):
    box = tuple(clip.boxes[0].tolist())
    key = jax.random.key(1)
    expected = init(clip.frames[0], clip.boxes[0], key, SMALL)
    found = init(clip.frames[0], box, key, SMALL)
    assert jax.tree.all(jax.tree.map(lambda one, other: (one == other).all(), found, expected))
    mixed = jax.eval_shape(lambda x: dcs_jax.init(clip.frames[0], (x, 40, 30, 20), key, SMALL), 3)
    assert mixed.box.dtype == jnp.float32


@pytest.mark.parametrize(
    ("box", "message"),
    [
        ((1.0, 2.0, 30.0), r"four finite numbers .* shape \(3,\)"),
        ((1.0, 2.0, 30.0, np.ones(2)), "four finite numbers"),
        ((1.0, 2.0, 30.0, 1j), "four finite numbers"),
        (np.ones((2, 4)), r"four finite numbers .* shape \(2, 4\)"),
        (np.ones(4, bool), "four finite numbers"),
    ],
)
def test_bad_boxes_are_refused_under_jit(clip, box, message):
    with pytest.raises(ValueError, match=message):
        jax.eval_shape(dcs_jax.init, clip.frames[0], box, jax.random.key(0), SMALL)


FLAT = np.zeros((160, 200, 3), np.uint8)
SLOPE = np.broadcast_to(np.arange(200, dtype=np.uint8)[:, None], FLAT.shape)
NOISE = np.random.default_rng(0).integers(0, 256, FLAT.shape, np.uint8)


@pytest.mark.parametrize("preset", [Config(), Config.paper()], ids=["default", "paper"])
@pytest.mark.parametrize(
    "kinds",
    [(FLAT,), (FLAT + np.uint8(255),), (SLOPE,), (FLAT, NOISE), (NOISE, FLAT, NOISE)],
    ids=["black", "white", "slope", "black, then noise", "noise, with a gap"],
)
def test_nothing_to_see_gives_finite_boxes(preset, kinds):
    frames = np.concatenate([np.repeat(kind[None], 6, axis=0) for kind in kinds])
    track = dcs_jax.track_sequence(frames, (80, 60, 40, 32), config=preset)
    assert np.isfinite(track.boxes).all()
    assert np.isfinite(track.noisy_or).all()
    if preset.verification is not None:
        assert np.isfinite(track.confidence).all()
    if kinds[0] is FLAT and preset.verification is not None:
        assert track.lost[-1]  # it has never been seen


KINDS = {
    "black": np.zeros((60, 80), np.uint8),
    "white": np.full((60, 80), 255, np.uint8),
    "grey": np.full((60, 80), 90, np.uint8),
    "slope": np.broadcast_to(np.arange(80, dtype=np.uint8) * np.uint8(3), (60, 80)),
    "noise": NOISE[:60, :80, 0],
    "one pixel": np.eye(60, 80, 79, np.uint8) * np.uint8(255),
}


def assert_finite(tree):
    for path, leaf in jax.tree_util.tree_leaves_with_path(tree):
        assert np.isfinite(leaf).all(), jax.tree_util.keystr(path)


@pytest.mark.parametrize(
    ("preset", "channels"),
    [
        (Config(), (3,)),
        (Config.paper().resolve((0, 0, 20, 24)), ()),
        (SMALL_DEFAULT, ()),
        (SMALL, (3,)),
    ],
    ids=["default", "paper", "small default", "small paper"],
)
@given(
    kinds=st.lists(st.sampled_from(list(KINDS)), min_size=3, max_size=3),
    x=st.floats(-19, 79, width=32),
    y=st.floats(-23, 59, width=32),
    seed=st.integers(0, 9),
)
def test_whatever_is_seen_all_is_finite(preset, channels, kinds, x, y, seed):
    frames = np.stack([np.broadcast_to(KINDS[kind].T, (*channels, 80, 60)).T for kind in kinds])
    state, first = init_track(frames[0], np.float32([x, y, 20, 24]), jax.random.key(seed), preset)
    assert_finite(state)
    after, rest = dcs_jax.track_chunk(state, frames[1:], preset)
    assert_finite(after)
    for info in (first, rest):
        unknown = {"confidence"} if preset.verification is None else set()
        assert_finite({name: v for name, v in info._asdict().items() if name not in unknown})
        assert np.isnan(info.confidence).all() == (preset.verification is None)
        for scores in (info.noisy_or, info.part_scores):
            assert ((scores >= 0) & (scores <= 1)).all()
    centres = rest.box[:, :2] + rest.box[:, 2:] / 2
    assert (centres >= -1e-3).all()
    assert (centres <= np.array([80, 60]) + 1e-3).all()


def test_a_constant_added_to_all_grey_values_changes_no_bit():
    clip = render(15, (120, 160), (36, 30))
    dim = clip.frames // 2
    here = dcs_jax.track_sequence(dim, clip.boxes[0], config=SMALL)
    brighter = dcs_jax.track_sequence(dim + np.uint8(90), clip.boxes[0], config=SMALL)
    for one, other in zip(here, brighter, strict=True):
        np.testing.assert_array_equal(one, other)


def test_jit_and_no_jit_agree():
    # Without jit every operation of every loop is dispatched on its own.
    clip = render(2, (48, 64), (16, 14))
    config = Config(
        canvas=12,
        window_factor=1.5,
        parts=1,
        selectors=3,
        pool_size=6,
        iterations=2,
        first_updates=3,
        scale=dcs_jax.ScaleFilter(num_scales=3),
    )
    key = jax.random.key(0)
    with jax.disable_jit():
        plain = dcs_jax.init(clip.frames[0], clip.boxes[0], key, config)
        _, plain_info = dcs_jax.step(plain, clip.frames[1], config)
    compiled = init(clip.frames[0], clip.boxes[0], key, config)
    _, compiled_info = step(compiled, clip.frames[1], config)
    np.testing.assert_array_equal(plain.strong.selected, compiled.strong.selected)
    np.testing.assert_allclose(plain_info.box, compiled_info.box, atol=1e-3)


@pytest.mark.parametrize("config", [SMALL, SMALL_DEFAULT], ids=["paper", "default"])
def test_tracks_under_vmap_are_the_single_tracks(clip, config):
    keys = jax.random.split(jax.random.key(5), 3)
    starts = jnp.asarray(clip.boxes[0]) + jnp.arange(3.0)[:, None] * jnp.array([1.0, 2, 3, -2])
    init_many = jax.jit(jax.vmap(dcs_jax.init, (None, 0, 0, None)))
    step_many = jax.jit(jax.vmap(dcs_jax.step, (0, None, None)))
    states = init_many(clip.frames[0], starts, keys, config)
    _, infos = step_many(states, clip.frames[1], config)
    for number in range(3):
        state = init(clip.frames[0], starts[number], keys[number], config)
        _, info = step(state, clip.frames[1], config)
        np.testing.assert_allclose(infos.box[number], info.box, atol=1e-3)


def test_a_number_of_the_settings_can_be_swept_under_vmap(clip):
    state = init(clip.frames[0], clip.boxes[0], jax.random.key(0), SMALL)
    priors = jnp.array([0.0, 1.0, 1e6])

    @jax.jit
    @jax.vmap
    def step_with(prior):
        return dcs_jax.step(state, clip.frames[3], dataclasses.replace(SMALL, prior=prior))[1]

    swept = step_with(priors)
    assert (swept.box[0] != clip.boxes[0]).any()
    # So strong a prior forbids any motion.
    np.testing.assert_allclose(swept.box[2], clip.boxes[0], atol=1e-3)


@pytest.mark.parametrize(
    "box",
    [
        (-15, -10, 40, 40),
        (140, 100, 40, 40),
        (5, 5, 150, 110),
        (0, 0, 160, 120),
        (-20, -20, 220, 180),
        (60, 50, 4, 4),
        (60, 50, 90, 5),
    ],
)
@pytest.mark.parametrize(
    "preset",
    [
        SMALL,
        dataclasses.replace(SMALL_DEFAULT, output_size="initial"),
        Config.paper(selectors=4, pool_size=10),
    ],
    ids=["small", "default", "paper"],
)
def test_boxes_at_the_edge_and_of_any_size_are_tracked(clip, box, preset):
    track = dcs_jax.track_sequence(clip.frames[:4], box, config=preset)
    assert np.isfinite(track.boxes).all()
    assert ((track.noisy_or >= 0) & (track.noisy_or <= 1)).all()
    if preset.verification is None:
        assert np.isnan(track.confidence).all()
    else:
        assert ((track.confidence >= 0) & (track.confidence <= 1)).all()
    np.testing.assert_allclose(track.boxes[:, 2:], np.tile(box[2:], (4, 1)))


@pytest.mark.parametrize("seed", range(4))
def test_the_rendered_target_is_followed_through_an_occlusion(seed):
    clip = render()
    assert clip.occluded.max() > 0.5
    track = dcs_jax.track_sequence(clip.frames, clip.boxes[0], jax.random.key(seed))
    overlaps = overlap(track.boxes, clip.boxes)
    # Behind the occluder a box may lag; where the target is seen, it is held.
    assert overlaps[clip.occluded == 0].min() > 0.6
    assert mean_centre_error(track.boxes, clip.boxes) < 3


def test_a_native_canvas_must_be_resolved_first(clip):
    with pytest.raises(ValueError, match=r"call config\.resolve\(box\)"):
        dcs_jax.init(clip.frames[0], clip.boxes[0], jax.random.key(0), Config.paper())


@pytest.mark.parametrize("name", ["translation", "colour", "scale", "rotation", "verification"])
def test_state_and_settings_must_have_the_same_components(clip, name):
    changes = {name: None} | ({"redetection": None} if name == "verification" else {})
    without = dataclasses.replace(SMALL_DEFAULT, **changes)
    state = jax.eval_shape(dcs_jax.init, clip.frames[0], clip.boxes[0], jax.random.key(0), without)
    with pytest.raises(ValueError, match=f"config.{name} is set, but .* initialised without it"):
        jax.eval_shape(dcs_jax.step, state, clip.frames[1], SMALL_DEFAULT)
