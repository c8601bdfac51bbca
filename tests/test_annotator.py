"""The simulated annotator: it draws until all is right, and goes where it is sent."""

import numpy as np
import pytest

from benchmarks.annotator import Labelled, boxes_drawn, follow_doubt, labelled, lines
from dcs_jax.annotate.stretches import unknown

LENGTH = 41


def sequence(*corners):
    """An object that goes on straight lines through these places (x, y), at equal times."""
    times = np.linspace(0, LENGTH - 1, len(corners))
    places = [np.interp(range(LENGTH), times, values) for values in np.transpose(corners)]
    truth = np.column_stack([*places, np.full(LENGTH, 40.0), np.full(LENGTH, 30.0)])
    return Labelled("drawn", np.zeros((LENGTH, 120, 400, 3), np.uint8), truth)


@pytest.mark.parametrize(
    ("corners", "boxes"),
    [
        ([(20, 20), (20, 20)], 1),  # it stays: the first box lasts
        ([(20, 20), (300, 20)], 2),
    ],
)
def test_straight_lines_need_a_box_at_either_end(corners, boxes):
    clip = sequence(*corners)
    assert boxes_drawn(clip, lines(clip.frames, 0), 0.9, "last") == boxes


def test_more_overlap_needs_more_boxes():
    clip = sequence((20, 20), (200, 40), (100, 20), (300, 70))
    filler = lines(clip.frames, 0)
    drawn = [boxes_drawn(clip, filler, least) for least in (0.3, 0.6, 0.95)]
    assert drawn == sorted(drawn)
    assert drawn[0] < drawn[-1]


def test_without_a_truth_it_goes_where_the_boxes_are_in_doubt():
    clip = sequence((20, 20), (300, 20))
    straight = lines(clip.frames, 0)

    def filler(stretch):
        """Straight lines, sure between two boxes only."""
        sure = 0.9 if stretch.left and stretch.right else 0.1
        return straight(stretch)._replace(confidence=np.full(stretch.length, sure, np.float32))

    visits = follow_doubt(clip, filler, 0.5)
    assert visits.wrong == visits.visits > 0
    assert visits.before > 0.8
    assert visits.after < visits.before / 2


def test_doubt_without_a_reason_costs_one_visit():
    clip = sequence((20, 20), (20, 20))
    boxes = clip.truth.astype(np.float32)

    def filler(stretch):
        rows = slice(stretch.first, stretch.last + 1)
        nothing = unknown(stretch.length)
        return nothing._replace(
            boxes=boxes[rows], confidence=np.full(stretch.length, 0.1, np.float32)
        )

    assert follow_doubt(clip, filler, 0.5) == (1, 0, 0.0, 0.0)


def test_sequences_with_a_label_on_every_frame(tmp_path):
    import cv2

    for name in ("all", "some", "other"):
        (tmp_path / name / "img").mkdir(parents=True)
        for number in range(3):
            cv2.imwrite(str(tmp_path / name / "img" / f"{number}.png"), np.zeros((60, 80, 3)))
        every = ["10,10,20,20"] * 3
        some = every if name == "all" else [every[0], "NaN,NaN,NaN,NaN", every[2]]
        (tmp_path / name / "groundtruth_rect.txt").write_text("\n".join(some))
    (tmp_path / "other" / "groundtruth_every_frame.txt").write_text("\n".join(every))
    assert sorted(one.name for one in labelled([tmp_path], None)) == ["all", "other"]
    assert [one.name for one in labelled([tmp_path], ["all", "some"])] == ["all"]
