"""A project in the formats of other tools, as a file that a browser can keep."""

import io
import tempfile
import zipfile
from pathlib import Path
from typing import NamedTuple

from dcs_jax import formats
from dcs_jax.annotate import Project, to_tracks


class Export(NamedTuple):
    """A file: its name, its media type and its content."""

    name: str
    media_type: str
    content: bytes


def export_name(project: Project, format: str) -> str:
    """The name that an export has by default: that of the clip; without a suffix for a folder.

    Raises ValueError where there is no such format, or the project has no objects.
    """
    if format not in formats.FORMATS:
        raise ValueError(f"format must be one of {', '.join(formats.NAMES)}, but is {format!r}")
    if not project.objects:
        raise ValueError("there are no objects to export: draw a box first")
    clip = Path(project.clip)
    stem = clip.stem or clip.name or "clip"
    if format == "otb" and len(project.objects) > 1:
        return f"{stem}_otb"
    return f"{stem}_{format}{formats.FORMATS[format].suffix}"


def export(project: Project, format: str) -> Export:
    """The project in a format; a folder becomes a zip archive.

    Raises ValueError where there is no such format, or it cannot hold the project.
    """
    name = export_name(project, format)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        formats.write(path, to_tracks(project), format)
        if path.is_file():
            return Export(name, "application/octet-stream", path.read_bytes())
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            for file in sorted(path.rglob("*")):
                archive.write(file, Path(name) / file.relative_to(path))
        return Export(f"{name}.zip", "application/zip", packed.getvalue())
