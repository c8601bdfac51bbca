"""What `dcs-jax track` writes: a table that grows, a file of another format, a video."""

import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from dcs_jax import formats
from dcs_jax.io.annotations import BoxWriter
from dcs_jax.io.files import check_new_folder, lock
from dcs_jax.io.frames import FrameSource
from dcs_jax.io.live import StreamSource
from dcs_jax.io.overlay import VideoWriter, draw_tracks
from dcs_jax.runners.stream import Chunk

TABLE = "csv"


class Outputs:
    """The files of one run. A context manager: they are complete when it ends, however it ends.

    path: of the results. count: number of frames written so far.
    boxes: of each frame so far, [S, n, 4].
    """

    def __init__(
        self,
        frames: FrameSource,
        names: list[str | None],
        out: Path,
        format: str,
        overlay: Path | None,
        truth: NDArray[np.float64] | None,
    ) -> None:
        """Open the files; ValueError or OSError where one cannot be written.

        names: of the objects; [None] for a single one without a name.
        """
        self.path = out
        self._frames, self._truth = frames, truth
        self._names = [str(name or "object") for name in names]
        self._format = format
        self._parts: list[tuple[NDArray[Any], ...]] = []
        self._indices: list[int] = []  # of the frames in the parts
        self.count = 0
        self._files = ExitStack()
        with ExitStack() as files:
            self._video = overlay and files.enter_context(
                VideoWriter(overlay, frames.shape, frames.fps)
            )
            self._table: BoxWriter | None = None
            if format == TABLE:
                unnamed = names == [None]
                self._table = BoxWriter(out, None if unnamed else self._names)
                files.enter_context(self._table)
            else:
                self._check_format()
                if not formats.FORMATS[format].folder:
                    files.callback(lambda: out.unlink() if _is_empty(out) else None)
                    lock(files.enter_context(out.open("ab")))
            self._files = files.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        with self._files:
            if self._table is None and self._parts:
                formats.write(self.path, self._tracks(), self._format)

    @property
    def boxes(self) -> NDArray[np.float32]:
        return np.concatenate([boxes for boxes, *_ in self._parts], 1)

    def write(self, chunk: Chunk) -> None:
        """Write the rows and the pictures of the next frames."""
        track = chunk.track
        count = len(chunk.frames)
        if isinstance(self._frames, StreamSource):
            # A camera drops frames: they are numbered as they came.
            indices = [self._frames.positions.popleft() for _ in range(count)]
        else:
            first = self._frames.start + self.count
            indices = list(range(first, first + count))
        self.count += count
        rows = (track.boxes, track.confidence, track.lost)
        if self._table is not None:
            self._table.write(*rows, indices)
        # Of a stream without end only what has to be kept is kept.
        if self._table is None or self._truth is not None:
            self._indices += indices
            self._parts.append(tuple(map(np.asarray, rows)))
        if self._video:
            shown = self._names if len(self._names) > 1 else [""]
            for n, frame in enumerate(chunk.frames):
                truth = None if self._truth is None else self._truth[indices[n]]
                boxes, confidence, lost = (np.asarray(row)[:, n] for row in rows)
                drawn = draw_tracks(frame, shown, boxes, confidence, lost, truth)
                self._video.write(drawn)

    def _tracks(self) -> formats.Tracks:
        first = self._indices[0]
        # Frames that a camera dropped have no box.
        length = self._indices[-1] + 1 - first
        places = np.array(self._indices) - first
        boxes, confidence, lost = (
            _spread(np.concatenate(rows, 1), places, length)
            for rows in zip(*self._parts, strict=True)
        )
        objects = []
        for slot, name in enumerate(self._names):
            known = np.flatnonzero(~np.isnan(boxes[slot, :, 0]))
            if not known.size:
                continue
            span = slice(int(known[0]), int(known[-1]) + 1)
            rows = (boxes[slot, span], confidence[slot, span], lost[slot, span].astype(bool))
            keyframes = np.arange(len(rows[0])) == 0
            objects.append(formats.ObjectTrack(name, first + span.start, *rows, keyframes))
        height, width, _ = self._frames.shape
        total = getattr(self._frames, "total", None)
        return formats.Tracks(
            tuple(objects), (width, height), total, self._frames.name, self._frames.fps
        )

    def _check_format(self) -> None:
        """ValueError now, not when all is tracked, where such tracks cannot be written.

        They are written once with a box each, where it is thrown away.
        """
        one: Any = (np.full((1, 4), 8.0), np.ones(1), np.zeros(1, bool))
        objects = [formats.ObjectTrack(name, 0, *one) for name in self._names]
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / self.path.name
            if self.path.is_file():
                path.touch()
            try:
                formats.write(path, formats.Tracks(tuple(objects), (16, 16)), self._format)
            except ValueError as error:
                raise ValueError(str(error).replace(str(path), str(self.path))) from None
            if path.is_dir():
                check_new_folder(self.path)


def _spread(rows: NDArray[Any], places: NDArray[np.int_], length: int) -> NDArray[Any]:
    """Rows [S, n, ...] at their places of [S, length, ...]; NaN, or False, elsewhere."""
    empty = np.nan if rows.dtype.kind == "f" else False
    spread = np.full((len(rows), length, *rows.shape[2:]), empty, rows.dtype)
    spread[:, places] = rows
    return spread


def _is_empty(path: Path) -> bool:
    return path.is_file() and not path.stat().st_size
