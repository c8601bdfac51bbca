"""The engine of a Ray cluster: a batch of videos a task. Needs Ray, the extra `ray`."""

import importlib.util
import logging
from collections.abc import Collection, Iterable
from typing import Any

import jax

from dcs_jax.jobs.engines import Advance, Engine, Failed, Work, reason_of
from dcs_jax.jobs.manifest import Video
from dcs_jax.runners.sharding import cores

# What a worker takes over from this process: where compiled programs are kept.
SETTINGS = ("jax_compilation_cache_dir", "jax_persistent_cache_min_compile_time_secs")
TASKS_A_CORE = 2  # so that a worker that is done finds the next batch waiting


class RayEngine(Engine):
    """Tasks of one core each on the cluster at RAY_ADDRESS or the one `ray start` has begun here.

    Where there is none, one is begun on this machine for as long as the engine is entered. Results
    come back through Ray and are written by this process; only the videos have to be where the
    workers find them, under the same names, and dcs_jax has to be installed there.

    workers: tasks at once, by default all cores of the cluster; a cluster that is begun here has as
        many workers.

    Raises ValueError where Ray is not installed, ConnectionError where RAY_ADDRESS does not answer.
    """

    # Some ten seconds of work or more: a program is compiled once for a batch at worst, and what
    # is lost with a worker is no more than a batch.
    batch_frames = 10_000

    def __init__(self, workers: int | None = None) -> None:
        if importlib.util.find_spec("ray") is None:
            raise ValueError("the engine ray needs the package ray: pip install 'dcs-jax[ray]'")
        self._wanted = workers
        self._begun = False

    def __enter__(self) -> "RayEngine":
        import ray  # takes a second to import, and is optional

        self._ray = ray
        if not ray.is_initialized():
            # The workers' own messages, such as OpenCV's on a broken video, stay in Ray's logs.
            quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR}
            try:
                ray.init(num_cpus=self._wanted or cores(), include_dashboard=False, **quiet)
            except ValueError:  # there is a cluster, and it has its own number of cores
                ray.init(**quiet)
            self._begun = True
        self.workers = self._wanted or TASKS_A_CORE * int(ray.cluster_resources().get("CPU", 1))
        # Lost tasks are begun again by `run`, which counts them.
        self._task = ray.remote(num_cpus=1, max_retries=0)(_do)
        self._settings = {name: getattr(jax.config, name) for name in SETTINGS}
        return self

    def __exit__(self, *error: object) -> None:
        if self._begun:
            self._ray.shutdown()

    def submit(self, work: Work, batch: list[Video], advance: Advance) -> Any:
        """Give the batch to the cluster."""
        return self._task.remote(work, batch, self._settings)

    def wait(self, handles: Collection[Any]) -> Iterable[Any]:
        """The first task that is done."""
        return self._ray.wait(list(handles), num_returns=1)[0]

    def values(self, handle: Any, batch: list[Video], advance: Advance) -> list[Any]:
        """What the task returned; all of its videos have failed where its worker died."""
        try:
            done = self._ray.get(handle)
        except self._ray.exceptions.RayError as error:
            lost = Failed(f"the worker was lost: {type(error).__name__}")
            return [lost] * len(batch)
        advance(sum(frames for value, frames in done if not isinstance(value, Failed)))
        return [value for value, _ in done]

    def stop(self, handles: Collection[Any]) -> None:
        """Cancel the tasks."""
        for handle in handles:
            self._ray.cancel(handle, force=True)


def _do(work: Work, batch: list[Video], settings: dict[str, Any]) -> list[tuple[Any, int]]:
    """In a worker: the value of every video of the batch, and the frames tracked for it."""
    for name, value in settings.items():
        jax.config.update(name, value)
    return [_do_one(work, video) for video in batch]


def _do_one(work: Work, video: Video) -> tuple[Any, int]:
    frames: list[int] = []
    try:
        return work(video, frames.append), sum(frames)
    except Exception as error:
        return Failed(reason_of(error)), 0
