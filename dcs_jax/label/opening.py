"""What a page begins with: the clip, and its project as it was left or a new one."""

import json
from dataclasses import replace
from pathlib import Path
from typing import IO, Any, NamedTuple

from dcs_jax import formats
from dcs_jax.annotate import Project, default_path, fingerprint, from_tracks, load
from dcs_jax.annotate.store import KIND
from dcs_jax.config import Config
from dcs_jax.evaluation.settings import with_changes
from dcs_jax.io.files import lock
from dcs_jax.label.clip import Clip


class Opened(NamedTuple):
    """A clip and its project. path: file of the project. config, seed: of the tracker."""

    clip: Clip
    project: Project
    path: Path
    config: Config
    seed: int


def open_project(
    clip: Path,
    path: Path | None = None,
    boxes: Path | None = None,
    preset: str | None = None,
    seed: int | None = None,
    changes: str | None = None,
) -> Opened:
    """Open a clip with its project; nothing is written.

    path: file of the project, by default beside the clip. boxes: another project, or tracks of any
    format, to go on from. preset, seed, changes: of the tracker, as of `dcs-jax track`, for a new
    project; one that is there has its own.

    Raises ValueError where the clip or a file is not what it should be, the clip is not the one of
    the project, or the settings are others than those that the project was made with.
    """
    opened = Clip(clip)
    try:
        return _open(opened, clip, path or default_path(clip), boxes, preset, seed, changes)
    except BaseException:
        opened.close()
        raise


def _open(
    opened: Clip,
    clip: Path,
    path: Path,
    boxes: Path | None,
    preset: str | None,
    seed: int | None,
    changes: str | None,
) -> Opened:
    given = {"preset": preset, "seed": seed, "changes": changes}
    wanted = {name: value for name, value in given.items() if value is not None}
    height, width, _ = opened.shape
    if path.exists():
        project = load(path, clip)
        if project.size != (width, height) or project.length != opened.length:
            raise ValueError(
                f"{path} is of {project.length} frames of {project.size[0]} x {project.size[1]} "
                f"pixels, but {clip} has {opened.length} of {width} x {height} that can be read"
            )
        if boxes is not None and project.objects:
            raise ValueError(
                f"{path} has objects already: name another file by --project to begin with {boxes}"
            )
        other = {n: v for n, v in wanted.items() if project.settings.get(n) != v}
        if other and project.objects:
            raise ValueError(
                f"{path} was tracked with {_text(project.settings)}, which cannot be changed to "
                f"{_text(other)}: name another file by --project"
            )
        settings = {**project.settings, **wanted}
        project = replace(project, settings=settings)
    else:
        settings = {"preset": "default", "seed": 0, **wanted}
        project = Project(
            clip=str(clip),
            fingerprint=fingerprint(clip),
            size=(width, height),
            length=opened.length,
            fps=opened.fps,
            settings=settings,
        )
    if boxes is not None:
        project = _begin_with(boxes, project)
    together = [settings["changes"]] if settings.get("changes") else []
    config = with_changes([settings["preset"]], together)[-1].config("")
    return Opened(opened, project, path, config, settings["seed"])


def hold(path: Path) -> IO[str] | None:
    """Keep other servers from a project until what is returned is closed, or the process ends.

    Two would overwrite what the other has saved. Beside the project is a hidden file for it; None
    where none can be made, as the folder cannot be written.

    Raises ValueError where another server has the project.
    """
    try:
        file = open(path.with_name(f".{path.name}.lock"), "w")  # noqa: SIM115 (it stays open)
    except OSError:
        return None
    try:
        lock(file)
    except ValueError:
        raise ValueError(
            f"{path} is open in another dcs-jax label: use its page, or end it first"
        ) from None
    return file


def _begin_with(boxes: Path, project: Project) -> Project:
    if not is_project(boxes):
        return from_tracks(formats.read(boxes, size=project.size), project)
    other = load(boxes)
    if (other.size, other.length) != (project.size, project.length):
        raise ValueError(
            f"{boxes} is of a clip of {other.length} frames of {other.size[0]} x {other.size[1]} "
            f"pixels, but this one has {project.length} of {project.size[0]} x {project.size[1]}"
        )
    return replace(project, objects=other.objects)


def is_project(path: Path) -> bool:
    """Whether a file is a project, not tracks in a format that is JSON, too."""
    if path.suffix.lower() != ".json" or not path.is_file():
        return False
    try:
        content = json.loads(path.read_bytes())
    except (ValueError, RecursionError):
        return path.name.endswith(".dcs.json")  # one that is damaged, as `load` then says
    return isinstance(content, dict) and content.get("kind") == KIND


def _text(settings: Any) -> str:
    return ", ".join(f"{name} {value}" for name, value in settings.items())
