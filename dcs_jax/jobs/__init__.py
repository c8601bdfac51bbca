"""Many targets in many videos, on one machine or on a Ray cluster: `dcs-jax batch`.

manifest.py  what to track: one row per video and target
video.py     one video: checked, then all its targets tracked in one pass
shared.py    the frames of a video, decoded once for all its targets
engines.py   where the work is done, and done again where it fails
results.py   what is finished, on disk
run.py       all of it: `run_batch`
"""

from dcs_jax.jobs.manifest import Target, Video, read_manifest
from dcs_jax.jobs.run import Batch, run_batch

__all__ = ["Batch", "Target", "Video", "read_manifest", "run_batch"]
