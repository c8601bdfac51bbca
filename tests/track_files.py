"""Tracks drawn at random, and what each format gives back of them."""

import numpy as np
from hypothesis import strategies as st

from dcs_jax.formats import ObjectTrack, Tracks

SIZE = (640, 360)

# Two decimals, as tools write them; and any digits that float32 has.
positions = st.one_of(
    st.integers(-5000, 70000).map(lambda n: n / 100),
    st.floats(-100, 700, width=32).filter(lambda x: x == 0 or abs(x) > 1e-3),
)
sides = st.one_of(st.integers(1, 50000).map(lambda n: n / 100), st.floats(0.0625, 500, width=32))
names = st.text(
    st.characters(exclude_categories=("Cs", "Cc", "Cn", "Co")), min_size=1, max_size=12
).filter(lambda text: text.casefold() == text)  # two names are never one file
confidences = st.one_of(st.just(np.nan), st.floats(0, 1, width=32))


@st.composite
def object_tracks(draw, name):
    n = draw(st.integers(1, 8))
    boxes = np.array(
        [[draw(positions), draw(positions), draw(sides), draw(sides)] for _ in range(n)]
    )
    boxes[draw(st.lists(st.booleans(), min_size=n, max_size=n))] = np.nan
    flags = st.lists(st.booleans(), min_size=n, max_size=n).map(np.array)
    return ObjectTrack(
        name,
        draw(st.integers(0, 5)),
        boxes.astype(np.float32),
        np.array([draw(confidences) for _ in range(n)], np.float32),
        draw(flags),
        draw(st.one_of(st.none(), flags)),
        draw(st.one_of(st.none(), st.sampled_from(["car", "a & b"]))),
    )


@st.composite
def clips(draw):
    count = draw(st.integers(1, 4))
    numbered = st.lists(st.integers(1, 10**6).map(str), min_size=count, max_size=count, unique=True)
    any_names = st.lists(names, min_size=count, max_size=count, unique=True)
    objects = tuple(draw(object_tracks(name)) for name in draw(st.one_of(any_names, numbered)))
    end = max(track.end for track in objects)
    return Tracks(
        objects,
        SIZE,
        end + draw(st.integers(0, 3)),
        draw(st.one_of(st.none(), names)),
        draw(st.one_of(st.none(), st.sampled_from([25.0, 29.97]))),
    )


def some_tracks(**fields):
    """Two objects with a gap, a lost frame and numbers of few digits."""
    first = object_track(
        "cat, \"the\" <1> & 'é'", 2, [[10.5, 20, 30, 40], None, [12.25, 21, 30, 41]]
    )
    second = object_track("7", 0, [[1, 2, 3, 4]] * 4)
    second = second._replace(
        lost=np.array([False, False, True, False]),
        confidence=np.array([0.5, 0.1, np.nan, 1], np.float32),
    )
    return Tracks((first, second), **{"size": SIZE, "length": 9, "source": "clip.mp4"} | fields)


def object_track(name, start, boxes, **fields):
    boxes = np.array([[np.nan] * 4 if box is None else box for box in boxes], np.float32)
    n = len(boxes)
    nothing = np.full(n, np.nan, np.float32)
    return ObjectTrack(name, start, boxes.reshape(n, 4), nothing, np.zeros(n, bool), **fields)


def one_object():
    """The second object alone, named as the file is where a format takes the name from it."""
    return some_tracks()._replace(objects=(some_tracks().objects[1]._replace(name="tracks"),))


def cvat(boxes, meta="", label="cat"):
    return (
        f"<annotations><version>1.1</version><meta>{meta}</meta>"
        f'<track id="0" label="{label}">{boxes}</track></annotations>'
    )


def cvat_box(frame, left, outside=0, keyframe=1, right=None):
    right = left + 10 if right is None else right
    return (
        f'<box frame="{frame}" outside="{outside}" occluded="0" keyframe="{keyframe}" '
        f'xtl="{left}" ytl="0" xbr="{right}" ybr="20"></box>'
    )


# What comes back, as the table in dcs_jax/formats/__init__.py says.


def expected(format, tracks):
    """The tracks that this format gives back, by name where it holds one."""
    keep = HELD[format]
    objects = [_shown(track) if "hidden frames" not in keep else track for track in tracks.objects]
    if "empty objects" not in keep:
        objects = [track for track in objects if len(track.boxes)]
    objects = [
        track._replace(
            confidence=track.confidence
            if "confidence" in keep
            else np.full_like(track.confidence, np.nan),
            lost=_lost(track, keep),
            keyframes=track.keyframes if "keyframes" in keep else None,
        )
        for track in objects
    ]
    facts = {name: getattr(tracks, name) for name in ("size", "length", "source", "fps")}
    return Tracks(tuple(objects), **{name: facts[name] if name in keep else None for name in facts})


HELD = {
    "csv": {"hidden frames", "empty objects", "lost", "confidence", "keyframes"},
    "otb": {"empty objects", "length"},
    "mot": {"confidence"},
    "cvat": {"gaps are lost", "keyframes", "size", "length", "source"},
    "coco": {"confidence", "size", "length", "source", "fps"},
    "yolo": {"confidence", "size", "length", "source", "fps"},
}


def _shown(track):
    """Without the frames before the first and behind the last box; no boxes in lost frames."""
    shown = np.flatnonzero(track.visible)
    if not shown.size:
        return object_track(track.name, 0, [], label=track.label)
    kept = slice(shown[0], shown[-1] + 1)
    boxes, hidden = track.boxes[kept].copy(), ~track.visible[kept]
    boxes[hidden] = np.nan
    confidence = np.where(hidden, np.nan, track.confidence[kept]).astype(np.float32)
    keyframes = None if track.keyframes is None else track.keyframes[kept]
    return ObjectTrack(
        track.name, track.start + int(shown[0]), boxes, confidence, hidden, keyframes, track.label
    )


def _lost(track, keep):
    if "lost" in keep:
        return track.lost
    return ~track.visible if "gaps are lost" in keep else np.zeros_like(track.lost)


def assert_same_track(found, track, atol=0.0):
    assert found.start == track.start
    assert found.boxes.dtype == found.confidence.dtype == np.float32
    np.testing.assert_allclose(found.boxes, track.boxes, rtol=1e-6 if atol else 0, atol=atol)
    np.testing.assert_array_equal(found.confidence, track.confidence)
    np.testing.assert_array_equal(found.lost, track.lost)
