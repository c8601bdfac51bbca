"""Many targets in many videos, on one machine or on a Ray cluster: `dcs-jax batch`.

manifest.py  what to track: one row a video and target
video.py     one video: a first look, then all its targets, through targets.py and shared.py
engines.py   where the work is done, and again where it fails: local.py, cluster.py
results.py   what is finished, on disk
run.py       all of it: `run_batch`
"""

from dcs_jax.jobs.manifest import Target, Video, read_manifest
from dcs_jax.jobs.run import Batch, run_batch

__all__ = ["Batch", "Target", "Video", "read_manifest", "run_batch"]
