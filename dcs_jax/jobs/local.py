"""The engine of this machine: a video a thread, all with the same compiled programs."""

import threading
from collections.abc import Collection, Iterable
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from typing import Any

from dcs_jax.jobs.engines import Advance, Engine, Failed, Work, reason_of
from dcs_jax.jobs.manifest import Video
from dcs_jax.runners.sharding import cores


class LocalEngine(Engine):
    """Threads of this process; decoding and tracking let each other run.

    workers: videos at once, by default one for each core this process may use.
    """

    batch_frames = 1  # threads share their programs: a video is enough

    def __init__(self, workers: int | None = None) -> None:
        self.workers = workers or cores()
        self._stopping = threading.Event()

    def __enter__(self) -> "LocalEngine":
        self._threads = ThreadPoolExecutor(self.workers)
        return self

    def __exit__(self, *error: object) -> None:
        self._threads.shutdown(cancel_futures=True)

    def submit(self, work: Work, batch: list[Video], advance: Advance) -> Future[list[Any]]:
        """Give the batch to a thread."""
        return self._threads.submit(self._do, work, batch, advance)

    def wait(self, handles: Collection[Future[list[Any]]]) -> Iterable[Future[list[Any]]]:
        """The futures that are done."""
        return wait(handles, return_when=FIRST_COMPLETED).done

    def values(self, handle: Future[list[Any]], batch: list[Video], advance: Advance) -> list[Any]:
        """What the thread returned."""
        return handle.result()

    def stop(self, handles: Collection[Future[list[Any]]]) -> None:
        """Let the threads end after the chunk of frames they are at."""
        self._stopping.set()
        wait(handles)
        self._stopping.clear()

    def _do(self, work: Work, batch: list[Video], advance: Advance) -> list[Any]:
        return [self._do_one(work, video, advance) for video in batch]

    def _do_one(self, work: Work, video: Video, advance: Advance) -> Any:
        done = 0

        def told(frames: int) -> None:
            nonlocal done
            if self._stopping.is_set():
                raise _StoppedError
            done += frames
            advance(frames)

        try:
            return work(video, told)
        except Exception as error:
            advance(-done)
            return Failed(reason_of(error))


class _StoppedError(Exception):
    """Raised in a thread that is to end."""
