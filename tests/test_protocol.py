"""The starts of OTB's protocols, and the names of settings."""

import numpy as np
import pytest

from dcs_jax import Config
from dcs_jax.evaluation.protocol import starts
from dcs_jax.evaluation.settings import parse_setting, with_changes

TRUTH = np.tile([10.0, 20, 40, 30], (500, 1)) + np.arange(500)[:, None] * [1, 0, 0, 0]


def test_one_pass():
    (start,) = starts("ope", TRUTH)
    assert (start.name, start.frame) == ("ope", 0)
    np.testing.assert_array_equal(start.box, TRUTH[0])


def test_temporal_starts_are_spread_evenly_and_labelled():
    truth = TRUTH.copy()
    truth[1::5] = np.nan
    found = starts("tre", truth)
    frames = np.array([start.frame for start in found])
    assert len(found) == len({start.name for start in found}) == 20
    assert (frames[0], frames[-1]) == (0, 480)
    assert np.ptp(np.diff(frames)) <= 3
    for start in found:
        np.testing.assert_array_equal(start.box, truth[start.frame])


def test_short_sequences_have_fewer_temporal_starts():
    assert [start.frame for start in starts("tre", TRUTH[:22])] == [0, 1, 2]
    assert [start.frame for start in starts("tre", TRUTH[:5])] == [0]


def test_spatial_starts_are_shifted_and_scaled():
    found = starts("sre", TRUTH)
    assert [start.frame for start in found] == [0] * 12
    boxes = np.array([start.box for start in found])
    centres = boxes[:, :2] + boxes[:, 2:] / 2 - [30, 35]
    expected = {(x, y) for x in (-4, 0, 4) for y in (-3, 0, 3)} - {(0, 0)}
    assert {tuple(centre) for centre in centres[:8].round(6)} == expected
    np.testing.assert_array_equal(boxes[:8, 2:], [[40, 30]] * 8)
    np.testing.assert_allclose(centres[8:], 0, atol=1e-9)
    np.testing.assert_allclose(boxes[8:, 2] / 40, [0.8, 0.9, 1.1, 1.2])


def test_another_protocol_is_refused():
    with pytest.raises(ValueError, match="one of ope, tre, sre, but is 'vot'"):
        starts("vot", TRUTH)


def test_settings_by_name():
    assert parse_setting("default").config("david") == Config()
    changed = parse_setting("paper selector=error lam=0.5")
    assert changed.name == "paper selector=error lam=0.5"
    assert changed.config("david") == Config.paper(selector="error", lam=0.5)
    authors = parse_setting("authors")
    assert authors.config("sylv") == Config.paper(selectors=10, block=0.2)
    assert authors.config("tiger1") == Config.paper(block=1)


def test_every_change_is_made_to_every_preset():
    found = with_changes(["default", "paper"], ["parts=5,canvas=(30,20)", "weak=gaussian"])
    assert [setting.name for setting in found] == [
        "default",
        "paper",
        "default parts=5 canvas=(30,20)",
        "paper parts=5 canvas=(30,20)",
        "default weak=gaussian",
        "paper weak=gaussian",
    ]
    assert found[2].config("") == Config(parts=5, canvas=(30, 20))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("best", "'best' is not a preset: expected one of default, paper, authors"),
        (" ", "'' is not a preset"),
        ("paper hue=red", "'hue=red' is not a change of a field: .* selectors"),
        ("paper parts", "'parts' is not a change"),
        ("paper parts=3", "parts must be one of 1, 5, 9"),
    ],
)
def test_wrong_settings_are_refused(text, message):
    with pytest.raises(ValueError, match=message):
        parse_setting(text)
