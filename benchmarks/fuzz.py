"""Calls of the public functions with legal and illegal arguments, and what came of them.

    python -m benchmarks.fuzz [--calls 10000] [--seed 0]

Prints a Markdown table. A call is either refused, with a ValueError whose sentence names an
argument that is not as documented, or answered with values in their documented ranges. The last
column counts all else, which is printed below; the exit status is 1 unless it is 0 everywhere.

The shapes and the static fields are few, so that few programs are compiled.
"""

import argparse
import dataclasses
import functools
import math
import random
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import dcs_jax
from dcs_jax.checks import check_videos
from dcs_jax.config import COMPONENTS, Config, Redetection, ScaleFilter

# Each with frames of its own, which halves the number of programs.
_SMALL = Config(
    canvas=8,
    window_factor=1.5,
    parts=5,
    selectors=2,
    pool_size=4,
    iterations=2,
    first_updates=2,
    scale=ScaleFilter(num_scales=3),
    redetection=Redetection(windows=1),
)
_WITHOUT: dict[str, Any] = dict.fromkeys(COMPONENTS)
FAMILIES: tuple[tuple[tuple[int, ...], Config], ...] = (
    ((24, 32, 3), _SMALL),
    ((24, 32), dataclasses.replace(_SMALL, **_WITHOUT)),
)
# What an argument may be by mistake. Some are legal in some places.
ODD: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 3, 5.0, 2.5, -0.0, 1e300, 10**400, 10**5000, 2**32 + 1, 1j),
    *(math.nan, math.inf, -math.inf, "", "x", "4", b"1", object(), [], (), {}, {1}, [1, [2]]),
    *((1, 2), range(4), np.float64(0.5), np.int64(5), np.uint8(1), np.bool_(True), np.str_("l1")),
    *(np.float32(np.nan), np.array([]), np.array([5]), np.array(0.5), np.ones(3), np.array(True)),
    *(np.full(2, np.nan), np.full((2, 2), 1j), np.array([None, 1]), np.zeros((0, 4))),
    *(np.array("2000", "datetime64[D]"), jnp.float32, jnp.float32(0.5), jnp.bfloat16(1)),
    *(jnp.zeros(4), jnp.array(True), jnp.int32(2), jax.random.PRNGKey(0), jax.random.key(1)),
    *(jax.random.split(jax.random.key(0), 2), np.zeros((24, 32)), np.zeros((0, 24, 32), np.uint8)),
    *(np.zeros((24, 32, 4), np.uint8), (1, 2, 30, math.nan), (1, 2, 3, 30), (0, 0, 4e19, 5)),
    *((9e9, 0, 9, 9), ("1", "2", "30", "40"), (5, 5, 10**400, 9), (99, 0, 9, 9)),
    *([(1, 2, 9, 9), (1, 2, 9)], [(1, 2, 9, 9), None]),
)
# For what is compiled for every number: none that is a legal one.
_NO_COUNTS = (
    *(odd for odd in ODD if odd is not None and not isinstance(odd, (int, np.integer))),
    *(0, -1, 10**8, True),
)
# Arguments that a sentence calls by another name, too.
_ALSO = {
    "frames": ("frame",),
    "boxes": ("box",),
    "keys": ("key",),
    # Their number of rows and columns is what the others are held to.
    "votes": ("labels", "weights", "start", "errors"),
}


class Refused(NamedTuple):
    """A call that raised ValueError: its text, and the arguments that may be to blame."""

    text: str
    odd: tuple[str, ...]


class Drawing:
    """Random arguments of one call; `odd`: the names of those that may be illegal."""

    def __init__(self, generator: random.Random) -> None:
        self.random = generator
        self.shape, self.config = generator.choice(FAMILIES)
        self.odd: list[str] = []
        # Where every argument may be odd, the first one that is hides the others.
        self._chance = generator.choice((0.0, 0.15, 0.5))

    def maybe(self, name: str, legal: Callable[[], Any], odd: tuple[Any, ...] = ODD) -> Any:
        """A legal value, or any."""
        if self.random.random() >= self._chance:
            return legal()
        self.odd.append(name)
        return self.random.choice(odd)

    def size(self, low: float, high: float) -> float:
        """A number between the two, on a scale of magnitudes."""
        return math.exp(self.random.uniform(math.log(low), math.log(high)))

    def frame(self) -> np.ndarray:
        """A frame: noise, or one in which there is little or nothing to see."""
        pixels = np.random.default_rng(self.random.getrandbits(32))
        kind = self.random.randrange(5)
        if kind == 0:
            return pixels.integers(0, 256, self.shape, np.uint8)
        if kind == 1:
            return np.full(self.shape, self.random.choice((0, 255, 90)), np.uint8)
        if kind == 2:
            return pixels.integers(0, 2, self.shape, np.uint8) * np.uint8(255)
        row, column = np.indices(self.shape)[:2]
        return ((8 * column if kind == 3 else 5 * (row + column)) % 256).astype(np.uint8)

    def frames(self, count: int) -> np.ndarray:
        """Frames of one kind each."""
        return np.stack([self.frame() for _ in range(count)])

    def box(self) -> Any:
        """A legal box: of any size, in the frame or partly."""
        largest = self.random.choice((30.0, 300.0, 1e6))
        w, h = (max(4.0, self.size(4, largest)) for _ in range(2))
        height, width = self.shape[:2]
        x = self.random.uniform(-w + 0.01 * w, width - 0.1)
        y = self.random.uniform(-h + 0.01 * h, height - 0.1)
        if self.random.random() < 0.2:
            return [round(x) if x + 1 < width and round(x) + w > 0 else x, y, w, h]
        kinds: tuple[Callable[[Any], Any], ...] = (tuple, np.array, jnp.float32)
        return self.random.choice(kinds)([x, y, w, h])

    def key(self) -> jax.Array:
        """A random key."""
        return jax.random.key(self.random.randrange(5))

    def number(self, field: Any) -> float:
        """A legal number of a field of the settings."""
        if field.name in ("patience", "learn_every"):
            return self.random.choice((1, 2, 5, 2**31 - 1))
        if field.name == "block":
            return self.random.choice((1e-6, 0.2, 1.0))
        if field.name == "learned_factor":
            return self.random.choice((0.5, self.size(0.5, 1e9), 1e9))
        if field.name in ("lam", "smoothing", "overhang", "prior", "weight", "slope") or (
            field.name == "template_penalty"
        ):
            return self.random.choice((0.0, self.size(1e-12, 1e9), 1e9, 0.5))
        return self.random.choice((0.0, 1.0, self.random.random()))

    def settings(self, config: Any = None) -> Any:
        """The family's settings, with other numbers."""
        config = self.config if config is None else config
        changes: dict[str, Any] = {}
        for field in dataclasses.fields(config):
            if field.metadata.get("static") or self.random.random() < 0.7:
                continue
            if field.name in COMPONENTS:
                part = getattr(config, field.name)
                changes[field.name] = None if part is None else self.settings(part)
            else:
                changes[field.name] = self.maybe(field.name, functools.partial(self.number, field))
        return dataclasses.replace(config, **changes)


def check_boxes(boxes: Any, shape: tuple[int, ...]) -> None:
    """AssertionError unless boxes [..., 4] are finite and have their centres in the frame."""
    boxes = np.asarray(boxes, np.float64)
    assert np.isfinite(boxes).all(), f"boxes {boxes}"
    assert (boxes[..., 2:] > 0).all(), f"boxes {boxes}"
    centres = boxes[..., :2] + boxes[..., 2:] / 2
    # What float32 makes of a corner and half a side.
    near = 1e-3 + 3e-7 * np.abs(boxes).max(-1, keepdims=True)
    limits = np.array([shape[1], shape[0]])
    assert ((centres >= -near) & (centres <= limits + near)).all(), f"centres {centres}"


def check_scores(record: Any, config: Config) -> None:
    """AssertionError unless the scores of a record or a track are in their ranges."""
    for name in ("noisy_or", "part_scores"):
        scores = np.asarray(getattr(record, name))
        assert ((scores >= 0) & (scores <= 1)).all(), f"{name} {scores}"
    confidence = np.asarray(record.confidence)
    if config.verification is None:
        assert np.isnan(confidence).all(), f"confidence {confidence}"
    else:
        assert ((confidence >= 0) & (confidence <= 1)).all(), f"confidence {confidence}"
    assert np.isfinite(np.asarray(record.noise)).all(), f"noise {record.noise}"


def check_state(state: Any) -> None:
    """AssertionError unless all numbers of a state are finite."""
    for path, leaf in jax.tree_util.tree_leaves_with_path(state):
        assert np.isfinite(np.asarray(leaf)).all(), f"state{jax.tree_util.keystr(path)}"


def call_step(draw: Drawing) -> None:
    """`init`, `score`, `step` and `track_chunk`."""
    config = draw.maybe("config", draw.settings)
    arguments = (draw.maybe("frame", draw.frame), draw.maybe("box", draw.box))
    state = dcs_jax.init(*arguments, draw.maybe("key", draw.key), config)
    check_state(state)
    check_scores(dcs_jax.score(state, draw.maybe("frame", draw.frame), config), config)
    state, info = dcs_jax.step(
        draw.maybe("state", lambda: state), draw.maybe("frame", draw.frame), config
    )
    check_state(state)
    check_scores(info, config)
    check_boxes(info.box, draw.shape)
    state, infos = dcs_jax.track_chunk(
        state, draw.maybe("frames", lambda: draw.frames(2)), draw.maybe("config", lambda: config)
    )
    check_state(state)
    check_scores(infos, config)
    check_boxes(infos.box, draw.shape)


def call_sequence(draw: Drawing) -> None:
    """`track_sequence`."""
    config = draw.maybe("config", draw.settings)
    frames = draw.maybe("frames", lambda: draw.frames(draw.random.randint(1, 4)))
    box, key = draw.maybe("box", draw.box), draw.maybe("key", draw.key)
    track = dcs_jax.track_sequence(frames, box, key, config)
    check_boxes(track.boxes[1:], frames.shape[1:])
    check_scores(track, config)
    np.testing.assert_allclose(track.boxes[0], np.float32(box))


def call_batch(draw: Drawing) -> None:
    """`track_batch` of one video with one key, or of two with a key each."""
    config = draw.maybe("config", draw.settings)
    count = draw.random.randint(1, 4)
    boxes = draw.maybe("boxes", lambda: [list(draw.box()) for _ in range(2)])
    if draw.random.random() < 0.5:
        frames = draw.maybe("frames", lambda: draw.frames(count))
        keys = draw.maybe("keys", draw.key)
    else:
        frames = draw.maybe("frames", lambda: np.stack([draw.frames(count) for _ in range(2)]))
        keys = draw.maybe("keys", lambda: jax.random.split(draw.key(), 2))
    track = dcs_jax.track_batch(frames, boxes, keys, config)
    check_boxes(track.boxes[:, 1:], frames.shape[2:] if check_videos(frames) else frames.shape[1:])
    check_scores(track, config)


def call_stream(draw: Drawing) -> None:
    """`track_stream`, and tracks that are added and dropped on the way, some by mistake."""
    config = draw.maybe("config", draw.settings)
    frames = draw.maybe("frames", lambda: draw.frames(draw.random.randint(1, 70)))
    boxes = draw.maybe("boxes", lambda: [list(draw.box())])
    slots = draw.maybe("slots", lambda: 2, _NO_COUNTS)
    chunk = draw.maybe("chunk", lambda: None, _NO_COUNTS)
    keys = draw.maybe("keys", draw.key)
    stream = dcs_jax.track_stream(frames, boxes, keys, config, slots=slots, chunk=chunk)
    for part in stream:
        active = jax.tree.map(lambda rows, part=part: rows[part.active], part.track)
        if part.start:
            check_boxes(active.boxes, part.frames.shape[1:])
        check_scores(active, config)
        if draw.random.random() < 0.5 and stream.active.any() and not stream.active.all():
            stream.add(draw.maybe("box", draw.box), draw.maybe("key", lambda: None))
        if draw.random.random() < 0.3 and stream.active.all():
            stream.drop(draw.maybe("slot", lambda: 0))
    if draw.random.random() < 0.5:
        draw.odd.append("stream")
        stream.add(draw.box())


def call_selection(draw: Drawing) -> None:
    """`select_classifiers`."""
    numbers = np.random.default_rng(draw.random.getrandbits(32))
    leading = draw.random.choice(((), (2,)))
    size = draw.size(1e-6, 1e6)

    def votes() -> Any:
        if draw.random.random() < 0.5:
            return numbers.choice([-1.0, 1.0], (*leading, 5, 3))
        return numbers.normal(size=(*leading, 5, 3)) * size

    def penalty() -> float:
        return draw.random.choice((0.0, 0.01, draw.size(1e-9, 1e6)))

    arguments: dict[str, Any] = {
        "votes": draw.maybe("votes", votes),
        "labels": draw.maybe("labels", lambda: numbers.choice([-1.0, 0.0, 1.0], 5) * size),
        "lam": draw.maybe("lam", penalty),
        "lam_noise": draw.maybe("lam_noise", penalty),
        "weights": draw.maybe("weights", lambda: numbers.integers(0, 4, 5)),
    }
    match draw.random.randrange(4):
        case 0:
            arguments["tol"] = draw.maybe("tol", lambda: draw.random.choice((0, 1e-3, 1.0)))
        case 1:
            arguments |= {"solver": draw.maybe("solver", lambda: "apg"), "max_iterations": 20}
            arguments["start"] = draw.maybe("start", lambda: numbers.uniform(size=3))
        case 2:
            arguments["tie"] = draw.maybe("tie", lambda: "error")
            arguments["errors"] = draw.maybe("errors", lambda: numbers.uniform(size=3))
        case 3:
            arguments["tie"] = draw.maybe("tie", lambda: "random")
            arguments["key"] = draw.maybe("key", draw.key)
    found = dcs_jax.select_classifiers(**arguments)
    assert ((found.index >= 0) & (found.index < 3)).all(), f"index {found.index}"
    for name in ("beta", "objective", "gap"):
        values = np.asarray(getattr(found, name))
        assert (np.isfinite(values) & (values >= 0)).all(), f"{name} {values} of {arguments}"
    assert np.isfinite(np.asarray(found.noise)).all(), f"noise {found.noise}"


def call_config(draw: Drawing) -> None:
    """`Config`, its groups, and the cells that it gives; nothing is compiled."""
    kind = draw.random.choice((Config, *COMPONENTS.values()))
    fields = draw.random.sample(dataclasses.fields(kind), 2)
    changes = {
        field.name: draw.maybe(field.name, functools.partial(getattr, field, "default"))
        for field in fields
    }
    settings = kind(**changes)
    hash(jax.tree.structure(settings))
    for name, value in changes.items():
        kept = getattr(settings, name)
        assert kept is value or type(kept) in (bool, int, float, str, tuple), f"{name} {kept!r}"
    if isinstance(settings, Config):
        box = draw.maybe("box", lambda: (1, 2, draw.size(4, 1e6), draw.size(4, 1e6)))
        draw.odd += ["canvas", "window_factor", "window_minimum"]  # the box may be too large
        grid = settings.resolve(box).grid
        assert max(grid.window) <= 4100, f"grid {grid}"


CALLS: dict[str, Callable[[Drawing], None]] = {
    "init, score, step, track_chunk": call_step,
    "track_sequence": call_sequence,
    "track_batch": call_batch,
    "track_stream": call_stream,
    "select_classifiers": call_selection,
    "Config and its groups": call_config,
}


def try_call(name: str, seed: int) -> Refused | None:
    """Make a call with random arguments: how it was refused, or None where it was answered.

    Raises AssertionError where the answer, or the sentence, is not as documented; anything else
    that the call raises is passed on.
    """
    draw = Drawing(random.Random(seed))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            CALLS[name](draw)
    except ValueError as error:
        text = str(error)
        names = [also for odd in draw.odd for also in (odd, *_ALSO.get(odd, ()))]
        assert any(odd in text for odd in names), f"of {draw.odd}: {text}"
        assert len(text.split()) > 3, text
        return Refused(text, tuple(draw.odd))
    return None


def main() -> None:
    """Make the calls and print what came of them."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--calls", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    outcomes = {name: Counter[str]() for name in CALLS}
    failures = []
    start = time.perf_counter()
    for number in range(arguments.calls):
        name = list(CALLS)[number % len(CALLS)]
        seed = arguments.seed + number
        try:
            outcomes[name]["answered" if try_call(name, seed) is None else "refused"] += 1
        except Exception as error:
            outcomes[name]["else"] += 1
            failures.append(f"{name}, seed {seed}: {type(error).__name__}: {error}")
    print("| Function | Calls | Refused, naming the argument | Answered in range | Anything else |")
    print("| --- | ---: | ---: | ---: | ---: |")
    total = sum(outcomes.values(), Counter[str]())
    for name, counts in (*outcomes.items(), ("all", total)):
        cells = (counts[outcome] for outcome in ("refused", "answered", "else"))
        print(f"| {name} | {counts.total()} | {' | '.join(map(str, cells))} |")
    print(f"\n{time.perf_counter() - start:.0f} s")
    print(*failures, sep="\n")
    sys.exit(bool(failures))


if __name__ == "__main__":
    main()
