"""Streams: the same tracks in chunks, with tracks that come and go and sources that break."""

import itertools
import threading
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from settings import SMALL, SMALL_DEFAULT

import dcs_jax
from dcs_jax import Config, tracker
from dcs_jax.io.chunks import ahead, chunks
from dcs_jax.synthetic import render
from dcs_jax.types import Track

SHIFTS = np.array([(0, 0, 0, 0), (5, -4, 3, 8)], np.float32)
KEYS = jax.vmap(jax.random.key)(jnp.arange(2))


@pytest.fixture(scope="module")
def clip():
    return render(30, (120, 160), (36, 30))


def joined(stream):
    """The tracks [S, T, ...] of a whole stream."""
    tracks = [chunk.track for chunk in stream]
    return Track(*(np.concatenate(leaves, 1) for leaves in zip(*tracks, strict=True)))


@pytest.mark.parametrize("length", [1, 4, 7, None])
def test_a_stream_is_the_batch_whatever_the_chunks(clip, length):
    boxes = clip.boxes[0] + SHIFTS
    batch = dcs_jax.track_batch(clip.frames, boxes, KEYS, SMALL)
    stream = dcs_jax.track_stream(iter(clip.frames), boxes, KEYS, SMALL, chunk=length)
    for streamed, expected in zip(joined(stream), batch, strict=True):
        np.testing.assert_allclose(streamed, expected, atol=1e-6)
    again = dcs_jax.track_stream(iter(clip.frames), boxes, KEYS, SMALL, chunk=length)
    np.testing.assert_array_equal(joined(again).boxes, batch.boxes)


def test_with_components_it_differs_by_rounding(clip):
    config = SMALL_DEFAULT
    boxes = clip.boxes[0] + SHIFTS
    batch = dcs_jax.track_batch(clip.frames, boxes, config=config)
    streamed = joined(dcs_jax.track_stream(clip.frames, boxes, config=config, chunk=6))
    np.testing.assert_allclose(streamed.boxes, batch.boxes, atol=0.05)
    np.testing.assert_array_equal(streamed.lost, batch.lost)


def test_chunks_hold_the_frames_in_order(clip):
    stream = dcs_jax.track_stream(clip.frames, clip.boxes[:1], config=SMALL, chunk=8)
    parts = list(stream)
    assert [part.start for part in parts] == [0, 1, 9, 17, 25]
    np.testing.assert_array_equal(np.concatenate([part.frames for part in parts]), clip.frames)
    assert stream.seconds > 0
    stream.drop(0)
    with pytest.raises(ValueError, match="the stream has ended"):  # no frame comes any more
        stream.add(clip.boxes[0])


def test_a_track_starts_in_a_frame_to_come(clip):
    """With a chunk that ends there, whose last row has the box; then as one that was added."""
    stream = dcs_jax.track_stream(clip.frames, clip.boxes[:1], config=SMALL, slots=3, chunk=8)
    assert [stream.add(clip.boxes[t], frame=t) for t in (0, 12)] == [1, 2]
    np.testing.assert_array_equal(stream.active, [True] * 3)
    parts = list(stream)
    assert [part.start for part in parts] == [0, 1, 9, 13, 17, 25]
    found = joined(iter(parts)).boxes
    np.testing.assert_array_equal(np.isnan(found[2]).any(-1), np.arange(30) < 12)
    np.testing.assert_allclose(found[2, 12], clip.boxes[12], atol=1e-4)
    own = dcs_jax.track_stream(clip.frames[12:], clip.boxes[12:13], config=SMALL)
    np.testing.assert_allclose(found[2, 12:], joined(own).boxes[0], atol=1e-4)
    np.testing.assert_array_equal(found[1], found[0])
    whole = dcs_jax.track_stream(clip.frames, clip.boxes[:1], config=SMALL)
    np.testing.assert_allclose(found[0], joined(whole).boxes[0], atol=1e-4)


@pytest.mark.parametrize("keys", [None, KEYS], ids=["one-pool", "own-pools"])
def test_tracks_come_and_go_without_compilation(clip, monkeypatch, keys):
    boxes = clip.boxes[0] + SHIFTS
    options = {"config": SMALL, "slots": 3, "chunk": 4}
    key = None if keys is None else jax.random.key(9)
    alone = joined(dcs_jax.track_stream(clip.frames, boxes, keys, **options))  # compiles
    for name in ("init", "step"):
        monkeypatch.setattr(tracker, name, None)  # nothing is traced from here on

    stream = dcs_jax.track_stream(clip.frames, boxes, keys, **options)
    parts: list[Any] = []
    for chunk in stream:
        parts.append(chunk)
        if chunk.start == 5:
            assert stream.add(clip.boxes[8] + 1, key) == 2
            stream.drop(0)
            np.testing.assert_array_equal(stream.active, [False, True, True])
        if chunk.start == 13:
            stream.drop(2)
            assert stream.add(clip.boxes[16], key) == 0
    monkeypatch.undo()

    found = joined(iter(parts)).boxes
    taken = np.concatenate(
        [np.repeat(part.active[:, None], len(part.frames), 1) for part in parts], 1
    )
    np.testing.assert_array_equal(~np.isnan(found).any(-1), taken)
    np.testing.assert_array_equal(taken[0], [True] * 9 + [False] * 8 + [True] * 13)
    np.testing.assert_array_equal(taken[2], [False] * 9 + [True] * 8 + [False] * 13)
    np.testing.assert_array_equal(found[1], alone.boxes[1])
    np.testing.assert_array_equal(found[0, :9], alone.boxes[0, :9])
    for slot, first, last, box in ((2, 8, 17, clip.boxes[8] + 1), (0, 16, 30, clip.boxes[16])):
        single = dcs_jax.track_sequence(clip.frames[first:last], box, key, SMALL)
        np.testing.assert_array_equal(found[slot, first + 1 : last], single.boxes[1:])


def test_a_source_that_breaks_gives_what_was_tracked_first(clip):
    def broken():
        yield from clip.frames[:12]
        raise OSError("the cable is out")

    parts: list[Any] = []
    with pytest.raises(OSError, match="the cable is out"):
        parts.extend(dcs_jax.track_stream(broken(), clip.boxes[:1], config=SMALL, chunk=4))
    whole = dcs_jax.track_sequence(clip.frames[:12], clip.boxes[0], config=SMALL)
    np.testing.assert_array_equal(joined(iter(parts)).boxes[0], whole.boxes)


def test_a_frame_of_another_shape_gives_what_was_tracked_first(clip):
    frames = [*clip.frames[:7], clip.frames[7, :50]]
    parts: list[Any] = []
    with pytest.raises(ValueError, match=r"frame 7 has \(50, 160, 3\)"):
        parts.extend(dcs_jax.track_stream(frames, clip.boxes[:1], config=SMALL, chunk=4))
    assert sum(len(part.frames) for part in parts) == 7


def test_the_next_chunk_is_read_while_one_is_in_use(clip):
    read = threading.Event()

    def source():
        for number, frame in enumerate(clip.frames):
            if number == 8:
                read.set()
            yield frame

    stream = dcs_jax.track_stream(source(), clip.boxes[:1], config=SMALL, chunk=4)
    assert next(stream).start == 0
    assert next(stream).start == 1  # frames 1 to 4; 5 to 8 are on their way
    assert read.wait(timeout=60)
    stream.close()
    assert list(stream) == []


def test_memory_does_not_grow_with_the_frames(clip):
    frames = itertools.islice(itertools.cycle(clip.frames), 600)
    stream = dcs_jax.track_stream(frames, clip.boxes[:1], config=SMALL, chunk=4)
    held = [sum(array.nbytes for array in jax.live_arrays()) for _ in stream]
    assert len(held) == 151
    assert max(held[2:]) == held[2]


def test_ahead_passes_on_what_is_raised():
    def items():
        yield 1
        raise KeyError("two")

    rest = ahead(items())
    assert next(rest) == 1
    with pytest.raises(KeyError, match="two"):
        next(rest)


def test_chunks_pass_on_what_is_raised_after_the_good_frames():
    def frames():
        yield from np.ones((3, 4, 5), np.uint8)
        raise KeyError("four")

    stacks: list[Any] = []
    with pytest.raises(KeyError, match="four"):
        stacks.extend(chunks(frames(), 2))
    assert [len(stack) for stack in stacks] == [2, 1]


FRAMES = np.zeros((3, 40, 60), np.uint8)
BOXES = [(10, 10, 20, 20)]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"frames": []}, "frames is empty"),
        ({"frames": [None]}, "frame must be a NumPy or JAX array .* but is a NoneType"),
        ({"frames": 5}, "frames must be an iterable of images, but is 5"),
        ({"chunk": 10**8}, r"chunk must be at most 447392 frames of the shape \(40, 60\), .* MiB"),
        ({"slots": 10**8}, "slots must be .* at most 10000, but is 100000000"),
        ({"boxes": [(10, 10, 2e6, 9)]}, r"boxes\[0\]: box must be at most 1e\+06 pixels"),
        ({"frames": FRAMES.astype(float)}, "frame must be uint8 .* float64"),
        ({"boxes": [(70, 0, 9, 9)]}, r"boxes\[0\]: box must lie at least partly"),
        ({"slots": 0}, "slots must be an integer of at least 1, but is 0"),
        ({"boxes": BOXES * 3, "slots": 2}, "slots is 2, but there are 3 boxes"),
        ({"chunk": 2.5}, "chunk must be an integer of at least 1, but is 2.5"),
        ({"keys": KEYS}, "one key for all 1 boxes or one for each"),
        ({"config": None}, r"must be a dcs_jax\.Config"),
    ],
)
def test_bad_arguments_are_refused_before_any_compilation(arguments, message, monkeypatch):
    monkeypatch.setattr(tracker, "init", None)  # nothing is traced
    with pytest.raises(ValueError, match=message):
        dcs_jax.track_stream(**({"frames": FRAMES, "boxes": BOXES} | arguments))


def test_what_cannot_be_added_or_dropped_is_refused(clip):
    box = clip.boxes[0]
    stream = dcs_jax.track_stream(clip.frames, [box], config=SMALL, slots=2)
    with pytest.raises(ValueError, match="wholly outside"):
        stream.add((500, 0, 20, 20))
    with pytest.raises(ValueError, match="share one pool"):
        stream.add(box, jax.random.key(1))
    with pytest.raises(ValueError, match="slot 1 has no track: those that have one are 0"):
        stream.drop(1)
    assert stream.add(box) == 1
    with pytest.raises(ValueError, match="all 2 slots have a track"):
        stream.add(box)

    for slot in (1.0, None, -1, True):
        with pytest.raises(ValueError, match="slot must be an integer of at least 0, but is"):
            stream.drop(slot)
    stream.close()
    stream.drop(0)
    with pytest.raises(ValueError, match="the stream has ended"):
        stream.add(box)

    own = dcs_jax.track_stream(clip.frames, [box], KEYS[:1], SMALL, slots=2)
    with pytest.raises(ValueError, match=r"jax\.random\.key\(seed\)"):
        own.add(box)
    native = Config.paper(selectors=2, pool_size=4)
    with pytest.raises(ValueError, match="all boxes of a stream must be of one size"):
        dcs_jax.track_stream(clip.frames, [box], config=native, slots=2).add(box + SHIFTS[1])
