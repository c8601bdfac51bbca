"""The rendered clip: its frames show what it states about itself."""

from typing import Any

import cv2
import numpy as np
import pytest

from dcs_jax.synthetic import render

PLAIN: dict[str, Any] = {"occlusion": 0.0, "lookalike": False, "cloud": 0.0, "noise": 0.0}


def test_shapes_and_types():
    clip = render(5, (60, 90), (20, 30))
    assert clip.frames.shape == (5, 60, 90, 3)
    assert clip.frames.dtype == np.uint8
    assert clip.boxes.shape == clip.lookalike.shape == (5, 4)
    assert clip.occluded.shape == clip.light.shape == (5,)
    assert {field.dtype for field in clip[1:]} == {np.dtype(np.float32)}


def test_same_seed_same_bytes():
    first, second, other = (render(6, (60, 80), (20, 16), seed=seed) for seed in (3, 3, 4))
    for one, two in zip(first, second, strict=True):
        assert np.asarray(one).tobytes() == np.asarray(two).tobytes()
    assert first.frames.tobytes() != other.frames.tobytes()


def test_the_noise_does_not_change_the_scene():
    clean, noisy = (render(4, (60, 80), (20, 16), noise=noise) for noise in (0.0, 3.0))
    np.testing.assert_array_equal(clean.boxes, noisy.boxes)
    difference = noisy.frames.astype(float) - clean.frames
    assert np.std(difference) == pytest.approx(3.0, abs=0.3)
    assert np.abs(difference.mean()) < 0.1


@pytest.mark.parametrize("size", [(240, 320), (480, 200), (70, 70)])
@pytest.mark.parametrize("target", [(64, 48), (8, 70)])
def test_the_target_stays_in_the_frame(size, target):
    boxes = render(40, size, target, speed=12).boxes
    assert (boxes[:, :2] >= 0).all()
    assert (boxes[:, 0] + boxes[:, 2] <= size[1]).all()
    assert (boxes[:, 1] + boxes[:, 3] <= size[0]).all()
    np.testing.assert_array_equal(boxes[:, 2:], np.tile(target[::-1], (40, 1)))


def test_speed_is_a_bound_and_zero_is_still():
    moving = render(60, speed=4, **PLAIN).boxes
    steps = np.hypot(*np.diff(moving[:, :2], axis=0).T)
    assert 1 < steps.max() <= 4.001
    still = render(10, speed=0, **PLAIN)
    assert (still.frames == still.frames[0]).all()
    assert (still.boxes == still.boxes[0]).all()


def test_boxes_enclose_the_target():
    clip = render(40, (120, 160), (40, 30), speed=10, **PLAIN)
    ground = np.median(clip.frames, axis=0)  # the target covers no pixel half of the time
    for frame, (x, y, w, h) in zip(clip.frames, clip.boxes, strict=True):
        rows, columns = np.nonzero(np.abs(frame - ground).max(axis=2) > 0)
        assert np.floor(x) <= columns.min() < x + 2
        assert np.floor(y) <= rows.min() < y + 2
        assert x + w - 2 < columns.max() + 1 <= np.ceil(x + w)
        assert y + h - 2 < rows.max() + 1 <= np.ceil(y + h)


def test_boxes_move_as_the_texture_does():
    """Registration to a fraction of a pixel finds the motion that the boxes state."""
    clip = render(8, (160, 200), (90, 80), speed=3, **PLAIN)
    grey = clip.frames.astype(np.float32).mean(axis=3)
    x, y, w, h = clip.boxes[0].round().astype(int)
    corner = np.array([x + 8, y + 8])
    template = grey[0, y + 8 : y + h - 8, x + 8 : x + w - 8]
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-6)
    no_mask: Any = None
    for box, frame in zip(clip.boxes, grey, strict=True):
        stated = box[:2] - clip.boxes[0, :2]
        guess = np.eye(2, 3, dtype=np.float32)
        guess[:, 2] = stated.round() + corner
        _, found = cv2.findTransformECC(
            template, frame, guess, cv2.MOTION_TRANSLATION, criteria, no_mask, 1
        )
        np.testing.assert_allclose(found[:, 2] - corner, stated, atol=0.06)


def test_occlusion_reaches_the_stated_fraction_once():
    clip = render(100, occlusion=0.6)
    assert clip.occluded.max() == pytest.approx(0.6, abs=0.05)
    changes = np.abs(np.diff((clip.occluded > 0).astype(int))).sum()
    assert changes == 2
    assert clip.occluded[[0, -1]].tolist() == [0, 0]


def test_every_effect_can_be_switched_off():
    clip = render(30, occlusion=0, lookalike=False, cloud=0)
    assert not clip.occluded.any()
    assert np.isnan(clip.lookalike).all()
    assert (clip.light == 1).all()


def test_the_cloud_darkens_frames_in_proportion():
    bright, dark = (
        render(60, (60, 80), (20, 16), **(PLAIN | {"cloud": cloud})) for cloud in (0, 0.5)
    )
    ratio = dark.frames.mean(axis=(1, 2, 3)) / bright.frames.mean(axis=(1, 2, 3))
    np.testing.assert_allclose(ratio, dark.light, atol=0.01)
    assert dark.light.min() == pytest.approx(0.5, abs=0.01)


def test_the_lookalike_passes_near_without_touching():
    clip = render(100)
    offset = np.abs(clip.lookalike[:, :2] - clip.boxes[:, :2])
    near = offset[:, 0] < clip.boxes[0, 2]
    assert near.any()
    assert not near.all()
    assert (offset[:, 1] > clip.boxes[:, 3]).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"length": 0}, "length is 0"),
        ({"size": (50, 80)}, "target is 64 x 48 pixels"),
        ({"target": (3, 10)}, "target is 3 x 10 pixels"),
        ({"speed": -1.0}, "speed -1.0"),
        ({"noise": float("nan")}, "noise nan"),
        ({"occlusion": 1.5}, "occlusion is 1.5"),
        ({"cloud": 1.0}, "cloud 1.0"),
    ],
)
def test_arguments_out_of_range(arguments, message):
    with pytest.raises(ValueError, match=message):
        render(**arguments)
