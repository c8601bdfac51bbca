"""What the command line sets for the process; the caller's environment has precedence."""

import io
import os
import signal
import sys
import threading
from types import FrameType

import cv2


def silence_opencv() -> None:
    """Keep OpenCV and FFmpeg from writing to the terminal: errors are reported in one line."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    if "OPENCV_LOG_LEVEL" not in os.environ:
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


def end_like_ctrl_c() -> None:
    """Let the signals that end a process do what Ctrl-C does: what is tracked is kept.

    Those that the caller ignores, as `nohup` does, stay ignored.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)  # Windows has no SIGHUP
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _interrupt)


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def print_any_name() -> None:
    """Print names of files that are not in the terminal's encoding, with what is not as \\x."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
