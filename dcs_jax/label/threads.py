"""Work in a thread that does not keep the process from ending."""

import asyncio
import threading
from collections.abc import Callable


async def in_thread[T](work: Callable[[], T]) -> T:
    """What `work` returns or raises, done in a daemon thread.

    `asyncio.to_thread` is not used: the process waits for its threads, which may be compiling.
    """
    loop = asyncio.get_running_loop()
    done: asyncio.Future[T] = loop.create_future()

    def settle(result: T | None, error: BaseException | None) -> None:
        if done.cancelled():
            return
        if error is not None:
            done.set_exception(error)
        else:
            done.set_result(result)

    def run() -> None:
        result, error = None, None
        try:
            result = work()
        except BaseException as raised:
            error = raised
        try:
            loop.call_soon_threadsafe(settle, result, error)
        except RuntimeError:  # the server has ended meanwhile
            pass

    threading.Thread(target=run, daemon=True, name="label").start()
    return await done
