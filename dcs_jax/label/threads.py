"""Work in a thread that does not keep the process from ending."""

import asyncio
import contextlib
import os
import sys
import threading
import time
from collections.abc import Callable
from typing import TypeVar

_T = TypeVar("_T")
_NAME = "label: work"


async def in_thread(work: Callable[[], _T]) -> _T:
    """What `work` returns or raises, done in a daemon thread.

    `asyncio.to_thread` is not used: the process waits for its threads, which may be compiling.
    """
    loop = asyncio.get_running_loop()
    done: asyncio.Future[_T] = loop.create_future()

    def settle(result: _T | None, error: BaseException | None) -> None:
        if done.cancelled():
            return
        if error is not None:
            done.set_exception(error)
        else:
            done.set_result(result)  # type: ignore[arg-type]

    def run() -> None:
        result, error = None, None
        try:
            result = work()
        except BaseException as raised:
            error = raised
        with contextlib.suppress(RuntimeError):  # the server has ended meanwhile
            loop.call_soon_threadsafe(settle, result, error)

    threading.Thread(target=run, daemon=True, name=_NAME).start()
    return await done


async def all_done(seconds: float) -> bool:
    """Wait until no thread works any more, at most so long: whether none does."""
    until = time.monotonic() + seconds
    while working := _working():
        if time.monotonic() > until:
            break
        await asyncio.sleep(0.02)
    return not working


def _working() -> bool:
    return any(thread.name == _NAME for thread in threading.enumerate())


def end_process() -> None:
    """End the process now if work is still done in a thread, which would abort with it."""
    if _working():
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)
