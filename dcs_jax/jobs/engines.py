"""Where the work of a batch is done. An engine knows nothing of tracking."""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Collection, Generator, Iterable, Sequence
from typing import Any, NamedTuple

from dcs_jax.jobs.manifest import Video

Advance = Callable[[int], None]
Work = Callable[[Video, Advance], Any]  # of a video; tells how far it is


class Outcome(NamedTuple):
    """What became of a video: the value of its work, or else the reason why there is none."""

    video: Video
    value: Any
    reason: str | None


class Failed(NamedTuple):
    """In place of the value of work that raised."""

    reason: str


class Engine(ABC):
    """Does work on batches of videos, several at once, and again where it fails.

    workers: the number of batches that are worked on at once.
    batch_frames: how many frames to track are worth a batch of their own.
    """

    workers: int
    batch_frames: int

    def run(
        self,
        work: Work,
        batches: Iterable[Sequence[Video]],
        *,
        retries: int = 0,
        advance: Advance = lambda frames: None,
        retrying: Callable[[Video, str], None] = lambda video, reason: None,
    ) -> Generator[Outcome, None, None]:
        """What becomes of every video, each once, as they are done.

        A video whose work fails, or whose worker dies, is worked on again when the rest is done,
        up to `retries` times and by itself, so that it takes no other one with it.

        advance: is told the frames tracked; a negative number where work is lost.
        retrying: is told of every failure that is not yet the last, with the reason.
        """
        waiting = deque((list(batch), retries) for batch in batches)
        running: dict[Any, tuple[list[Video], int]] = {}
        try:
            while waiting or running:
                while waiting and len(running) < self.workers:
                    batch, left = waiting.popleft()
                    running[self.submit(work, batch, advance)] = batch, left
                for handle in self.wait(running):
                    batch, left = running.pop(handle)
                    for video, value in zip(
                        batch, self.values(handle, batch, advance), strict=True
                    ):
                        if not isinstance(value, Failed):
                            yield Outcome(video, value, None)
                        elif left:
                            retrying(video, value.reason)
                            waiting.append(([video], left - 1))
                        else:
                            yield Outcome(video, None, value.reason)
        finally:
            self.stop(running)

    @abstractmethod
    def submit(self, work: Work, batch: list[Video], advance: Advance) -> Any:
        """Begin the work on a batch; returns a handle."""

    @abstractmethod
    def wait(self, handles: Collection[Any]) -> Iterable[Any]:
        """The handles that are done, at least one of them."""

    @abstractmethod
    def values(self, handle: Any, batch: list[Video], advance: Advance) -> list[Any]:
        """The values of a batch that is done, one a video, `Failed` where there is none."""

    @abstractmethod
    def stop(self, handles: Collection[Any]) -> None:
        """Give up on what is begun, if anything: the run is over."""

    @abstractmethod
    def __enter__(self) -> "Engine": ...

    @abstractmethod
    def __exit__(self, *error: object) -> None: ...


def reason_of(error: BaseException) -> str:
    """An error in one line: what we raise says it all, of others the type is worth knowing."""
    text = " ".join(str(error).split())
    return text if isinstance(error, ValueError) and text else f"{type(error).__name__}: {text}"
