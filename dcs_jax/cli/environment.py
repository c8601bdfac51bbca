"""Settings of the libraries under the command line; the caller's environment has precedence."""

import os

import cv2


def silence_opencv() -> None:
    """Keep OpenCV and FFmpeg from writing to the terminal: errors are reported in one line."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    if "OPENCV_LOG_LEVEL" not in os.environ:
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
