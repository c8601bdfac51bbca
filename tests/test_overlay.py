"""Boxes on frames, videos of them, and the film strip."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from dcs_jax.cli.film_strip import Span, film_strip, write_image
from dcs_jax.io.frames import open_source
from dcs_jax.io.overlay import TRACKED, TRUTH, VideoWriter, draw_box, draw_track
from dcs_jax.synthetic import render


def is_colour(image, colour, tolerance=40):
    return (np.abs(image.astype(int) - colour) < tolerance).all(axis=-1)


@pytest.fixture(scope="module")
def clip():
    return render(24, (96, 128), (32, 24))


@pytest.mark.parametrize("size", [(240, 320), (2160, 3840)])
def test_box_is_drawn_at_its_position(size):
    frame = np.full((*size, 3), 90, np.uint8)
    unit = size[0] // 240
    x, y, w, h = box = np.array([100, 60, 80, 120]) * unit
    draw_box(frame, box, TRACKED)
    rows, columns = np.nonzero(is_colour(frame, TRACKED))
    extent = columns.min(), rows.min(), columns.max() + 1, rows.max() + 1
    np.testing.assert_allclose(extent, (x, y, x + w, y + h), atol=1 + 4 * unit)
    assert (frame[y + h // 2, x + w // 2] == 90).all()


@pytest.mark.parametrize("box", [(-20, -20, 60, 60), (300, 200, 60, 60), (-1e6, -1e6, 3e6, 3e6)])
def test_box_and_label_across_the_edge(box):
    frame = np.full((240, 320, 3), 90, np.uint8)
    draw_box(frame, box, TRACKED, "0.93")
    assert is_colour(frame, TRACKED).sum() > 200  # the label is inside, wherever the box is


def test_unlabelled_box_is_not_drawn():
    frame = np.full((240, 320, 3), 90, np.uint8)
    draw_box(frame, [np.nan] * 4, TRUTH)
    assert (frame == 90).all()


def test_a_confidence_of_nan_is_not_drawn(clip):
    with_label = draw_track(clip.frames[0], clip.boxes[0], 0.5)
    without = draw_track(clip.frames[0], clip.boxes[0], float("nan"))
    expected = clip.frames[0].copy()
    draw_box(expected, clip.boxes[0], TRACKED)
    np.testing.assert_array_equal(without, expected)
    assert (with_label != without).any()


def test_draw_track_does_not_change_the_frame(clip):
    before = clip.frames[0].copy()
    drawn = draw_track(clip.frames[0], clip.boxes[0] + 6, 0.5, clip.boxes[0])
    np.testing.assert_array_equal(clip.frames[0], before)
    assert is_colour(drawn, TRACKED).any()
    assert is_colour(drawn, TRUTH).any()


def write_video(path, frames, fps=25):
    with VideoWriter(path, frames[0].shape, fps) as writer:
        for frame in frames:
            writer.write(frame)


@pytest.mark.parametrize("name", ["clip.mp4", "clip.mkv", "clip.avi"])
def test_video_can_be_read_again(tmp_path, clip, name):
    write_video(tmp_path / name, clip.frames)
    source = open_source(tmp_path / name)
    assert (source.shape, source.length, source.fps) == ((96, 128, 3), 24, 25)
    for found, written in zip(source, clip.frames, strict=True):
        assert np.abs(found.astype(int) - written).mean() < 12


@pytest.mark.parametrize("name", ["clip.mp4", "clip.avi"])
def test_video_of_odd_size_loses_its_last_row_and_column(tmp_path, clip, name):
    frame = clip.frames[0, :95, :127]
    with VideoWriter(tmp_path / name, frame.shape) as writer:
        writer.write(frame)
    (found,) = open_source(tmp_path / name)
    assert found.shape == (94, 126, 3)
    assert np.abs(found.astype(int) - frame[:94, :126]).mean() < 12


def test_video_that_cannot_be_written(tmp_path):
    with pytest.raises(ValueError, match=r"must end in one of \.mp4"):
        VideoWriter(tmp_path / "clip.gif", (96, 128, 3))
    with pytest.raises(FileNotFoundError, match="No such file"):
        VideoWriter(tmp_path / "no" / "clip.mp4", (96, 128, 3))


@pytest.mark.parametrize("fps", [211.222, 24000 / 1001, 0.5, 1000])
def test_any_frame_rate(tmp_path, clip, fps):
    write_video(tmp_path / "clip.mp4", clip.frames, fps)
    source = open_source(tmp_path / "clip.mp4")
    assert source.length == len(list(source)) == len(clip.frames)
    assert source.fps == pytest.approx(fps, rel=1e-3)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no disk that is always full")
@pytest.mark.parametrize("suffix", ["mp4", "mkv", "avi"])
def test_full_disk_is_an_error(tmp_path, clip, suffix):
    path = tmp_path / f"clip.{suffix}"
    path.symlink_to("/dev/full")
    with pytest.raises(OSError, match="No space left"):
        write_video(path, clip.frames)
    assert not path.is_symlink()


@pytest.mark.parametrize("with_truth", [True, False])
def test_film_strip_shows_frames_and_curves(tmp_path, clip, with_truth):
    spans = [Span("occlusion", 5, 12)]
    strip = film_strip(
        clip.frames,
        clip.boxes + 3,
        np.linspace(1, 0.2, 24),
        part_scores=np.full((24, 5), 0.5),
        truth=clip.boxes if with_truth else None,
        spans=spans,
        title="Title",
    )
    assert strip.shape[1:] == (1200, 3)
    assert strip.dtype == np.uint8
    assert is_colour(strip, TRACKED).sum() > 2000
    assert is_colour(strip, TRUTH, 20).any()
    write_image(tmp_path / "strip.png", strip)
    found = cv2.imread(str(tmp_path / "strip.png"), cv2.IMREAD_COLOR_RGB)
    np.testing.assert_array_equal(found, strip)


def test_film_strip_shades_spans_and_skips_missing_labels(clip):
    truth = clip.boxes.copy()
    truth[1::2] = np.nan
    arguments = (clip.frames, clip.boxes, np.ones(24))
    plain = film_strip(*arguments, truth=truth)
    shaded = film_strip(*arguments, truth=truth, spans=[Span("cloud", 6, 18)])
    assert plain.shape == shaded.shape
    columns = np.nonzero((plain != shaded).any(axis=(0, 2)))[0]
    assert columns.size


@pytest.mark.parametrize("part_scores", [None, np.full((24, 5), 0.5)])
@pytest.mark.parametrize("with_truth", [True, False])
def test_film_strip_without_confidence(clip, part_scores, with_truth):
    """The curve of the confidence is left out; with some values, only the others are."""
    truth = clip.boxes if with_truth else None
    rows = {}
    for name, confidence in (
        ("all", np.linspace(0, 1, 24)),
        ("some", np.where(np.arange(24) % 12 < 6, 0.5, np.nan)),
        ("none", np.full(24, np.nan)),
    ):
        strip = film_strip(
            clip.frames, clip.boxes, confidence, part_scores=part_scores, truth=truth
        )
        rows[name] = len(strip)
    assert rows["some"] == rows["all"]
    assert (rows["none"] < rows["all"]) == (part_scores is None)


@pytest.mark.parametrize("length", [1, 3])
def test_film_strip_of_few_frames(clip, length):
    strip = film_strip(clip.frames[:length], clip.boxes[:length], np.ones(length))
    assert is_colour(strip, TRACKED).any()


def test_image_that_cannot_be_written(tmp_path):
    with pytest.raises(ValueError, match="cannot be written as an image"):
        write_image(tmp_path / "no" / "strip.png", np.zeros((4, 4, 3), np.uint8))
