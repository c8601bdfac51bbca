"""Tracks that are stored and go on: the boxes of one run, and errors for damaged files."""

import dataclasses
import json
from typing import Any

import jax
import numpy as np
import pytest
from settings import SMALL, SMALL_DEFAULT

import dcs_jax
from dcs_jax.synthetic import render

LENGTH = 16
PAPER = dcs_jax.Config.paper(selectors=4, pool_size=8, window_minimum=0.0, weak="gaussian")


@pytest.fixture(scope="module")
def clip():
    return render(LENGTH, (120, 160), (40, 32), speed=4)


def states_of(clip, config, boxes=None, length=1, keys=None):
    stream = dcs_jax.track_stream(clip.frames[:length], boxes or [clip.boxes[0]], keys, config)
    tracked = [chunk.track.boxes for chunk in stream]
    slots = range(len(stream.active))
    return {f"object {slot}": stream.state(slot) for slot in slots}, np.concatenate(tracked, 1)


@pytest.mark.parametrize("config", [SMALL_DEFAULT, SMALL, PAPER], ids=["default", "small", "paper"])
def test_what_is_stored_is_read_back(clip, config, tmp_path):
    config = dataclasses.replace(config, lam=0.02)
    states, _ = states_of(clip, config)
    dcs_jax.save(tmp_path / "track.npz", states, config)
    saved = dcs_jax.load(tmp_path / "track.npz")
    assert saved.config == config
    assert list(saved.states) == ["object 0"]
    found, stored = saved.states["object 0"], states["object 0"]
    assert jax.tree.structure(found) == jax.tree.structure(stored)
    for leaf, expected in zip(jax.tree.leaves(found), jax.tree.leaves(stored), strict=True):
        assert leaf.dtype == expected.dtype
        np.testing.assert_array_equal(leaf, expected)


def test_one_state_has_no_name(clip, tmp_path):
    tracker = dcs_jax.Tracker(SMALL_DEFAULT)
    tracker.init(clip.frames[0], clip.boxes[0])
    dcs_jax.save(tmp_path / "track.npz", tracker.state, SMALL_DEFAULT)
    other = dcs_jax.Tracker(SMALL_DEFAULT)
    other.state = dcs_jax.load(tmp_path / "track.npz").states[""]
    assert other.update(clip.frames[1]) == tracker.update(clip.frames[1])


@pytest.mark.parametrize("own_keys", [False, True])
def test_the_next_part_has_the_boxes_of_one_run(clip, tmp_path, own_keys):
    boxes = [clip.boxes[0], clip.boxes[0] + np.float32(3)]
    keys = jax.vmap(jax.random.key)(np.arange(2)) if own_keys else jax.random.key(4)
    _, whole = states_of(clip, SMALL_DEFAULT, boxes, LENGTH, keys)
    states, first = states_of(clip, SMALL_DEFAULT, boxes, 7, keys)
    dcs_jax.save(tmp_path / "track.npz", states, SMALL_DEFAULT)
    saved = dcs_jax.load(tmp_path / "track.npz")
    stream = dcs_jax.track_stream(
        clip.frames[7:], (), config=saved.config, states=list(saved.states.values())
    )
    rest = np.concatenate([chunk.track.boxes for chunk in stream], 1)
    np.testing.assert_allclose(np.concatenate([first, rest], 1), whole, atol=1e-4)


def test_new_boxes_join_states(clip):
    states, _ = states_of(clip, SMALL_DEFAULT, None, 5)
    stream = dcs_jax.track_stream(
        clip.frames[5:], [clip.boxes[5]], config=SMALL_DEFAULT, states=list(states.values())
    )
    tracked = np.concatenate([chunk.track.boxes for chunk in stream], 1)
    assert tracked.shape == (2, LENGTH - 5, 4)
    np.testing.assert_allclose(tracked[1, 0], clip.boxes[5], atol=1e-4)


def test_states_of_other_settings(clip):
    states, _ = states_of(clip, SMALL)
    with pytest.raises(ValueError, match=r"states\[0\] is not a state of these settings"):
        dcs_jax.track_stream(clip.frames, (), config=SMALL_DEFAULT, states=list(states.values()))
    nothing: Any = 3
    with pytest.raises(ValueError, match=r"states\[0\] must be a dcs_jax\.State, but is 3"):
        dcs_jax.track_stream(clip.frames, (), config=SMALL_DEFAULT, states=[nothing])


@pytest.fixture
def stored(clip, tmp_path):
    path = tmp_path / "track.npz"
    dcs_jax.save(path, states_of(clip, SMALL)[0], SMALL)
    return path


@pytest.mark.parametrize("share", [0, 0.3, 0.9, 0.999])
def test_a_file_that_is_cut_short(stored, share):
    whole = stored.read_bytes()
    stored.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(ValueError, match=r"track\.npz is no file of dcs_jax\.save"):
        dcs_jax.load(stored)


def test_a_damaged_file(stored):
    content = bytearray(stored.read_bytes())
    for place in range(len(content) // 3, len(content) // 3 + 40):
        content[place] ^= 0x5A
    stored.write_bytes(content)
    with pytest.raises(ValueError, match=r"track\.npz is no file of dcs_jax\.save"):
        dcs_jax.load(stored)


def rewritten(path, **changes):
    with np.load(path) as file:
        arrays = dict(file)
    header = json.loads(arrays.pop("header").tobytes()) | changes
    text = np.frombuffer(json.dumps(header).encode(), np.uint8)
    np.savez(path, **{"header": text, **arrays})


def test_a_file_of_another_version(stored):
    rewritten(stored, format=9)
    with pytest.raises(ValueError, match="has the format 9, but this version of dcs_jax reads"):
        dcs_jax.load(stored)


@pytest.mark.parametrize("changes", [{"kind": "other"}, {"config": {"parts": 7}}, {"names": 3}])
def test_a_file_of_something_else(stored, changes):
    rewritten(stored, **changes)
    with pytest.raises(ValueError, match=r"track\.npz is no file of dcs_jax\.save"):
        dcs_jax.load(stored)


def test_an_array_that_lacks(stored):
    with np.load(stored) as file:
        arrays = {name: file[name] for name in file.files if not name.endswith("strong.alpha")}
    np.savez(stored, **arrays)
    with pytest.raises(ValueError, match=r"it lacks 0/strong\.alpha"):
        dcs_jax.load(stored)


def test_nothing_is_unpickled(tmp_path):
    path = tmp_path / "track.npz"
    np.savez(path, header=np.array([object()], dtype=object))
    with pytest.raises(ValueError, match="is no file of"):
        dcs_jax.load(path)


def test_what_cannot_be_stored(clip, tmp_path):
    states, _ = states_of(clip, SMALL)
    nothing: Any = 3
    with pytest.raises(ValueError, match=r"must be a dcs_jax\.State, but is 3"):
        dcs_jax.save(tmp_path / "a.npz", {"a": nothing}, SMALL)
    config = dataclasses.replace(SMALL, lam=np.array([0.1, 0.2]))
    with pytest.raises(ValueError, match="one number for all states"):
        dcs_jax.save(tmp_path / "a.npz", states, config)
    assert not list(tmp_path.iterdir())
