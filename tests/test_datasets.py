"""Every layout of a data set is found and gives the same frames and labels."""

import numpy as np
import pytest
from data_sets import write_images, write_otb, write_rows, write_video
from sequences import ROOT

from dcs_jax.evaluation.datasets import find_sequences
from dcs_jax.evaluation.paper import authors_constants, paper_name
from dcs_jax.synthetic import render

LENGTH = 12


@pytest.fixture(scope="module")
def clip():
    return render(LENGTH, (48, 64), (16, 14))


def only(root, **options):
    (entry,) = find_sequences(root, **options)
    return entry.load()


def check(sequence, clip, name, start=0, lossless=False):
    """Name, labels and frames from `start` on are those of the clip."""
    assert sequence.name == name
    np.testing.assert_allclose(sequence.truth, clip.boxes[start:], atol=1e-3)
    frames = np.stack(list(sequence.frames))
    assert frames.shape == clip.frames[start:].shape
    difference = np.abs(frames.astype(int) - clip.frames[start:])
    assert difference.max() == 0 if lossless else difference.mean() < 12


@pytest.mark.parametrize("delimiter", [",", "\t", " "])
@pytest.mark.parametrize("first", [0, 1, 247])
def test_otb(tmp_path, clip, delimiter, first):
    write_otb(tmp_path, "Card", clip, first, delimiter)
    check(only(tmp_path), clip, "Card")


def test_one_sequence_may_be_the_root(tmp_path, clip):
    write_otb(tmp_path, "Card", clip)
    check(only(tmp_path / "Card"), clip, "Card")


def test_otb_with_several_targets(tmp_path, clip):
    write_otb(tmp_path, "Jogging", clip)
    folder = tmp_path / "Jogging"
    (folder / "groundtruth_rect.txt").rename(folder / "groundtruth_rect.1.txt")
    write_rows(folder / "groundtruth_rect.2.txt", clip.boxes + 1)
    (folder / "groundtruth_rect.3.txt").write_text("\n")  # a placeholder
    first, second = find_sequences(tmp_path)
    check(first.load(), clip, "Jogging-1")
    assert second.name == "Jogging-2"
    np.testing.assert_allclose(second.load().truth, clip.boxes + 1, atol=1e-3)


def test_otb_sequence_of_a_part_of_its_images(tmp_path, clip):
    """Football1 has more images in some copies than the 74 that OTB takes."""
    frames, boxes = np.tile(clip.frames, (7, 1, 1, 1)), np.tile(clip.boxes, (7, 1))
    names = [f"{t:04d}.png" for t in range(1, 85)]
    write_images(tmp_path / "Football1" / "img", frames, names)
    write_rows(tmp_path / "Football1" / "groundtruth_rect.txt", boxes[:74])
    sequence = only(tmp_path)
    assert len(sequence.truth) == sequence.frames.length == 74


def test_labels_that_begin_later_cut_the_start(tmp_path, clip):
    write_otb(tmp_path, "Card", clip)
    rows = clip.boxes.astype(float)
    rows[:2], rows[2], rows[5] = np.nan, 0, np.nan
    write_rows(tmp_path / "Card" / "groundtruth_rect.txt", rows)
    sequence = only(tmp_path)
    assert sequence.frames.start == 3
    np.testing.assert_array_equal(np.isnan(sequence.truth[:, 0]).nonzero()[0], [2])


def test_mil(tmp_path, clip):
    """Images from 0 on, of which *_frames.txt names a range; every 5th frame has a label."""
    folder = tmp_path / "card"
    write_images(folder / "imgs", clip.frames, [f"img{t:05d}.png" for t in range(LENGTH)])
    (folder / "card_frames.txt").write_text("2,11\n")
    rows = np.zeros((10, 4))
    rows[::5] = clip.boxes[2::5]
    write_rows(folder / "card_gt.txt", rows)
    sequence = only(tmp_path)
    assert sequence.name == "card"
    np.testing.assert_allclose(sequence.truth[::5], clip.boxes[2::5], atol=1e-3)
    assert np.isnan(np.delete(sequence.truth, [0, 5], axis=0)).all()
    np.testing.assert_array_equal(np.stack(list(sequence.frames)), clip.frames[2:])


@pytest.mark.parametrize("inner", ["color", "."])
@pytest.mark.parametrize("corners", [False, True])
def test_vot(tmp_path, clip, inner, corners):
    folder = tmp_path / "sequences" / "card"
    names = [f"{t:08d}.jpg" for t in range(1, LENGTH + 1)]
    write_images(folder / inner, clip.frames, names)
    x, y, w, h = clip.boxes.T
    polygon = np.stack([x, y + h, x, y, x + w, y, x + w, y + h], axis=1)
    write_rows(folder / "groundtruth.txt", polygon if corners else clip.boxes)
    check(only(tmp_path), clip, "sequences-card")


def test_a_turned_polygon_becomes_the_box_around_it(tmp_path, clip):
    write_images(tmp_path / "card" / "color", clip.frames[:1], ["00000001.jpg"])
    (tmp_path / "card" / "groundtruth.txt").write_text("20,10,30,20,20,30,10,20\n")
    np.testing.assert_array_equal(only(tmp_path).truth, [[10, 10, 20, 20]])


def test_got10k(tmp_path, clip):
    folder = tmp_path / "val" / "GOT-10k_Val_000001"
    write_images(folder, clip.frames, [f"{t:08d}.jpg" for t in range(1, LENGTH + 1)])
    write_rows(folder / "groundtruth.txt", clip.boxes)
    (folder / "absence.label").write_text("0\n" * 4 + "1\n" + "0\n" * 7)
    (tmp_path / "val" / "list.txt").write_text("GOT-10k_Val_000001\n")
    sequence = only(tmp_path)
    assert sequence.name == "val-GOT-10k_Val_000001"
    assert np.isnan(sequence.truth[4]).all()
    rest = np.arange(LENGTH) != 4
    np.testing.assert_allclose(sequence.truth[rest], clip.boxes[rest], atol=1e-3)


@pytest.mark.parametrize("header", [True, False])
def test_video_with_a_table(tmp_path, clip, header):
    write_video(tmp_path / "card.avi", clip)
    if header:
        rows = [
            f"{t},{','.join(map(str, clip.boxes[t]))},0.9" for t in range(LENGTH) if t not in (3, 4)
        ]
        (tmp_path / "card.csv").write_text("\n".join(["frame,x,y,w,h,confidence", *rows]))
    else:
        write_rows(tmp_path / "card.csv", clip.boxes)
    sequence = only(tmp_path)
    assert sequence.name == "card"
    assert sequence.frames.length == LENGTH
    unlabelled = [3, 4] if header else []
    np.testing.assert_array_equal(np.isnan(sequence.truth[:, 0]).nonzero()[0], unlabelled)
    known = ~np.isnan(sequence.truth[:, 0])
    np.testing.assert_allclose(sequence.truth[known], clip.boxes[known], atol=1e-3)


def test_several_layouts_in_one_folder_are_found_by_name(tmp_path, clip):
    write_otb(tmp_path, "b-otb", clip)
    write_video(tmp_path / "a-video.avi", clip)
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "read.txt").write_text("not a sequence")
    assert [entry.name for entry in find_sequences(tmp_path)] == ["a-video", "b-otb"]
    assert [entry.name for entry in find_sequences(tmp_path, ["b-otb"])] == ["b-otb"]


def test_unknown_names_and_empty_folders_are_refused(tmp_path, clip):
    with pytest.raises(ValueError, match="holds no sequences in the layout of OTB"):
        find_sequences(tmp_path)
    with pytest.raises(ValueError, match="is not a folder"):
        find_sequences(tmp_path / "nothing")
    write_otb(tmp_path, "Card", clip)
    with pytest.raises(ValueError, match=r"Deer not found in .*, which holds Card"):
        find_sequences(tmp_path, ["Deer"])


def broken_otb(folder, clip):
    write_otb(folder, "Card", clip)
    return folder / "Card"


def shorter(folder, clip):
    write_rows(broken_otb(folder, clip) / "groundtruth_rect.txt", clip.boxes[:-1])


def unlabelled(folder, clip):
    write_rows(broken_otb(folder, clip) / "groundtruth_rect.txt", clip.boxes * np.nan)


def not_numbers(folder, clip):
    (broken_otb(folder, clip) / "groundtruth_rect.txt").write_text("a,b,c,d\n")


def without_annotation(folder, clip):
    (broken_otb(folder, clip) / "groundtruth_rect.txt").unlink()


def images_alone(folder, clip):
    write_images(folder / "Card", clip.frames, [f"{t}.png" for t in range(LENGTH)])


def mil_without_frames(folder, clip):
    images_alone(folder / "Card" / "imgs", clip)
    write_rows(folder / "Card" / "card_gt.txt", clip.boxes)


def video_alone(folder, clip):
    write_video(folder / "Card.avi", clip)


def video_with_a_frame_too_many(folder, clip):
    write_video(folder / "Card.avi", clip)
    (folder / "Card.csv").write_text(f"frame,x,y,w,h\n0,1,2,30,40\n{LENGTH},1,2,30,40\n")


def video_without_a_column(folder, clip):
    write_video(folder / "Card.avi", clip)
    (folder / "Card.csv").write_text("frame,x,y,w\n0,1,2,30\n")


def got_of_another_length(folder, clip):
    images_alone(folder, clip)
    write_rows(folder / "Card" / "groundtruth.txt", clip.boxes)
    (folder / "Card" / "absence.label").write_text("0\n")


def vot_masks(folder, clip):
    write_images(folder / "Card" / "color", clip.frames[:1], ["1.jpg"])
    (folder / "Card" / "groundtruth.txt").write_text("m10,10,5,5,2,3\n")


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (shorter, "labels 11 frames, but .* has 12"),
        (unlabelled, "labels no frame"),
        (not_numbers, r"line 1 is 'a,b,c,d': expected four numbers"),
        (without_annotation, "groundtruth_rect.txt"),
        (images_alone, "holds images, but no annotation"),
        (mil_without_frames, r"no \*_frames.txt"),
        (video_alone, "no table of boxes: expected Card.csv in its folder"),
        (video_with_a_frame_too_many, "line 3 names frame 12: the video has 12 frames"),
        (video_without_a_column, "has no column h"),
        (got_of_another_length, "absence.label has 1 lines, but groundtruth.txt 12"),
        (vot_masks, "expected 4 numbers x,y,w,h or 8, the corners of a polygon"),
    ],
)
def test_a_broken_sequence_is_found_and_says_what_is_wrong(tmp_path, clip, write, message):
    write(tmp_path, clip)
    (entry,) = find_sequences(tmp_path)
    assert entry.name == "Card"
    with pytest.raises((ValueError, OSError), match=message):
        entry.load()


def test_the_fingerprint_is_of_labels_and_files(tmp_path, clip):
    write_otb(tmp_path, "Card", clip)
    before = only(tmp_path).fingerprint()
    assert only(tmp_path).fingerprint() == before
    image = tmp_path / "Card" / "img" / "0003.jpg"
    content = bytearray(image.read_bytes())
    content[-3] ^= 1  # of the same size
    image.write_bytes(content)
    after = only(tmp_path).fingerprint()
    assert after != before
    write_rows(tmp_path / "Card" / "groundtruth_rect.txt", clip.boxes + 1)
    assert only(tmp_path).fingerprint() not in (before, after)


def test_the_shared_sequences_are_all_there():
    if not ROOT.is_dir():
        pytest.skip("the sequences are not in ../shared/sequences")
    lengths = {entry.name: entry.load().frames.length for entry in find_sequences(ROOT)}
    assert lengths == {
        "animal": 71,
        "david": 462,
        "dollar": 327,
        "faceocc2": 812,
        "girl": 502,
        "sylv": 1344,
        "tiger1": 354,
    }


def test_the_papers_names_and_constants():
    assert paper_name("Deer") == paper_name("animal") == "animal"
    assert paper_name("Bolt") is None
    assert authors_constants("sylv") == {"selectors": 10, "block": 0.2}
    assert authors_constants("tiger1") == {"selectors": 20, "block": 1}
    assert authors_constants("Bolt") == {"selectors": 20, "block": 0.2}
