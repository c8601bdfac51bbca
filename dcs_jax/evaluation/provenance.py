"""What a result depends on, as short digests: only results of the same digest are reused."""

import functools
import hashlib
import json
import os
import platform
from importlib import resources
from typing import Any

import cv2
import jax
import numpy as np

import dcs_jax

# The sources that decide the boxes: the tracker, how frames are read, how seeds are run. The
# command line and the report may change without making results stale.
SOURCES = (
    *(f"{room}*.py" for room in ("", "core/", "extensions/", "runners/", "solvers/")),
    "io/frames.py",
    "evaluation/runner.py",
)
BASELINE_SOURCES = ("io/frames.py", "evaluation/baselines.py")


@functools.cache
def code_version() -> str:
    """Digest of the sources that decide the boxes, and of the version of JAX."""
    return digest([_sources(SOURCES), jax.__version__])


@functools.cache
def baseline_version() -> str:
    """Digest of the sources that decide the boxes of a baseline, and of the version of OpenCV."""
    return digest([_sources(BASELINE_SOURCES), cv2.__version__])


def digest(value: Any) -> str:
    """Digest of a value as JSON; what JSON cannot hold counts by its `str`."""
    text = json.dumps(value, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def environment() -> dict[str, Any]:
    """Versions and machine that the results are made with."""
    return {
        "dcs_jax": dcs_jax.__version__,
        "jax": jax.__version__,
        "device": jax.devices()[0].device_kind,
        "opencv": cv2.__version__,
        "numpy": np.__version__,
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        "cores": os.cpu_count(),
    }


def _sources(patterns: tuple[str, ...]) -> list[str]:
    root = resources.files("dcs_jax")
    with resources.as_file(root) as folder:
        paths = sorted({path for pattern in patterns for path in folder.glob(pattern)})
        return [path.name + hashlib.sha256(path.read_bytes()).hexdigest() for path in paths]
