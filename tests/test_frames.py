"""Reading frames: the right ones in the right order, and errors that name the bad source."""

import shutil

import cv2
import numpy as np
import pytest

from dcs_jax.io.chunks import chunks
from dcs_jax.io.frames import BrokenSource, open_source
from dcs_jax.io.image_bytes import image_size, is_cut_off
from dcs_jax.io.overlay import VideoWriter

SHAPE = (48, 64, 3)


def picture(value):
    """A flat frame whose grey value identifies it."""
    return np.full(SHAPE, value, np.uint8)


def values(source):
    return [round(float(frame.mean()) / 10) for frame in source]


@pytest.fixture
def folder(tmp_path):
    """img1.png to img12.png, the n-th of grey value 10 n."""
    for n in range(1, 13):
        cv2.imwrite(str(tmp_path / f"img{n}.png"), picture(10 * n))
    return tmp_path


@pytest.fixture(scope="session")
def video(tmp_path_factory):
    """20 frames, the n-th, counted from 0, of grey value 10 n."""
    path = tmp_path_factory.mktemp("video") / "clip.avi"
    with VideoWriter(path, SHAPE, fps=25) as writer:
        for n in range(20):
            writer.write(picture(10 * n))
    return path


def test_folder_is_read_in_natural_order(folder):
    source = open_source(folder)
    assert values(source) == list(range(1, 13))
    assert (source.shape, source.length, source.total, source.start) == (SHAPE, 12, 12, 0)


def test_natural_order_mixes_names_with_and_without_numbers(tmp_path):
    for n, name in enumerate(("1.png", "2.png", "10.png", "a2b10.png", "a10b1.png", "b.png")):
        cv2.imwrite(str(tmp_path / name), picture(10 * n))
    assert values(open_source(tmp_path)) == list(range(6))


def test_folder_with_an_img_subfolder(folder, tmp_path_factory):
    sequence = tmp_path_factory.mktemp("sequence")
    shutil.copytree(folder, sequence / "img")
    assert values(open_source(sequence)) == list(range(1, 13))


def test_other_files_in_a_folder_are_ignored(folder):
    (folder / "groundtruth_rect.txt").write_text("1,2,3,4\n")
    assert open_source(folder).length == 12


def test_frames_are_rgb_uint8(tmp_path):
    image = np.zeros(SHAPE, np.uint8)
    image[:, :32, 0] = 200
    image[:, 32:, 2] = 100
    cv2.imwrite(str(tmp_path / "0.png"), cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    (frame,) = open_source(tmp_path)
    assert frame.dtype == np.uint8
    np.testing.assert_array_equal(frame, image)


def test_video_frames_are_rgb(tmp_path):
    image = np.zeros(SHAPE, np.uint8)
    image[..., 0] = 200
    with VideoWriter(tmp_path / "red.avi", SHAPE) as writer:
        writer.write(image)
    (frame,) = open_source(tmp_path / "red.avi")
    assert frame.dtype == np.uint8
    np.testing.assert_allclose(frame.mean(axis=(0, 1)), (200, 0, 0), atol=8)


def test_grey_images_become_rgb(tmp_path):
    cv2.imwrite(str(tmp_path / "0.png"), picture(70)[..., 0])
    (frame,) = open_source(tmp_path)
    np.testing.assert_array_equal(frame, picture(70))


def test_video_is_read_completely_and_again(video):
    source = open_source(video)
    assert (source.shape, source.length, source.fps) == (SHAPE, 20, 25)
    assert values(source) == list(range(20))
    assert values(source) == list(range(20))


@pytest.mark.parametrize(("start", "end"), [(0, 5), (3, 9), (7, None), (11, 12)])
def test_start_is_inclusive_and_end_exclusive(folder, video, start, end):
    images, clip = open_source(folder, start, end), open_source(video, start, end)
    assert values(images) == list(range(1, 13))[start:end]
    assert values(clip) == list(range(20))[start:end]
    assert images.length == len(range(12)[start:end])
    assert clip.length == len(range(20)[start:end])


@pytest.mark.parametrize(
    ("start", "end", "message"),
    [
        (12, None, "has 12 frames, but the start is 12"),
        (-1, None, "the start is -1"),
        (0, 13, "has 12 frames, but the range is 0 to 13"),
        (5, 5, "the range is 5 to 5"),
    ],
)
def test_range_outside_the_frames(folder, start, end, message):
    with pytest.raises(ValueError, match=message):
        open_source(folder, start, end)


def test_range_outside_a_video(video):
    with pytest.raises(ValueError, match="has 20 frames, but the start is 30"):
        open_source(video, 30)


def test_missing_source(tmp_path):
    with pytest.raises(ValueError, match="nothing does not exist"):
        open_source(tmp_path / "nothing")


def test_file_that_is_not_a_video(tmp_path):
    (tmp_path / "notes.txt").write_text("no video")
    with pytest.raises(ValueError, match=r"notes\.txt cannot be read as a video"):
        open_source(tmp_path / "notes.txt")


def test_empty_folder(tmp_path):
    with pytest.raises(ValueError, match="holds no images"):
        open_source(tmp_path)


def test_images_of_different_size(folder):
    cv2.imwrite(str(folder / "img7.png"), np.zeros((50, 60, 3), np.uint8))
    with pytest.raises(ValueError, match=r"img7\.png has 60 x 50 pixels.* 64 x 48"):
        open_source(folder)
    assert open_source(folder, 0, 6).length == 6


@pytest.mark.parametrize("content", [b"", b"no image", b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n"])
def test_unreadable_image(folder, content):
    (folder / "img3.png").write_bytes(content)
    with pytest.raises(ValueError, match=r"img3\.png"):
        open_source(folder)


def test_image_that_breaks_while_reading(folder):
    whole = (folder / "img5.png").read_bytes()
    (folder / "img5.png").write_bytes(whole[:40])
    frames = iter(open_source(folder, start=1))
    assert values(next(frames) for _ in range(3)) == [2, 3, 4]
    with pytest.raises(BrokenSource, match=r"img5\.png \(frame 4\)") as broken:
        next(frames)
    assert broken.value.frame == 4


def noise(suffix):
    """The bytes of an image of noise, which compression does not shrink."""
    image = np.random.default_rng(0).integers(0, 255, SHAPE).astype(np.uint8)
    return cv2.imencode(f".{suffix}", image)[1].tobytes()


@pytest.mark.parametrize("suffix", ["jpg", "png", "bmp", "tif", "webp", "ppm", "jp2"])
@pytest.mark.parametrize("fraction", [0.5, 0.95])
def test_image_that_is_cut_off_while_reading(tmp_path, suffix, fraction, capfd):
    """OpenCV itself decodes half a JPEG, and fills the rest with grey."""
    for n in range(3):
        (tmp_path / f"{n}.{suffix}").write_bytes(noise(suffix))
    frames = iter(open_source(tmp_path))
    next(frames)
    path = tmp_path / f"1.{suffix}"
    path.write_bytes(path.read_bytes()[: int(fraction * path.stat().st_size)])
    with pytest.raises(BrokenSource, match=r"1\.\w+ \(frame 1\)") as broken:
        next(frames)
    assert broken.value.frame == 1
    if suffix in ("jpg", "png"):  # the decoders of which write to the terminal
        assert capfd.readouterr().err == ""


@pytest.mark.parametrize("content", [None, b""])
def test_image_that_is_missing_while_reading(folder, content):
    frames = iter(open_source(folder))
    next(frames)
    (folder / "img2.png").unlink()
    if content is not None:
        (folder / "img2.png").write_bytes(content)
    with pytest.raises(BrokenSource, match=r"img2\.png \(frame 1\)"):
        next(frames)


def test_bytes_around_a_jpeg_are_not_part_of_it():
    whole = noise("jpg")
    thumbnail = noise("jpg")[:1000] + b"\xff\xd9"
    segment = b"\xff\xe1" + (2 + len(thumbnail)).to_bytes(2) + thumbnail
    padded = whole[:2] + segment + b"\xff\xff" + whole[2:]
    for image in (whole, padded, whole + b"some trailer"):
        assert not is_cut_off(image)
    for length in (2, 3, 700, len(segment) + 4, len(padded) - 1):
        assert is_cut_off(padded[:length])


def test_truncated_video_yields_its_good_frames_first(video, tmp_path):
    cut = tmp_path / "cut.avi"
    whole = video.read_bytes()
    cut.write_bytes(whole[: len(whole) * 3 // 4])
    stacks: list[np.ndarray] = []
    with pytest.raises(BrokenSource, match=r"cut\.avi breaks off") as broken:
        stacks.extend(chunks(open_source(cut), 4))
    good = values(frame for stack in stacks for frame in stack)
    assert 3 < len(good) < 20
    # The last one may be incomplete.
    assert good[:-1] == list(range(len(good) - 1))
    assert broken.value.frame == len(good)


def test_end_before_the_break_is_not_an_error(video, tmp_path):
    cut = tmp_path / "cut.avi"
    whole = video.read_bytes()
    cut.write_bytes(whole[: len(whole) * 3 // 4])
    assert values(open_source(cut, 0, 3)) == [0, 1, 2]


def test_chunks_hold_all_frames_in_order(folder):
    stacks = list(chunks(open_source(folder), 5))
    assert [stack.shape for stack in stacks] == [(n, *SHAPE) for n in (5, 5, 2)]
    assert values(np.concatenate(stacks)) == list(range(1, 13))


def test_reading_is_lazy(folder):
    frames = chunks(open_source(folder), 2)
    next(frames)
    for n in range(5, 13):
        (folder / f"img{n}.png").unlink()
    assert values(next(frames)) == [3, 4]


@pytest.mark.parametrize("suffix", ["png", "jpg", "bmp", "tif", "webp", "pgm"])
def test_image_size_agrees_with_decoding(tmp_path, suffix):
    for shape in [(37, 53), (37, 53, 3)]:
        path = tmp_path / f"image.{suffix}"
        cv2.imwrite(str(path), np.zeros(shape, np.uint8))
        decoded = cv2.imread(str(path))
        assert decoded is not None
        assert image_size(path) == decoded.shape[:2] == (37, 53)
