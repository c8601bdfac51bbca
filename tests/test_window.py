"""The window's integral image, and the limits of motion, against the reference."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
from hypothesis import given
from hypothesis import strategies as st
from layout import reference_settings

from dcs_jax.config import Config
from dcs_jax.core import window
from dcs_jax.core.window import (
    VideoFrame,
    column_sums,
    place,
    reach,
    to_grey,
    window_integral,
)

CONFIG = Config(canvas=(10, 12), window_factor=1.8)
GRID = reference.Grid(*dataclasses.astuple(CONFIG.grid))
HEIGHT, WIDTH = 37, 45
boxes = st.tuples(
    st.floats(-30, 60, width=32),
    st.floats(-30, 50, width=32),
    st.floats(4, 80, width=32),
    st.floats(4, 80, width=32),
)


def random_frame(seed: int, *channels: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (HEIGHT, WIDTH, *channels), np.uint8)


@jax.jit
def integral_of(frame, box):
    return window_integral(column_sums(frame), box, CONFIG.grid)


@jax.jit
def from_a_block(frames, number, box):
    return window_integral(VideoFrame(frames, number), box, CONFIG.grid)


@jax.jit
def from_the_whole_frame(frames, number, box):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(window, "_BLOCKS", (max(frames.shape[1:3]),))
        return window_integral(VideoFrame(frames, number), box, CONFIG.grid)


@jax.jit
def reach_of(box, config):
    return reach(place(box, config), (HEIGHT, WIDTH), config)


@given(box=boxes, seed=st.integers(0, 2**31))
def test_integral_is_exact_area_resampling(box, seed):
    frame, box = random_frame(seed), np.float32(box)
    cells = reference.cell_means(frame, box, GRID)
    integral = np.asarray(integral_of(frame, box), np.float64)
    means = np.diff(np.diff(integral, axis=0), axis=1)
    # A cell is made from four sums, each rounded three times (down, along, pixels to cells) by half
    # a unit in the last place of a float32.
    rounding = 6 * float(np.spacing(np.float32(np.abs(integral).max())))
    np.testing.assert_allclose(means - means[0, 0], cells - cells[0, 0], rtol=0, atol=2 * rounding)
    # Grey values are relative to that of the pixel at the centre of the box.
    window_cells = reference.window_cells(frame, box, GRID)
    np.testing.assert_allclose(means, window_cells, rtol=0, atol=rounding)
    assert not integral[0].any()
    assert not integral[:, 0].any()


@given(seed=st.integers(0, 2**31), top=st.integers(0, 20), left=st.integers(0, 20))
def test_integral_is_exact_on_the_pixel_grid(seed, top, left):
    frame = random_frame(seed)
    box = jnp.array([left, top, 12, 10], jnp.float32)
    margin = CONFIG.grid.margin_rows, CONFIG.grid.margin_columns
    pixels = np.pad(frame.astype(int), 40, mode="edge")[40 + top - margin[0] :]
    pixels = pixels[: CONFIG.grid.window[0], 40 + left - margin[1] :][:, : CONFIG.grid.window[1]]
    means = np.diff(np.diff(np.asarray(integral_of(frame, box)), axis=0), axis=1)
    np.testing.assert_array_equal(means - means[0, 0], pixels - pixels[0, 0])


@given(box=boxes, seed=st.integers(0, 2**31), constant=st.integers(1, 100))
def test_a_constant_added_to_all_grey_values_changes_no_bit(box, seed, constant):
    frame = random_frame(seed) // 2
    box = np.float32(box)
    np.testing.assert_array_equal(
        integral_of(frame, box), integral_of(frame + np.uint8(constant), box)
    )


@given(
    box=boxes, overhang=st.sampled_from([0.0, 0.25]), squareness=st.sampled_from([0.0, 0.5, 1.0])
)
def test_reach_is_that_of_the_reference(box, overhang, squareness):
    box = np.float32(box)
    config = dataclasses.replace(CONFIG, overhang=overhang, squareness=squareness)
    low, high = reach_of(box, config)
    expected = reference.reachable(box, (HEIGHT, WIDTH), reference_settings(config))
    assert [(a, b) for a, b in zip(low.tolist(), high.tolist(), strict=True)] == list(expected)


@given(box=boxes, squareness=st.sampled_from([0.0, 0.3, 1.0]))
def test_the_canvas_shows_a_box_of_the_same_area_and_centre(box, squareness):
    box = np.float32(box)
    config = dataclasses.replace(CONFIG, squareness=squareness)
    shown = np.asarray(place(jnp.asarray(box), config).shown)
    expected = reference.shown_box(box, reference_settings(config))
    np.testing.assert_allclose(shown, expected, rtol=1e-5, atol=1e-4)
    if squareness == 0:
        np.testing.assert_array_equal(shown, box)
    if squareness == 1:
        np.testing.assert_allclose(shown[2], shown[3], rtol=1e-5)


@given(box=boxes, taller=st.floats(0.5, 2, width=32), squareness=st.sampled_from([0.0, 0.3, 1.0]))
def test_the_canvas_gets_narrower_with_the_box(box, taller, squareness):
    """So that it shows an object that has got narrower as it was."""
    config = dataclasses.replace(CONFIG, squareness=squareness)
    x, y, w, h = map(float, box)
    initial_size = jnp.array([w, h / taller], jnp.float32)
    shown = np.asarray(place(jnp.array([x, y, w, h]), config, initial_size).shown)
    of_first = np.asarray(place(jnp.array([x, y, *initial_size]), config).shown)
    np.testing.assert_allclose(shown[2:], of_first[2:] * (1, taller), rtol=1e-5)
    np.testing.assert_allclose(shown[:2] + shown[2:] / 2, (x + w / 2, y + h / 2), atol=1e-3)
    settings = dataclasses.replace(reference_settings(config), initial_size=(w, h / taller))
    expected = reference.shown_box(np.array([x, y, w, h]), settings)
    np.testing.assert_allclose(shown, expected, rtol=1e-5, atol=1e-3)


def test_grey_values_are_those_of_the_reference():
    frame = random_frame(0, 3)
    np.testing.assert_array_equal(to_grey(jnp.asarray(frame)), reference.grey(frame))


@pytest.mark.parametrize("value", [0, 1, 127, 255])
def test_equal_channels_are_their_own_grey_value(value):
    frame = jnp.full((2, 2, 3), value, jnp.uint8)
    assert (to_grey(frame) == value).all()


@given(
    x=st.floats(-60, 700, width=32),
    y=st.floats(-60, 500, width=32),
    w=st.floats(8, 600, width=32),
    h=st.floats(8, 400, width=32),
    number=st.integers(0, 1),
)
def test_a_window_from_a_block_is_that_from_the_whole_frame(x, y, w, h, number):
    frames = np.random.default_rng(0).integers(0, 256, (2, 480, 640, 3), np.uint8)
    box = np.array([x, y, w, h], np.float32)
    # Bit for bit, so that a batch that shares column sums has the boxes of single tracks.
    integral = from_a_block(frames, number, box)
    np.testing.assert_array_equal(integral, integral_of(frames[number], box))
    if w * GRID.window[1] / GRID.columns + 2 <= 512:  # of larger ones not every pixel is read
        np.testing.assert_array_equal(integral, from_the_whole_frame(frames, number, box))


def test_windows_from_blocks_under_vmap_are_the_single_ones():
    frames = np.random.default_rng(0).integers(0, 256, (1, 480, 640), np.uint8)
    many = jnp.array([[10.0, 20, 30, 40], [300, 200, 150, 90], [5, 5, 600, 400]])
    together = jax.jit(jax.vmap(from_a_block, (None, None, 0)))(frames, 0, many)
    for box, integral in zip(many, together, strict=True):
        np.testing.assert_array_equal(integral, from_a_block(frames, 0, box))


def test_of_a_large_window_some_pixels_are_enough():
    rows, columns = np.mgrid[:900, :1200]
    smooth = 128 + 60 * np.sin(rows / 70) + 60 * np.cos(columns / 90)
    frame = smooth.astype(np.uint8)[None]
    # Windows of 540, 900 and, at the frame's edge, 1080 columns.
    for box in ([400.3, 200.9, 300, 250], [350.5, 210.2, 500, 480], [-90.7, 333.1, 600, 500]):
        integral = np.asarray(from_a_block(frame, 0, np.array(box, np.float32)))
        means = np.diff(np.diff(integral, axis=0), axis=1)
        expected = reference.window_cells(frame[0], np.array(box, np.float32), GRID)
        # Of the cells' contrast of some 200; one value a cell would be off by 20.
        np.testing.assert_allclose(means, expected, atol=3)
