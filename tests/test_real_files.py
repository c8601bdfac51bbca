"""Files as people have them, made by ffmpeg: all of their frames, as a player shows them."""

import os

import cv2
import numpy as np
import pytest
from ffmpeg import ffmpeg, raw, write_plain

from dcs_jax.io.frames import BrokenSource, open_source
from dcs_jax.synthetic import render

LENGTH = 30
H264 = ("-c:v", "libx264", "-crf", 12, "-pix_fmt", "yuv420p")


@pytest.fixture(scope="module")
def frames():
    return render(LENGTH, (96, 128), (30, 26), speed=3).frames


@pytest.fixture(scope="module")
def plain(frames, tmp_path_factory):
    return write_plain(tmp_path_factory.mktemp("plain") / "plain.mp4", frames)


def distances(source, frames):
    """Mean difference of each frame from the one that it should be, in grey values."""
    pairs = zip(source, frames, strict=True)
    return [float(np.abs(found.astype(int) - frame).mean()) for found, frame in pairs]


# Each with what makes it, and how far its frames may be from those that were encoded. Frames of
# two fields have half of the rows of each.
FILES = {
    "top-first.mp4": (("-flags", "+ilme+ildct", "-x264-params", "tff=1", *H264), 6),
    "bottom-first.mp4": (("-flags", "+ilme+ildct", "-x264-params", "bff=1", *H264), 6),
    "mpeg2.mpg": (("-c:v", "mpeg2video", "-q:v", 2, "-flags", "+ilme+ildct"), 6),
    "mpeg2.ts": (("-c:v", "mpeg2video", "-q:v", 2), 5),
    "prores.mov": (("-c:v", "prores_ks", "-flags", "+ilme+ildct"), 6),
    "prores-10-bits.mov": (("-c:v", "prores_ks", "-pix_fmt", "yuv422p10le"), 4),
    "hevc-10-bits.mp4": (
        ("-c:v", "libx265", "-x265-params", "log-level=error", "-pix_fmt", "yuv420p10le"),
        6,
    ),
    "lossless.mkv": (("-c:v", "ffv1"), 3),
    "vp9.webm": (("-c:v", "libvpx-vp9", "-crf", 15, "-b:v", 0), 5),
    "motion-jpeg.avi": (("-c:v", "mjpeg", "-q:v", 2), 5),
    "fragments.mp4": (("-movflags", "frag_keyframe+empty_moov", *H264), 5),
    "bare.h264": (H264, 5),
    "whole-range.mp4": (("-pix_fmt", "yuvj420p", "-c:v", "libx264", "-crf", 12), 5),
    "stream.ts": (H264, 5),
    "flash.flv": (("-c:v", "flv1", "-q:v", 2), 6),
}


@pytest.mark.parametrize("name", FILES)
def test_every_frame_as_it_was_encoded(frames, tmp_path, name):
    arguments, far = FILES[name]
    ffmpeg(*raw(frames), *arguments, tmp_path / name, frames=frames)
    source = open_source(tmp_path / name)
    assert (source.total, source.length) == (LENGTH, LENGTH)
    assert max(distances(source, frames)) < far
    assert source.notes == []
    assert source.fps == pytest.approx(25)


@pytest.mark.parametrize("field", ["tff", "bff"])
def test_fields_of_different_times_are_no_comb(tmp_path, field):
    """A bar that moves is torn into lines where two fields are woven into one frame."""
    rows, columns, count = 96, 128, 12
    fields = np.full((2 * count, rows, columns, 3), 40, np.uint8)
    for t in range(2 * count):
        fields[t, :, 10 + 4 * t : 26 + 4 * t] = 220
    weave = f"interlace=scan={field}:lowpass=off"
    codec = ("-c:v", "libx264", "-flags", "+ilme+ildct", "-x264-params", f"{field}=1", "-crf", 8)
    path = tmp_path / "fields.mp4"
    ffmpeg(*raw(fields, 50), "-vf", weave, *codec, "-pix_fmt", "yuv420p", path, frames=fields)
    shown = list(open_source(path))
    assert len(shown) == count

    def combing(frame):
        grey = frame[20:-20, :, 1].astype(int)
        return np.abs(2 * grey[1:-1] - grey[:-2] - grey[2:]).mean()

    woven = np.where(np.arange(rows)[:, None, None] % 2, fields[6], fields[7])
    assert combing(woven) > 20
    assert max(map(combing, shown[1:-1])) < 5


def test_dv_of_a_camcorder(frames, tmp_path):
    large = np.stack([cv2.resize(frame, (720, 576)) for frame in frames])
    path = tmp_path / "tape.dv"
    ffmpeg(*raw(large), "-target", "pal-dv", path, frames=large)
    source = open_source(path)
    assert (source.length, source.fps, source.shape) == (LENGTH, 25, (576, 720, 3))
    assert max(distances(source, large)) < 6


@pytest.mark.parametrize("suffix", ["mp4", "mov", "mkv", "ts"])
def test_a_cut_without_encoding(frames, plain, tmp_path, suffix):
    """An edit list hides the frames from the keyframe to the cut; they are none."""
    path = tmp_path / f"cut.{suffix}"
    ffmpeg("-ss", 0.6, "-i", plain, "-c", "copy", path)
    source = open_source(path)
    shown = list(source)
    first = 15 if suffix in ("mp4", "mov") else 10  # other containers have no edit lists
    assert source.length == len(shown) == LENGTH - first
    assert max(distances(shown, frames[first:])) < 5


TURNS = {90: lambda f: np.rot90(f, 1), 180: lambda f: np.rot90(f, 2), 270: lambda f: np.rot90(f, 3)}


@pytest.mark.parametrize("degrees", TURNS)
def test_a_video_is_turned_as_it_is_marked(frames, plain, tmp_path, degrees):
    path = tmp_path / "turned.mp4"
    ffmpeg("-display_rotation", degrees, "-i", plain, "-c", "copy", path)
    source = open_source(path)
    expected = [TURNS[degrees](frame) for frame in frames]
    assert source.shape == expected[0].shape
    assert max(distances(source, expected)) < 5


def test_a_video_is_mirrored_as_it_is_marked(frames, plain, tmp_path):
    path = tmp_path / "mirrored.mp4"
    ffmpeg("-display_rotation", 0, "-display_hflip", "-i", plain, "-c", "copy", path)
    assert max(distances(open_source(path), frames[:, :, ::-1])) < 5


def test_videos_one_after_the_other(frames, tmp_path):
    """The times begin anew in the middle, so that the announced duration is wrong."""
    for name, part in (("a", frames[:20]), ("b", frames[20:])):
        ffmpeg(*raw(part), *H264, tmp_path / f"{name}.ts", frames=part)
    path = tmp_path / "both.ts"
    path.write_bytes((tmp_path / "a.ts").read_bytes() + (tmp_path / "b.ts").read_bytes())
    source = open_source(path, 5)
    assert (source.total, source.length) == (LENGTH, LENGTH - 5)
    assert max(distances(source, frames[5:])) < 5
    with pytest.raises(ValueError, match="has 30 frames, but the range is 0 to 31"):
        open_source(path, end=31)


def test_a_video_that_drops_frames(frames, tmp_path):
    """Its duration announces more frames than there are."""
    path = tmp_path / "dropped.mkv"
    kept = [t for t in range(LENGTH) if not 8 <= t < 20]
    select = ("-vf", "select=not(between(n\\,8\\,19))", "-fps_mode", "passthrough")
    ffmpeg(*raw(frames), *select, *H264, path, frames=frames)
    source = open_source(path)
    assert source.length == len(kept)
    assert max(distances(source, frames[kept])) < 5
    assert len(list(open_source(path, 10, len(kept)))) == len(kept) - 10


@pytest.mark.parametrize("suffix", ["mp4", "mkv"])
def test_sound_that_is_longer_than_the_pictures(frames, plain, tmp_path, suffix):
    path = tmp_path / f"sound.{suffix}"
    sound = ("-f", "lavfi", "-i", "sine=d=8")
    ffmpeg(*sound, "-i", plain, "-c:v", "copy", "-c:a", "aac", path)
    assert open_source(path).length == len(list(open_source(path))) == LENGTH


def test_a_song_with_a_cover_is_no_video(frames, tmp_path):
    cover, song = tmp_path / "cover.png", tmp_path / "song.mp3"
    cv2.imwrite(str(cover), frames[0])
    ffmpeg(
        *("-f", "lavfi", "-i", "sine=d=1", "-i", cover, "-map", 0, "-map", 1),
        *("-c:v", "png", "-disposition:v", "attached_pic", song),
    )
    with pytest.raises(
        ValueError, match=r"song\.mp3 cannot be read as a video: it holds no moving"
    ):
        open_source(song)


@pytest.mark.parametrize("name", ["start.mp4", "fragments.mp4", "cut.mkv"])
def test_a_video_that_breaks_off_gives_what_there_is(frames, tmp_path, name):
    flags = {"start.mp4": "+faststart", "fragments.mp4": "frag_keyframe+empty_moov"}
    movflags = ("-movflags", flags[name]) if name in flags else ()
    path = tmp_path / name
    ffmpeg(*raw(frames), *H264, "-g", 5, *movflags, path, frames=frames)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 2 // 3])
    found: list[np.ndarray] = []
    with pytest.raises(BrokenSource, match="breaks off") as broken:
        found.extend(open_source(path))
    assert 5 < len(found) < LENGTH
    assert broken.value.frame == len(found)
    assert max(distances(found, frames[: len(found)])) < 8
    few = len(found) - 3
    assert len(list(open_source(path, 0, few))) == few


def test_a_hole_in_a_video_is_said_and_the_rest_is_read(frames, plain, tmp_path):
    content = bytearray(plain.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 600] = bytes(600)
    path = tmp_path / "hole.mp4"
    path.write_bytes(content)
    source = open_source(path)
    found = list(source)
    assert LENGTH - 6 <= len(found) < LENGTH
    (note,) = source.notes
    assert "could not be decoded, and left out" in note
    assert max(distances(found[-5:], frames[-5:])) < 5


def test_texts_in_another_encoding(frames, tmp_path):
    path = tmp_path / "title.mkv"
    ffmpeg(*raw(frames), *H264, "-metadata", "title=caf@@", path, frames=frames)
    path.write_bytes(path.read_bytes().replace(b"caf@@", b"caf\xe9\xff"))
    assert len(list(open_source(path))) == LENGTH


@pytest.mark.parametrize(
    "name", [b"2024-11-14T10:30:00.mp4", b"vid\xe9o.mp4", "字".encode() * 83 + b".mp4", b"-.mp4"]
)
def test_any_name(plain, tmp_path, name, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = os.fsdecode(name)
    with open(path, "wb") as file:
        file.write(plain.read_bytes())
    assert len(list(open_source(path))) == LENGTH
