"""Settings of the libraries under the command line; the caller's environment has precedence."""

import os
from pathlib import Path

import cv2
import jax

CACHE_NAME = "dcs_jax"
CACHE_FROM_SECONDS = 0.2  # programs that compile faster than this are not worth a file


def silence_opencv() -> None:
    """Keep OpenCV and FFmpeg from writing to the terminal: errors are reported in one line."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    if "OPENCV_LOG_LEVEL" not in os.environ:
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


def keep_compiled_programs() -> None:
    """Let JAX keep its compiled programs in the user's cache, so that only the first run waits."""
    if "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / CACHE_NAME
    for name, value in (
        ("jax_compilation_cache_dir", str(cache)),
        ("jax_persistent_cache_min_compile_time_secs", CACHE_FROM_SECONDS),
    ):
        jax.config.update(name, value)
