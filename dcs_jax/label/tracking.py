"""Tracking what is pending, while a person goes on editing."""

import asyncio
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from dcs_jax.annotate import Editor, Runs, Stretch, StretchTrack, prepare, track_stretches
from dcs_jax.config import Config
from dcs_jax.label.clip import Clip
from dcs_jax.label.threads import in_thread

_BATCHES = 4  # at a time: what was drawn meanwhile need not wait for what is long
_RATE_OVER = 3.0  # seconds over which frames per second are counted


class Tracking:
    """What is tracked of an editor's project.

    A batch is stopped when one of its stretches is not pending any more, as it was edited; the rest
    of it is tracked again with what is pending then.
    """

    def __init__(
        self,
        clip: Clip,
        editor: Editor,
        config: Config,
        seed: int,
        filled: Callable[[], None],
        changed: Callable[[], None],
    ) -> None:
        """filled: called after the editor got boxes; changed: after the status has changed."""
        self._clip, self._editor, self._config, self._seed = clip, editor, config, seed
        self._filled, self._changed = filled, changed
        self._runs = Runs()
        self._batches: dict[asyncio.Task[None], tuple[frozenset[Stretch], threading.Event]] = {}
        self._wake = asyncio.Event()
        self._compiling, self._paused, self._ended = True, False, False
        self._problem: str | None = None
        self._done: dict[Stretch, int] = {}  # frames of the stretches that are tracked
        self._recent: list[tuple[float, int]] = []  # when so many frames were done

    async def run(self) -> None:
        """Compile, then track whatever is pending, until `end`."""
        self._clip.set_busy(True)
        try:
            await in_thread(partial(prepare, self._clip.shape, self._config, self._seed))
        except ValueError as error:
            self._problem = str(error)
        self._compiling = False
        while not self._ended:
            self._start()
            self._clip.set_busy(bool(self._batches))
            self._changed()
            await self._wake.wait()
            self._wake.clear()

    def look(self) -> None:
        """Something was edited: stop what is not asked for any more, and track what is new."""
        pending = set(self._editor.pending())
        for stretches, stop in self._batches.values():
            if not stretches <= pending | self._finished():
                stop.set()
        self._problem = None
        self._changed()
        self._wake.set()

    def pause(self, paused: bool) -> None:
        """Stop tracking, or go on."""
        self._paused, self._problem = paused, None
        if paused:
            for _, stop in self._batches.values():
                stop.set()
        self._changed()
        self._wake.set()

    def end(self) -> None:
        """Stop for good."""
        self._ended = True
        self.pause(True)

    def status(self) -> dict[str, Any]:
        """What the page shows: state, frames done and their number, frames per second."""
        pending = self._editor.pending()
        state = "idle"
        if pending or self._batches:
            state = "stopped" if self._paused or self._problem else "tracking"
        if self._compiling:
            state = "compiling"
        tracked = [*self._done] if self._batches else pending
        total = sum(stretch.length for stretch in tracked)
        return {
            "type": "status",
            "state": state,
            "waiting": len(pending),
            "done": sum(self._done.values()) if self._batches else 0,
            "total": total,
            "rate": self._rate(),
            "problem": self._problem,
        }

    def _finished(self) -> set[Stretch]:
        return {stretch for stretch, done in self._done.items() if done >= stretch.length}

    def _start(self) -> None:
        """Start a batch with what is pending and not tracked yet."""
        if self._paused or self._ended or self._problem or len(self._batches) >= _BATCHES:
            return
        running = frozenset[Stretch]().union(*(of for of, _ in self._batches.values()))
        new = [stretch for stretch in self._editor.pending() if stretch not in running]
        if not new:
            return
        if not self._batches:
            self._done, self._recent = {}, []
        self._done |= dict.fromkeys(new, 0)
        stop = threading.Event()
        task = asyncio.create_task(self._track(new, stop))
        self._batches[task] = frozenset(new), stop
        task.add_done_callback(self._batch_done)

    def _batch_done(self, task: asyncio.Task[None]) -> None:
        stretches, stop = self._batches.pop(task)
        left = stretches & set(self._editor.pending())
        if not task.cancelled() and (error := task.exception()) is not None:
            self._problem = f"tracking stopped: {error}"
        elif left and not stop.is_set():
            self._problem = f"tracking stopped: {len(left)} stretches could not be completed"
        for stretch in stretches - self._finished():
            self._done.pop(stretch, None)
        self._wake.set()

    async def _track(self, stretches: list[Stretch], stop: threading.Event) -> None:
        loop = asyncio.get_running_loop()

        def on_progress(stretch: Stretch, track: StretchTrack, complete: bool) -> None:
            loop.call_soon_threadsafe(self._fill, stretch, track.copy(), complete)

        await in_thread(
            lambda: track_stretches(
                self._clip.frames,
                stretches,
                self._config,
                self._seed,
                on_progress,
                stop.is_set,
                self._runs,
            )
        )

    def _fill(self, stretch: Stretch, track: StretchTrack, complete: bool) -> None:
        done = stretch.length if complete else int((~np.isnan(track.boxes[:, 0])).sum())
        now = time.monotonic()
        if stretch in self._done:
            self._recent.append((now, max(done - self._done[stretch], 0)))
            self._done[stretch] = done
        self._recent = [entry for entry in self._recent if entry[0] > now - _RATE_OVER]
        if self._editor.fill(stretch, track, complete):
            self._filled()
        self._changed()

    def _rate(self) -> float | None:
        """Frames per second; None where it is not known yet."""
        if len(self._recent) < 2:
            return None
        seconds = self._recent[-1][0] - self._recent[0][0]
        return sum(count for _, count in self._recent[1:]) / seconds if seconds > 0.05 else None
