"""What a batch is made of: frames shared by readers, and work that is repeated where it fails."""

import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dcs_jax.io.frames import BrokenSource, FrameSource
from dcs_jax.jobs.engines import LocalEngine, WorkResult
from dcs_jax.jobs.manifest import Video
from dcs_jax.jobs.shared import SharedFrames


class Numbers(FrameSource):
    """Frames that hold their index, each decoded once."""

    name, shape, start = "numbers", (1, 1, 3), 0

    def __init__(self, length):
        self._frames = range(length)
        self.decoded = 0

    def __iter__(self):
        for index in self._frames:
            self.decoded += 1
            yield np.full((1, 1, 3), index, np.uint8)


@given(st.lists(st.tuples(st.integers(0, 19), st.integers(1, 20)), min_size=1), st.data())
def test_every_reader_gets_its_frames_in_any_order_of_reading(spans, data):
    source = Numbers(40)
    frames = SharedFrames(source)
    readers = {n: frames.reader(a, a + length) for n, (a, length) in enumerate(spans)}
    read: dict[int, list[int]] = {n: [] for n in readers}
    while readers:
        n = data.draw(st.sampled_from(sorted(readers)))
        frame = next(readers[n], None)
        if frame is None:
            del readers[n]
        else:
            read[n].append(int(frame[0, 0, 0]))
    assert read == {n: list(range(a, a + length)) for n, (a, length) in enumerate(spans)}
    assert source.decoded == max(a + length for a, length in spans)


def test_frames_that_all_have_read_are_dropped():
    frames = SharedFrames(Numbers(100))
    ahead, behind = frames.reader(0, 100), frames.reader(50, 100)
    for _ in range(60):
        next(ahead)
    assert len(frames._kept) == 10
    for _ in range(8):
        next(behind)
    next(ahead)
    assert len(frames._kept) == 3


def test_readers_may_be_in_threads():
    source = Numbers(200)
    frames = SharedFrames(source)
    readers = [frames.reader(n, 200) for n in range(4)]
    read: list[list[int]] = [[] for _ in readers]

    def read_all(n):
        read[n].extend(int(frame[0, 0, 0]) for frame in readers[n])

    threads = [threading.Thread(target=read_all, args=(n,)) for n in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert read == [list(range(n, 200)) for n in range(4)]
    assert source.decoded == 200


@pytest.mark.parametrize("span", [(10, None), (2, 11)])
def test_a_source_that_ends_too_early_is_broken(span):
    reader = SharedFrames(Numbers(10)).reader(*span)
    with pytest.raises(BrokenSource, match="numbers has 10 frames, but the range is"):
        list(reader)


def test_failed_work_is_done_again_and_then_given_up():
    calls = dict.fromkeys("abcd", 0)
    frames: list[int] = []
    retried = []

    def work(video, on_frames):
        calls[video.source] += 1
        on_frames(10)
        if video.source == "b" and calls["b"] < 3:
            raise OSError("not now")
        if video.source == "c":
            raise ValueError("never")
        return video.source.upper()

    videos = {name: Video(name, ()) for name in calls}
    batches = [[videos["a"], videos["b"]], [videos["c"], videos["d"]]]
    with LocalEngine(2) as engine:
        results = list(
            engine.run(
                work,
                batches,
                retries=2,
                on_frames=frames.append,
                on_retry=lambda video, reason: retried.append((video.source, reason)),
            )
        )
    assert sorted(results, key=lambda result: result.video.source) == [
        WorkResult(videos["a"], "A", None),
        WorkResult(videos["b"], "B", None),
        WorkResult(videos["c"], None, "never"),
        WorkResult(videos["d"], "D", None),
    ]
    assert calls == {"a": 1, "b": 3, "c": 3, "d": 1}
    assert sorted(retried) == [("b", "OSError: not now")] * 2 + [("c", "never")] * 2
    assert sum(frames) == 30  # lost work does not count


def test_what_is_running_ends_when_the_run_is_closed():
    ended = []

    def work(video, on_frames):
        try:
            while True:
                on_frames(0)
        finally:
            ended.append(video.source)

    def fast(video, on_frames):
        return None if video.source == "fast" else work(video, on_frames)

    with LocalEngine(2) as engine:
        run = engine.run(fast, [[Video("slow", ())], [Video("fast", ())]])
        assert next(run).video.source == "fast"
        run.close()
        assert ended == ["slow"]
