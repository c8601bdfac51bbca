"""Edits of a project, each of which can be undone, and what is to be tracked after them."""

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dcs_jax.annotate.doubt import doubtful
from dcs_jax.annotate.project import Box, Keyframe, ObjectLane, Project, colour_of
from dcs_jax.annotate.stretches import Stretch, StretchTrack, assemble, stretches_of
from dcs_jax.checks import check_box, check_count, shown

_FIELDS = StretchTrack._fields


class _Object(NamedTuple):
    """What a person decides of an object; the rest of its lane follows from it.

    keyframes: never changed in place.
    """

    id: int
    name: str
    colour: str
    keyframes: dict[int, Keyframe]


class Editor:
    """A project and its history.

    What a person says are the keyframes; all else of a lane is made from them by tracking. After an
    edit, an undo or a redo, `pending` has the stretches to track, and `fill` takes their tracks.
    What was tracked once between the same two keyframes is kept, and never pending again.
    """

    def __init__(self, project: Project) -> None:
        """project: as it was stored; the stretches of which all boxes are known are not tracked."""
        self._clip = replace(project, objects=())
        self._known: dict[Stretch, StretchTrack] = {}  # whole or in part
        self._whole: set[Stretch] = set()
        self._lanes: dict[int, tuple[_Object, ObjectLane]] = {}  # made from these objects
        objects = []
        for lane in project.objects:
            one = _Object(lane.id, lane.name, lane.colour, dict(lane.keyframes))
            objects.append(one)
            for stretch in stretches_of(one.id, one.keyframes, project.length):
                self._keep(stretch, lane)
        self._states: list[tuple[_Object, ...]] = [tuple(objects)]
        self._now = 0

    @property
    def project(self) -> Project:
        """The project as it is now. It is not changed by later edits."""
        return replace(self._clip, objects=tuple(map(self._lane, self._objects)))

    def add_object(self, frame: int, box: Iterable[float], name: str | None = None) -> int:
        """A new object with its first keyframe: its id.

        name: by default "object" and the id.

        Raises ValueError where the frame is none of the clip, the box less than 4 pixels wide or
        high or outside the frame, or the name one that another object has.
        """
        frame = self._check_frame(frame)
        keyframe = Keyframe(self._check_box(box))
        every = [one.id for state in self._states for one in state]
        id = max(every, default=0) + 1
        name = f"object {id}" if name is None else name
        self._check_name(name, id)
        self._do((*self._objects, _Object(id, name, colour_of(id), {frame: keyframe})))
        return id

    def set_keyframe(self, id: int, frame: int, box: Iterable[float] | None) -> None:
        """Say where an object is in a frame; None: not there, up to the next keyframe.

        Raises ValueError where there is no such object or frame, the box is less than 4 pixels wide
        or high or outside the frame, or the object would have no box at all.
        """
        one = self._object(id)
        frame = self._check_frame(frame)
        keyframe = Keyframe(None if box is None else self._check_box(box))
        if one.keyframes.get(frame) != keyframe:
            self._change(one._replace(keyframes=one.keyframes | {frame: keyframe}))

    def remove_keyframe(self, id: int, frame: int) -> None:
        """Take back what was said of a frame.

        Raises ValueError where there is no such object or keyframe, or it is the only box.
        """
        one = self._object(id)
        if frame not in one.keyframes:
            known = ", ".join(map(str, sorted(one.keyframes)))
            raise ValueError(
                f"{one.name} has no keyframe in frame {shown(frame)}: it has those of {known}"
            )
        rest = {at: keyframe for at, keyframe in one.keyframes.items() if at != frame}
        self._change(one._replace(keyframes=rest))

    def rename(self, id: int, name: str) -> None:
        """Give an object another name; ValueError where it is empty, or that of another."""
        one = self._object(id)
        self._check_name(name, id)
        if name != one.name:
            self._change(one._replace(name=name))

    def delete(self, id: int) -> None:
        """Take an object away; ValueError where there is none of this id."""
        self._object(id)
        self._do(tuple(other for other in self._objects if other.id != id))

    @property
    def can_undo(self) -> bool:
        """Whether there is an edit to go back before."""
        return self._now > 0

    @property
    def can_redo(self) -> bool:
        """Whether an edit was undone, and none followed."""
        return self._now + 1 < len(self._states)

    def undo(self) -> bool:
        """Go back before the last edit; false where there is none."""
        self._now -= (possible := self.can_undo)
        return possible

    def redo(self) -> bool:
        """Do again what was undone last; false where nothing was, or an edit followed."""
        self._now += (possible := self.can_redo)
        return possible

    def fill(self, stretch: Stretch, track: StretchTrack, complete: bool = True) -> bool:
        """Take the track of a stretch: whether the project shows it.

        complete: false for one that is still being made, with NaN in the frames to come.

        The track of a stretch that is none any more, as a keyframe was edited meanwhile, is kept
        for an undo. Raises ValueError where it has another number of frames than the stretch.
        """
        for name, values in zip(_FIELDS, track, strict=True):
            expected = (stretch.length, 4) if name == "boxes" else (stretch.length,)
            if np.shape(values) != expected:
                raise ValueError(
                    f"{name} must have the shape {expected}, as the stretch has {stretch.length} "
                    f"frames, but has {np.shape(values)}"
                )
        if stretch not in self._whole:
            self._known[stretch] = track.copy()
            if complete:
                self._whole.add(stretch)
            self._lanes.pop(stretch.object, None)
        return stretch in self._stretches()

    def pending(self) -> list[Stretch]:
        """The stretches whose track is not complete, by object and frame."""
        return [stretch for stretch in self._stretches() if stretch not in self._whole]

    def next_doubtful(self, frame: int, id: int | None = None) -> tuple[int, int] | None:
        """Where to look next: a frame and the id of the object whose box there is in doubt.

        It is the next after `frame`, or from the start of the clip on where there is none after it.
        None where no box is in doubt.

        id: look at this object only.

        Raises ValueError where there is no such object or frame.
        """
        frame = self._check_frame(frame)
        lanes = [self._lane(one) for one in (self._objects if id is None else [self._object(id)])]
        found = [(at, lane.id) for lane in lanes for at in doubtful(lane)]
        return min(found, key=lambda place: (place[0] <= frame, place), default=None)

    @property
    def _objects(self) -> tuple[_Object, ...]:
        return self._states[self._now]

    def _object(self, id: int) -> _Object:
        for one in self._objects:
            if one.id == id:
                return one
        known = ", ".join(str(one.id) for one in self._objects)
        raise ValueError(f"there is no object {shown(id)}: expected one of {known or 'none'}")

    def _lane(self, one: _Object) -> ObjectLane:
        made_from, lane = self._lanes.get(one.id, (None, None))
        if lane is None or made_from is not one:
            track = assemble(one.keyframes, self._known, one.id, self._clip.length)
            lane = ObjectLane(
                **{**one._asdict(), "keyframes": dict(one.keyframes)}, **track._asdict()
            )
            self._lanes[one.id] = one, lane
        return lane

    def _stretches(self) -> list[Stretch]:
        length = self._clip.length
        return [s for one in self._objects for s in stretches_of(one.id, one.keyframes, length)]

    def _change(self, changed: _Object) -> None:
        if all(keyframe.box is None for keyframe in changed.keyframes.values()):
            raise ValueError(f"{changed.name} would have no box at all: delete it instead")
        self._do(tuple(changed if one.id == changed.id else one for one in self._objects))

    def _do(self, objects: tuple[_Object, ...]) -> None:
        self._states[self._now + 1 :] = [objects]
        self._now += 1

    def _keep(self, stretch: Stretch, lane: ObjectLane) -> None:
        """Keep what a stored lane says of a stretch."""
        rows = slice(stretch.first, stretch.last + 1)
        whole = StretchTrack(lane.boxes, lane.confidence, lane.lost, lane.disagreement)
        track = whole.rows(rows).copy()
        known = ~np.isnan(track.boxes[:, 0])
        self._known[stretch] = track
        if known.all():
            self._whole.add(stretch)

    def _check_frame(self, frame: int) -> int:
        return check_count("frame", frame, least=0, most=self._clip.length - 1)

    def _check_box(self, box: Iterable[float]) -> Box:
        box = tuple(box)
        width, height = self._clip.size
        check_box(box, (height, width))
        x, y, w, h = np.asarray(box, np.float32).tolist()  # as the lane has it
        return x, y, w, h

    def _check_name(self, name: str, id: int) -> None:
        if not isinstance(name, str) or not name.strip() or not name.isprintable():
            raise ValueError(f"name must be text without control characters, but is {shown(name)}")
        if any(one.name == name and one.id != id for one in self._objects):
            raise ValueError(f"there is another object named {shown(name)}: names must differ")
