"""Histograms of colours as a cue."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from layout import reference_settings
from reference import colour as expected
from settings import SMALL_DEFAULT

import dcs_jax
from dcs_jax import ColourHistograms, Config, Verification
from dcs_jax.core.window import ColumnSums, VideoFrame, column_sums, one_frame, place
from dcs_jax.evaluation.metrics import overlap
from dcs_jax.extensions import colour
from dcs_jax.synthetic import render
from dcs_jax.types import ColourState

CONFIG = Config(canvas=(24, 20))
ODD = Config(canvas=(15, 12), translation=None, window_factor=2.2)
BOX = jnp.array([60, 50, 30, 50], jnp.float32)

respond = jax.jit(colour.respond)


@jax.jit
def look(frame: VideoFrame | ColumnSums, box: jax.Array, config: Config) -> jax.Array | None:
    return colour.look(frame, place(box, config).shown, config.grid)


@jax.jit
def init(colours: jax.Array | None, box: jax.Array, config: Config) -> ColourState:
    return colour.init(colours, place(box, config), config)


@jax.jit
def score(
    response: jax.Array, box: jax.Array, config: Config, down: jax.Array, right: jax.Array
) -> jax.Array:
    return colour.score(response, place(box, config), config, down, right)


def random_frame(seed: int) -> np.ndarray:
    """Soft blobs of few colours, so that many are both in the object and around it."""
    random = np.random.default_rng(seed)
    return np.repeat(np.repeat(random.integers(0, 256, (16, 20, 3), np.uint8), 10, 0), 10, 1)


def shown(frame: np.ndarray) -> VideoFrame:
    return one_frame(jnp.asarray(frame))


boxes = st.builds(
    lambda x, y, w, h: jnp.array([x, y, w, h], jnp.float32),
    # Of quarter pixels: no place is rounded otherwise in float32 than in float64.
    x=st.integers(-80, 700).map(lambda x: x / 4),
    y=st.integers(-80, 600).map(lambda y: y / 4),
    w=st.integers(8, 100),
    h=st.integers(8, 100),
)


@pytest.mark.parametrize("config", [CONFIG, ODD], ids=["even", "odd"])
@given(seed=st.integers(0, 2**31), box=boxes)
def test_what_is_seen_and_learned_is_that_of_the_reference(config, seed, box):
    config = dataclasses.replace(config, squareness=0.0)
    settings = reference_settings(config)
    frame = random_frame(seed)
    colours = look(shown(frame), box, config)
    wanted = expected.window_colours(frame, np.asarray(box), settings)
    assert wanted is not None
    # But for pixels whose place is rounded the other way.
    assert (np.asarray(colours) != wanted).any(axis=2).mean() < 0.05
    state = init(colours, box, config)
    for part, of_reference in zip(
        state, expected.init(np.asarray(colours), np.asarray(box), settings), strict=True
    ):
        np.testing.assert_allclose(part, of_reference, atol=1e-5)


@given(
    seed=st.integers(0, 2**31),
    box=boxes,
    down=st.integers(-20, 20),
    right=st.integers(-17, 17),
)
def test_the_score_is_that_of_the_reference(seed, box, down, right):
    config = CONFIG
    assert config.colour
    settings = reference_settings(config)
    first, second = (look(shown(random_frame(number)), box, config) for number in (seed, seed + 1))
    state = init(first, box, config)
    of_reference = expected.init(np.asarray(first), np.asarray(box), settings)
    response = respond(state, second, config.colour)
    wanted = expected.pixel_probabilities(of_reference, np.asarray(second))
    np.testing.assert_allclose(response, config.colour.weight * state.colourful * wanted, atol=2e-3)
    found = score(response, box, config, jnp.array([down, 0.0]), jnp.array([right, 1.0]))
    for i, j, at in ((0, 0, (down, right)), (1, 1, (0, 1))):
        other = expected.score(of_reference, wanted, np.array(at), np.asarray(box), settings)
        np.testing.assert_allclose(found[i, j], other, atol=3e-3)


def test_the_histograms_are_running_means():
    one, other = (look(shown(random_frame(number)), BOX, CONFIG) for number in (1, 2))
    first, second = (init(colours, BOX, CONFIG) for colours in (one, other))
    settings = ColourHistograms(learning_rate=0.25)
    state = jax.jit(colour.update)(first, other, settings, place(BOX, CONFIG), CONFIG)
    for name in ("inside", "outside"):
        mixed = 0.75 * getattr(first, name) + 0.25 * getattr(second, name)
        np.testing.assert_allclose(getattr(state, name), mixed, atol=1e-6)
        np.testing.assert_allclose(getattr(state, name).sum(), 1, atol=1e-5)
    assert state.colourful == first.colourful


def test_a_red_object_is_found_by_its_colour_where_it_has_moved():
    assert CONFIG.colour
    frame = np.full((160, 200, 3), (40, 90, 60), np.uint8)
    frame[50:100, 60:90] = (200, 40, 40)
    state = init(look(shown(frame), BOX, CONFIG), BOX, CONFIG)
    moved = np.roll(frame, (9, -12), (0, 1))
    response = respond(state, look(shown(moved), BOX, CONFIG), CONFIG.colour)
    down, right = jnp.arange(-20.0, 21), jnp.arange(-17.0, 18)
    found = np.asarray(score(response, BOX, CONFIG, down, right)) / CONFIG.colour.weight
    # All places whose inner part is in the object are as good.
    best = np.argwhere(found > found.max() - 1e-4).mean(0) - (20, 17)
    _, _, width, height = place(BOX, CONFIG).shown
    np.testing.assert_allclose(best, (9 * 24 / height, -12 * 20 / width), atol=1)
    assert found.max() > 0.99
    assert found.min() < 0.05


@pytest.mark.parametrize("value", [0, 90, 255])
def test_equal_channels_count_nothing(value):
    frame = random_frame(3)[..., :1].repeat(3, axis=2)
    frame[:40] = value
    assert init(look(shown(frame), BOX, CONFIG), BOX, CONFIG).colourful == 0


def test_what_is_little_colourful_counts_little():
    frame = random_frame(3)[..., :1].repeat(3, axis=2) // 2
    tinted = frame + np.array([4, 0, 0], np.uint8)
    state = init(look(shown(tinted), BOX, CONFIG), BOX, CONFIG)
    np.testing.assert_allclose(state.colourful, 0.5)
    assert init(look(shown(random_frame(3)), BOX, CONFIG), BOX, CONFIG).colourful == 1


@pytest.fixture(scope="module")
def clip():
    return render(20, (120, 160), (36, 30))


def test_a_grey_video_is_tracked_as_its_equal_channels_are(clip):
    grey = clip.frames[..., 1]
    alone = dcs_jax.track_sequence(grey, clip.boxes[0], config=SMALL_DEFAULT)
    channels = grey[..., None].repeat(3, axis=3)
    in_three = dcs_jax.track_sequence(channels, clip.boxes[0], config=SMALL_DEFAULT)
    np.testing.assert_array_equal(alone.boxes, in_three.boxes)
    without = dataclasses.replace(SMALL_DEFAULT, colour=None)
    plain = dcs_jax.track_sequence(grey, clip.boxes[0], config=without)
    np.testing.assert_array_equal(alone.boxes, plain.boxes)


def test_a_batch_that_shares_its_frames_sees_their_colours(clip):
    """Many boxes share column sums, which have grey values alone."""
    boxes = np.repeat(clip.boxes[:1], 6, axis=0)
    boxes[1:, 0] += np.arange(5)
    together = dcs_jax.track_batch(clip.frames, boxes, jax.random.key(0), SMALL_DEFAULT)
    alone = dcs_jax.track_sequence(clip.frames, boxes[0], jax.random.key(0), SMALL_DEFAULT)
    without = dataclasses.replace(SMALL_DEFAULT, colour=None)
    grey = dcs_jax.track_sequence(clip.frames, boxes[0], jax.random.key(0), without)
    np.testing.assert_array_equal(together.boxes[0], alone.boxes)
    assert np.abs(grey.boxes - alone.boxes).max() > 0.01


def test_the_sums_of_a_frame_have_its_colours(clip):
    of_sums = look(column_sums(jnp.asarray(clip.frames[0])), BOX, CONFIG)
    np.testing.assert_array_equal(of_sums, look(shown(clip.frames[0]), BOX, CONFIG))


def test_colours_are_learned_only_where_the_object_is_verified(clip):
    for learn_above, learned in ((0.4, True), (1.0, False)):
        gates = Verification(learn_above=learn_above, learn_every=1)
        config = dataclasses.replace(SMALL_DEFAULT, verification=gates)
        before = dcs_jax.init(clip.frames[0], clip.boxes[0], jax.random.key(0), config)
        after, _ = dcs_jax.step(before, clip.frames[1], config)
        assert before.colour
        assert after.colour
        assert bool((before.colour.inside != after.colour.inside).any()) == learned


def disc_of_changing_texture() -> tuple[np.ndarray, np.ndarray]:
    """Frames, and boxes [T, 4], of a disc of its own colour, as bright as what is around it."""
    random = np.random.default_rng(0)
    rows, columns = np.mgrid[:120, :200]
    background, frames, boxes = random.integers(60, 140, (120, 200)), [], []
    for t in range(40):
        x, y = 40 + 2.5 * t, 60 + 12 * np.sin(t / 6)
        disc = (rows - y) ** 2 + (columns - x) ** 2 < 15**2
        grey = np.where(disc, random.integers(60, 140, disc.shape), background)
        tint = np.where(disc[..., None], (25, -8, -30), (-12, 8, 10))
        frames.append(np.clip(grey[..., None] + tint, 0, 255).astype(np.uint8))
        boxes.append((x - 15, y - 15, 30, 30))
    return np.stack(frames), np.array(boxes)


@pytest.mark.parametrize(("component", "held"), [(ColourHistograms(), True), (None, False)])
def test_an_object_of_changing_texture_is_followed_by_its_colour(component, held):
    frames, truth = disc_of_changing_texture()
    # No template knows it again, and no scale filter its size.
    config = dataclasses.replace(
        SMALL_DEFAULT, colour=component, scale=None, verification=None, redetection=None
    )
    track = dcs_jax.track_sequence(frames, truth[0], config=config)
    assert (overlap(np.asarray(track.boxes), truth)[-10:].min() > 0.5) == held
