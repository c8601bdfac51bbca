"""Where the work of a batch is done: in threads of this process, or in tasks of a Ray cluster.

An engine knows nothing of tracking: it calls a function for every video, and again if that fails.

Do not fork a process that has used JAX: its threads do not exist in the child, which then hangs at
its first program. Start processes with the method spawn or forkserver, or fork before JAX is used.
"""

import importlib.util
import logging
import threading
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Collection, Generator, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from typing import Any, NamedTuple, Self

import jax

from dcs_jax.jobs.manifest import Video
from dcs_jax.runners.sharding import cores

OnFrames = Callable[[int], None]  # called with the number of frames tracked since the last call
Work = Callable[[Video, OnFrames], Any]  # its value is what has become of the video

# What a worker of Ray takes over from this process: where compiled programs are kept.
JAX_SETTINGS = ("jax_compilation_cache_dir", "jax_persistent_cache_min_compile_time_secs")
TASKS_PER_CORE = 2  # so that a worker that is done finds the next batch waiting


class WorkResult(NamedTuple):
    """What has become of a video: the value of its work, or else the reason why there is none."""

    video: Video
    value: Any
    reason: str | None


class Failed(NamedTuple):
    """In place of the value of work that raised."""

    reason: str


class Engine(ABC):
    """Does work on batches of videos, several at once, and again where it fails.

    workers: number of batches that are worked on at once.
    batch_frames: number of frames to track that are worth a batch of their own.
    """

    workers: int
    batch_frames: int

    def run(
        self,
        work: Work,
        batches: Iterable[Sequence[Video]],
        *,
        retries: int = 0,
        on_frames: OnFrames = lambda frames: None,
        on_retry: Callable[[Video, str], None] = lambda video, reason: None,
    ) -> Generator[WorkResult, None, None]:
        """Yield the result of every video once, in the order in which they are done.

        A video whose work fails, or whose worker dies, is worked on again when the rest is done,
        up to `retries` times. It is then alone in its batch, so that no other video fails with it.

        on_frames: called with the number of frames tracked; a negative number where work is lost.
        on_retry: called with the video and the reason at every failure but the last.
        """
        waiting = deque((list(batch), retries) for batch in batches)
        running: dict[Any, tuple[list[Video], int]] = {}
        try:
            while waiting or running:
                while waiting and len(running) < self.workers:
                    batch, left = waiting.popleft()
                    running[self.submit(work, batch, on_frames)] = batch, left
                for handle in self.wait(running):
                    batch, left = running.pop(handle)
                    values = self.values(handle, batch, on_frames)
                    for video, value in zip(batch, values, strict=True):
                        if not isinstance(value, Failed):
                            yield WorkResult(video, value, None)
                        elif left:
                            on_retry(video, value.reason)
                            waiting.append(([video], left - 1))
                        else:
                            yield WorkResult(video, None, value.reason)
        finally:
            self.stop(running)

    @abstractmethod
    def submit(self, work: Work, batch: list[Video], on_frames: OnFrames) -> Any:
        """Start the work on a batch; returns a handle."""

    @abstractmethod
    def wait(self, handles: Collection[Any]) -> Iterable[Any]:
        """Wait until at least one batch is done; returns the handles of those that are."""

    @abstractmethod
    def values(self, handle: Any, batch: list[Video], on_frames: OnFrames) -> list[Any]:
        """The values of a batch that is done, one per video, `Failed` where there is none."""

    @abstractmethod
    def stop(self, handles: Collection[Any]) -> None:
        """Abandon the batches that are running, if any: the run is over."""

    @abstractmethod
    def __enter__(self) -> Self: ...

    @abstractmethod
    def __exit__(self, *error: object) -> None: ...


class LocalEngine(Engine):
    """Threads of this process, a video each, all with the same compiled programs.

    Decoding and tracking release the interpreter's lock, so that threads run at the same time.

    workers: number of videos at once, by default one per core that this process may use.
    """

    batch_frames = 1  # threads share their programs: a video is enough

    def __init__(self, workers: int | None = None) -> None:
        self.workers = workers or cores()
        self._stopping = threading.Event()

    def __enter__(self) -> Self:
        self._threads = ThreadPoolExecutor(self.workers)
        return self

    def __exit__(self, *error: object) -> None:
        self._threads.shutdown(cancel_futures=True)

    def submit(self, work: Work, batch: list[Video], on_frames: OnFrames) -> Future[list[Any]]:
        """Give the batch to a thread."""
        return self._threads.submit(_values, work, batch, on_frames, self._stopping)

    def wait(self, handles: Collection[Future[list[Any]]]) -> Iterable[Future[list[Any]]]:
        """Wait for the first futures that are done."""
        return wait(handles, return_when=FIRST_COMPLETED).done

    def values(
        self, handle: Future[list[Any]], batch: list[Video], on_frames: OnFrames
    ) -> list[Any]:
        """What the thread returned."""
        return handle.result()

    def stop(self, handles: Collection[Future[list[Any]]]) -> None:
        """Let every thread end after its current chunk of frames."""
        self._stopping.set()
        wait(handles)
        self._stopping.clear()


class RayEngine(Engine):
    """Tasks of one core each on a Ray cluster. Needs Ray, the extra `ray`.

    The cluster is the one at RAY_ADDRESS, or the one that `ray start` has started on this machine;
    if there is none, one is started here and ends with the engine. Results come back through Ray
    and are written by this process: a worker needs dcs_jax and the videos under the same paths.

    workers: number of tasks at once, by default enough for all cores of the cluster; a cluster that
        is started here has as many cores.

    Raises ValueError where Ray is not installed, ConnectionError where RAY_ADDRESS does not answer.
    """

    # Some ten seconds of work or more: at worst a program is compiled once per batch, and a batch
    # is the most that is lost with a worker.
    batch_frames = 10_000

    def __init__(self, workers: int | None = None) -> None:
        if importlib.util.find_spec("ray") is None:
            raise ValueError("the engine ray needs the package ray: pip install 'dcs-jax[ray]'")
        self._max_tasks = workers
        self._connected = False

    def __enter__(self) -> Self:
        import ray  # takes a second to import, and is optional

        self._ray = ray
        if not ray.is_initialized():
            # The workers' own messages, such as OpenCV's on a broken video, stay in Ray's logs.
            quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR}
            try:
                ray.init(num_cpus=self._max_tasks or cores(), include_dashboard=False, **quiet)
            except ValueError:  # there is a cluster, and it has its own number of cores
                ray.init(**quiet)
            self._connected = True
        self.workers = self._max_tasks or TASKS_PER_CORE * int(
            ray.cluster_resources().get("CPU", 1)
        )
        # `run` submits lost tasks again, and counts them.
        self._task = ray.remote(num_cpus=1, max_retries=0)(_values_and_frames)
        self._settings = {name: getattr(jax.config, name) for name in JAX_SETTINGS}
        return self

    def __exit__(self, *error: object) -> None:
        if self._connected:
            self._ray.shutdown()

    def submit(self, work: Work, batch: list[Video], on_frames: OnFrames) -> Any:
        """Give the batch to the cluster."""
        return self._task.remote(work, batch, self._settings)

    def wait(self, handles: Collection[Any]) -> Iterable[Any]:
        """Wait for the first task that is done."""
        return self._ray.wait(list(handles), num_returns=1)[0]

    def values(self, handle: Any, batch: list[Video], on_frames: OnFrames) -> list[Any]:
        """What the task returned; all of its videos have failed where its worker died."""
        try:
            values, frames = self._ray.get(handle)
        except self._ray.exceptions.RayError as error:
            lost = Failed(f"the worker was lost: {type(error).__name__}")
            return [lost] * len(batch)
        on_frames(frames)
        return values

    def stop(self, handles: Collection[Any]) -> None:
        """Cancel the tasks."""
        for handle in handles:
            self._ray.cancel(handle, force=True)


def _values(
    work: Work, batch: list[Video], on_frames: OnFrames, stopping: threading.Event
) -> list[Any]:
    """The value of every video of a batch, `Failed` where its work raised or is to stop."""
    return [_value(work, video, on_frames, stopping) for video in batch]


def _value(work: Work, video: Video, on_frames: OnFrames, stopping: threading.Event) -> Any:
    tracked = 0

    def count(frames: int) -> None:
        nonlocal tracked
        if stopping.is_set():
            raise _StoppedError
        tracked += frames
        on_frames(frames)

    try:
        return work(video, count)
    except Exception as error:
        on_frames(-tracked)
        return Failed(_reason(error))


def _values_and_frames(
    work: Work, batch: list[Video], settings: dict[str, Any]
) -> tuple[list[Any], int]:
    """In a worker of Ray: the values of a batch, and the number of frames tracked for them."""
    for name, value in settings.items():
        jax.config.update(name, value)
    frames: list[int] = []
    return _values(work, batch, frames.append, threading.Event()), sum(frames)


def _reason(error: Exception) -> str:
    """An error in one line: a ValueError is ours and says it all, any other needs its type."""
    text = " ".join(str(error).split())
    return text if isinstance(error, ValueError) and text else f"{type(error).__name__}: {text}"


class _StoppedError(Exception):
    """Raised in a thread that is to end."""
