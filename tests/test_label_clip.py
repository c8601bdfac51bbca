"""Random access to the frames of a clip: the same as reading it from the start."""

import time

import av
import cv2
import numpy as np
import pytest
from ffmpeg import RATE, ffmpeg, raw, write_plain

from dcs_jax.io.frames import BrokenSource, open_source
from dcs_jax.label.clip import Clip
from dcs_jax.synthetic import render

LENGTH = 48


@pytest.fixture(scope="module")
def frames():
    return render(LENGTH, (96, 128), (40, 32), seed=2).frames


@pytest.fixture
def opened():
    clips = []

    def opened(path, **options):
        clips.append(Clip(path, **options))
        return clips[-1]

    yield opened
    for clip in clips:
        clip.close()


def _write(path, frames, *arguments):
    ffmpeg(*raw(frames), *arguments, path, frames=frames)
    return path


def _b_frames(folder, frames):
    return write_plain(folder / "clip.mp4", frames)


def _open_groups(folder, frames):
    options = "keyint=12:min-keyint=12:open-gop=1:bframes=3:b-adapt=0:scenecut=0"
    return _write(folder / "clip.mp4", frames, "-c:v", "libx264", "-x264-params", options)


def _cut(folder, frames):
    """An edit list hides the frames before the 15th, which is no keyframe."""
    plain = write_plain(folder / "plain.mp4", frames)
    ffmpeg("-ss", 15 / RATE, "-i", plain, "-c", "copy", folder / "cut.mp4")
    return folder / "cut.mp4"


def _interlaced(folder, frames):
    options = ["-flags", "+ilme+ildct", "-x264-params", "tff=1:keyint=12", "-c:v", "libx264"]
    return _write(folder / "clip.mkv", frames, "-vf", "setfield=tff", *options)


def _variable(folder, frames):
    times = ["-vf", "setpts='(N+floor(N/7)*3)/25/TB'", "-fps_mode", "passthrough"]
    return _write(folder / "clip.mp4", frames, *times, "-c:v", "libx264", "-g", 10)


def _transport(folder, frames):
    return _write(folder / "clip.ts", frames, "-c:v", "libx264", "-g", 10)


def _avi(folder, frames):
    return _write(folder / "clip.avi", frames, "-c:v", "mpeg4", "-bf", 2, "-g", 10, "-q:v", 2)


def _bare(folder, frames):
    return _write(folder / "clip.h264", frames, "-c:v", "libx264", "-g", 10)


def _vp9(folder, frames):
    return _write(folder / "clip.webm", frames, "-c:v", "libvpx-vp9", "-g", 10, "-b:v", "500k")


def _hevc(folder, frames):
    options = ["-c:v", "libx265", "-x265-params", "log-level=none:keyint=12:open-gop=1"]
    return _write(folder / "clip.mkv", frames, *options)


FILES = [
    _b_frames, _open_groups, _cut, _interlaced, _variable, _transport, _avi, _bare, _vp9, _hevc,
]  # fmt: skip


@pytest.mark.parametrize("make", FILES)
def test_any_frame_is_the_one_that_is_read_from_the_start(make, frames, tmp_path, opened):
    path = make(tmp_path, frames)
    expected = list(open_source(path))
    clip = opened(path, cache_bytes=1)
    assert clip.length == len(expected)
    assert clip.shape == expected[0].shape
    order = np.random.default_rng(0).permutation(len(expected))
    for index in [*map(int, order), len(expected) - 1, 0]:
        np.testing.assert_array_equal(clip.frame(index), expected[index], f"frame {index}")


def test_frames_of_a_folder(frames, tmp_path, opened):
    for number, frame in enumerate(frames[:5]):
        cv2.imwrite(str(tmp_path / f"{number}.png"), frame[..., ::-1])
    clip = opened(tmp_path)
    assert clip.length == 5
    for index in (3, 0, 4):
        np.testing.assert_array_equal(clip.frame(index), frames[index])


def test_deep_images_have_the_range_of_the_folder_whichever_is_first(tmp_path, opened):
    rng = np.random.default_rng(0)
    for number in range(4):
        image = rng.integers(0, 1000 * (number + 1), (20, 30), dtype=np.uint16)
        cv2.imwrite(str(tmp_path / f"{number}.png"), image)
    expected = list(open_source(tmp_path))
    np.testing.assert_array_equal(opened(tmp_path).frame(3), expected[3])


def test_a_jpeg_is_the_frame(frames, tmp_path, opened):
    clip = opened(write_plain(tmp_path / "clip.mp4", frames))
    decoded = cv2.imdecode(np.frombuffer(clip.jpeg(7), np.uint8), cv2.IMREAD_COLOR_RGB)
    assert decoded is not None
    difference = np.abs(decoded.astype(int) - clip.frame(7))
    assert difference.mean() < 3


def test_what_can_be_read_of_a_file_that_breaks_off(frames, tmp_path, opened):
    path = _write(tmp_path / "clip.mkv", frames, "-c:v", "libx264", "-g", 10)
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 6 // 10])
    expected: list[np.ndarray] = []
    with pytest.raises(BrokenSource):
        expected.extend(open_source(path))
    clip = opened(path)
    assert clip.length == len(expected) < LENGTH
    assert "breaks off" in clip.notes[0]
    np.testing.assert_array_equal(clip.frame(clip.length - 1), expected[-1])


def test_damaged_frames_are_left_out_as_when_it_is_read_from_the_start(frames, tmp_path, opened):
    path = write_plain(tmp_path / "clip.mp4", frames)
    with av.open(str(path)) as container:
        packets = [(p.pos, p.size) for p in container.demux(video=0) if p.size]
    content = bytearray(path.read_bytes())
    position, size = packets[25]
    content[position + 8 : position + size] = bytes(size - 8)
    path.write_bytes(content)
    expected = list(open_source(path))
    clip = opened(path)
    for index in range(len(expected)):
        np.testing.assert_array_equal(clip.frame(index), expected[index], f"frame {index}")


@pytest.mark.parametrize("index", [-1, LENGTH])
def test_frames_that_are_not_there(index, frames, tmp_path, opened):
    clip = opened(write_plain(tmp_path / "clip.mp4", frames))
    with pytest.raises(ValueError, match=f"from 0 to {LENGTH - 1}, the last one, but is {index}"):
        clip.frame(index)


def test_frames_around_the_place_are_there_before_they_are_asked_for(frames, tmp_path, opened):
    clip = opened(write_plain(tmp_path / "clip.mp4", frames))
    clip.frame(20)
    deadline = time.monotonic() + 10
    while not {19, 21, 44} <= clip._video._kept.keys():
        assert time.monotonic() < deadline
        time.sleep(0.01)


@pytest.mark.parametrize("make", [_b_frames, _interlaced])
def test_a_range_of_frames(make, frames, tmp_path, opened):
    path = make(tmp_path, frames)
    expected = list(open_source(path, 17, 31))
    np.testing.assert_array_equal(list(opened(path).frames(17, 31)), expected)


def test_previews_of_all_frames_are_made_while_idle(frames, tmp_path, opened):
    clip = opened(write_plain(tmp_path / "clip.mp4", frames))
    deadline = time.monotonic() + 20
    while clip.preview(LENGTH - 1) is None and time.monotonic() < deadline:
        time.sleep(0.01)
    for index in (0, 13, LENGTH - 1):
        decoded = cv2.imdecode(np.frombuffer(clip.preview(index), np.uint8), cv2.IMREAD_COLOR_RGB)
        assert decoded is not None
        assert np.abs(decoded.astype(int) - clip.frame(index)).mean() < 5
