"""Boxes of objects through a clip, drawn in some frames and tracked in the rest.

    project = Project("clip.mp4", fingerprint("clip.mp4"), size=(640, 480), length=900, fps=25)
    editor = Editor(project)
    id = editor.add_object(0, (99, 146, 48, 64))
    for stretch, track in track_stretches(open_frames, editor.pending()).items():
        editor.fill(stretch, track)
    frame, id = editor.next_doubtful(0)
    editor.set_keyframe(id, frame, (131, 120, 52, 68))

A person's edits are data without a tracker, a server or a page in it: `Editor`. All frames between
two keyframes are tracked from both and joined: `track_between` does it for one object.
"""

from dcs_jax.annotate.editing import Editor
from dcs_jax.annotate.exporting import from_tracks, to_tracks
from dcs_jax.annotate.project import Box, Keyframe, ObjectLane, Project
from dcs_jax.annotate.store import default_path, fingerprint, load, save
from dcs_jax.annotate.stretches import Stretch, StretchTrack
from dcs_jax.annotate.tracking import Runs, prepare, track_between, track_stretches

__all__ = [
    "Box",
    "Editor",
    "Keyframe",
    "ObjectLane",
    "Project",
    "Runs",
    "Stretch",
    "StretchTrack",
    "default_path",
    "fingerprint",
    "from_tracks",
    "load",
    "prepare",
    "save",
    "to_tracks",
    "track_between",
    "track_stretches",
]
