"""Follow any box through a video: online boosting with l1-selected classifiers, in JAX.

Only the names here and in the submodules `annotate`, `evaluation`, `jobs` and `synthetic` are
stable.
"""

from dcs_jax.compilation import cache
from dcs_jax.config import (
    AspectRatio,
    ColourHistograms,
    Config,
    Redetection,
    RotationFilter,
    ScaleFilter,
    TranslationFilter,
    Verification,
)
from dcs_jax.runners.batch import track_batch
from dcs_jax.runners.live import MultiTracker, Result, Tracker
from dcs_jax.runners.sequence import track_chunk, track_sequence
from dcs_jax.runners.stream import Chunk, Stream, track_stream
from dcs_jax.saving import Saved, load, save
from dcs_jax.solvers.select import Selection, select_classifiers
from dcs_jax.tracker import init, score, step
from dcs_jax.types import State, StepInfo, Track

__all__ = [
    "AspectRatio",
    "Chunk",
    "ColourHistograms",
    "Config",
    "MultiTracker",
    "Redetection",
    "Result",
    "RotationFilter",
    "Saved",
    "ScaleFilter",
    "Selection",
    "State",
    "StepInfo",
    "Stream",
    "Track",
    "Tracker",
    "TranslationFilter",
    "Verification",
    "cache",
    "init",
    "load",
    "save",
    "score",
    "select_classifiers",
    "step",
    "track_batch",
    "track_chunk",
    "track_sequence",
    "track_stream",
]

__version__ = "0.2.0"
