"""What the command line sets for the process; the caller's environment has precedence."""

import io
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

import cv2


def silence_opencv() -> None:
    """Keep OpenCV and FFmpeg from writing to the terminal: errors are reported in one line."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    if "OPENCV_LOG_LEVEL" not in os.environ:
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


_ENDING = ("SIGINT", "SIGTERM", "SIGHUP")  # Windows has not all of them


def end_like_ctrl_c() -> None:
    """Let the signals that end a process do what Ctrl-C does: what is tracked is kept.

    Those that the caller ignores, as `nohup` does, stay ignored.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    for number in _ending_signals():
        if signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _interrupt)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Let the signals that end the process wait until this is done: it is whole or not begun."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    waiting: list[int] = []
    handlers = {number: signal.getsignal(number) for number in _ending_signals()}
    for number in handlers:
        signal.signal(number, lambda number, frame: waiting.append(number))
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for missed in waiting:
            signal.raise_signal(missed)


def _ending_signals() -> list[signal.Signals]:
    return [getattr(signal, name) for name in _ENDING if hasattr(signal, name)]


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def print_any_name() -> None:
    """Print names of files that are not in the terminal's encoding, with what is not as \\x."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
