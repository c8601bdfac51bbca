"""One project that is worked on: edits come in, tracks follow, all who watch are told.

Everything here runs in the thread of the event loop, but for tracking, compiling and saving, which
have threads of their own and hand back what they have done.
"""

import asyncio
import base64
import contextlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dcs_jax.annotate import Editor, Project, save
from dcs_jax.annotate.doubt import doubt
from dcs_jax.annotate.project import ObjectLane
from dcs_jax.config import Config
from dcs_jax.label.clip import Clip
from dcs_jax.label.messages import Message, parse
from dcs_jax.label.threads import all_done, in_thread
from dcs_jax.label.tracking import Tracking

_SAVE_TRACKS = 2.0  # seconds between two saves of what was tracked; an edit is saved at once
_SAVE_AGAIN = 5.0  # seconds after which a save that failed is tried again
_END_WITHIN = 3.0  # seconds for tracking to stop; compiling cannot be stopped
Send = Callable[[Message], None]


class Session:
    """A project, its clip and its watchers.

    path: file of the project. editor: the project. tracking: what is tracked.
    """

    def __init__(
        self, clip: Clip, project: Project, path: Path, config: Config = Config(), seed: int = 0
    ) -> None:
        self.clip, self.path = clip, path
        self.editor = Editor(project)
        self.tracking = Tracking(clip, self.editor, config, seed, self._filled, self._tell_status)
        self._watchers: set[Send] = set()
        self._sent: dict[int, ObjectLane] = {}  # lanes as the watchers have them
        self._version = self._edited = self._saved = 0
        self._problem: str | None = None  # why it could not be saved
        self._unsaved, self._urgent = asyncio.Event(), asyncio.Event()
        self._tasks: list[asyncio.Task[None]] = []

    async def start(self) -> None:
        """Begin to compile, to track what is pending, and to save."""
        self._tasks = [
            asyncio.create_task(self.tracking.run()),
            asyncio.create_task(self._keep_saving()),
        ]

    async def stop(self) -> None:
        """Stop tracking and save what there is."""
        self.tracking.end()
        for task in self._tasks:
            task.cancel()
        if self._saved < self._version:
            await self._save()
        await all_done(_END_WITHIN)
        self.clip.close()

    def join(self, send: Send) -> None:
        """Tell one more watcher everything, and from now on what changes."""
        project = self.editor.project
        width, height = project.size
        send(
            {
                "type": "clip",
                "name": Path(project.clip).name,
                "project": self.path.name,
                "width": width,
                "height": height,
                "length": project.length,
                "fps": project.fps,
                "notes": self.clip.notes,
            }
        )
        send(self._objects(project))
        for lane in project.objects:
            send(_rows(lane, 0, project.length))
        send(self._saving())
        send(self.tracking.status())
        self._watchers.add(send)

    def leave(self, send: Send) -> None:
        """Tell this watcher no more."""
        self._watchers.discard(send)

    def receive(self, text: str, answer: Send) -> None:
        """Do what a watcher asks for; what concerns only it, and what is wrong, is answered."""
        try:
            name, arguments = parse(text)
            self._do(name, arguments, answer)
        except ValueError as error:
            answer({"type": "error", "text": str(error)})

    def _do(self, name: str, given: dict[str, Any], answer: Send) -> None:
        editor = self.editor
        if name == "doubtful":
            found = editor.next_doubtful(given["frame"], given["id"])
            text = "no box is in doubt" + (" so far" if editor.pending() else "")
            answer(
                {"type": "error", "text": text}
                if found is None
                else {"type": "go", "frame": found[0], "id": found[1]}
            )
            return
        if name in ("pause", "resume"):
            self.tracking.pause(name == "pause")
            return
        edits: dict[str, Callable[..., Any]] = {
            "add": editor.add_object,
            "set": editor.set_keyframe,
            "remove": editor.remove_keyframe,
            "rename": editor.rename,
            "delete": editor.delete,
            "undo": editor.undo,
            "redo": editor.redo,
        }
        result = edits[name](**given)
        if name in ("undo", "redo") and not result:
            raise ValueError(f"there is nothing to {name}")
        self._changed(edited=True)
        if name == "add":
            answer({"type": "go", "frame": given["frame"], "id": result})
        self.tracking.look()

    def _filled(self) -> None:
        self._changed(edited=False)

    def _changed(self, edited: bool) -> None:
        self._version += 1
        project = self.editor.project
        if edited:
            self._edited = self._version
        self._tell(
            self._saving()
        )  # first: what the page shows is never called saved when it is not
        if edited:
            self._tell(self._objects(project))
        for lane in project.objects:
            old = self._sent.get(lane.id)
            if old is not lane:
                change = _difference(old, lane)
                if change is not None:
                    self._tell(_rows(lane, *change))
        self._sent = {lane.id: lane for lane in project.objects}
        self._unsaved.set()
        if edited or not self.editor.pending():
            self._urgent.set()

    def _objects(self, project: Project) -> Message:
        return {
            "type": "objects",
            "can_undo": self.editor.can_undo,
            "can_redo": self.editor.can_redo,
            "objects": [
                {
                    "id": lane.id,
                    "name": lane.name,
                    "colour": lane.colour,
                    "keyframes": {
                        str(frame): keyframe.box and list(keyframe.box)
                        for frame, keyframe in sorted(lane.keyframes.items())
                    },
                }
                for lane in project.objects
            ],
        }

    def _saving(self) -> Message:
        """What is saved: all, the edits, or not all of them."""
        saved = "all" if self._saved == self._version else "edits"
        if self._saved < self._edited:
            saved = "no"
        return {"type": "saved", "what": saved, "problem": self._problem}

    async def _keep_saving(self) -> None:
        while True:
            await self._unsaved.wait()
            if not self._urgent.is_set():
                await _wait(self._urgent, _SAVE_TRACKS)
            self._unsaved.clear()
            self._urgent.clear()
            await self._save()
            if self._problem is not None:
                await _wait(self._urgent, _SAVE_AGAIN)
                self._unsaved.set()

    async def _save(self) -> None:
        version, project = self._version, self.editor.project
        try:
            await in_thread(partial(save, self.path, project))
        except OSError as error:
            self._problem = (
                f"not saved: {self.path.name} cannot be written ({error.strerror or error}); "
                "what was saved before is still there"
            )
        else:
            self._saved, self._problem = version, None
        self._tell(self._saving())

    def _tell_status(self) -> None:
        self._tell(self.tracking.status())

    def _tell(self, message: Message) -> None:
        for send in tuple(self._watchers):
            send(message)


async def _wait(event: asyncio.Event, seconds: float) -> None:
    with contextlib.suppress(TimeoutError):
        await asyncio.wait_for(event.wait(), seconds)


def _rows(lane: ObjectLane, start: int, end: int) -> Message:
    """The frames `start` to `end` of a lane: little-endian numbers in base 64."""
    rows = slice(start, end)
    return {
        "type": "rows",
        "id": lane.id,
        "start": start,
        "end": end,
        "boxes": _text(lane.boxes[rows], "<f4"),
        "confidence": _text(lane.confidence[rows], "<f4"),
        "doubt": _text(doubt(lane)[rows], "<f4"),
        "lost": _text(lane.lost[rows], "u1"),
    }


def _text(values: NDArray[Any], dtype: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype).tobytes()).decode()


def _difference(old: ObjectLane | None, new: ObjectLane) -> tuple[int, int] | None:
    """The frames from the first to behind the last that differ; None where none does."""
    if old is None:
        return 0, len(new.boxes)
    same = np.ones(len(new.boxes), np.bool_)
    for name in ("boxes", "confidence", "disagreement", "lost"):
        before, after = getattr(old, name), getattr(new, name)
        equal = (before == after) | ((before != before) & (after != after))
        same &= equal.reshape(len(same), -1).all(axis=1)
    changed = np.flatnonzero(~same)
    return (int(changed[0]), int(changed[-1]) + 1) if changed.size else None
