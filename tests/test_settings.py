"""Settings by name: presets, changes of fields and of groups."""

import pytest

from dcs_jax import Config, ScaleFilter
from dcs_jax.evaluation.settings import parse_setting, with_changes


def config_of(text: str) -> Config:
    return parse_setting(text).config("")


def test_fields_of_groups_and_components_are_changed_by_name():
    assert config_of("default scale.step=1.03") == Config(scale=ScaleFilter(step=1.03))
    assert config_of("default translation=none lam=0.1") == Config(translation=None, lam=0.1)
    # In any order: only the whole has to make sense.
    both = config_of("default verification=none redetection=none")
    assert both == Config(verification=None, redetection=None)
    with_scale = config_of("paper scale=default scale.num_scales=5")
    assert with_scale == Config.paper(scale=ScaleFilter(num_scales=5))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("defaults", "'defaults' is not a preset: expected one of default, paper, authors"),
        ("default depth=3", "'depth=3' is not a change of a field: .* canvas, .* scale.step"),
        ("default scale.steps=3", "'scale.steps=3' is not a change of a field"),
        ("default lam", "'lam' is not a change of a field"),
        ("default scale.step=0.5", r"step must be above 1 and below 2, but is 0\.5"),
        ("default scale=0.5", r"scale must be a dcs_jax\.ScaleFilter or None, but is 0\.5"),
        ("default verification=none", "redetection needs verification"),
        ("paper scale.step=1.03", r"scale\.step cannot .* where scale is None: add scale=default"),
        ("default extras=False", "extras is now translation, scale, verification and redetection"),
        ("default scale=False", "scale=False is now output_size='initial'"),
        ("default size_step=1.03", r"size_step is now scale\.step"),
    ],
)
def test_what_is_not_a_setting_is_refused(text, message):
    with pytest.raises(ValueError, match=message):
        parse_setting(text)


def test_changes_are_made_together_where_commas_join_them():
    settings = with_changes(["default"], ["scale.step=1.03,lam=0.1", "canvas=(40,30)"])
    names = [setting.name for setting in settings]
    assert names == ["default", "default scale.step=1.03 lam=0.1", "default canvas=(40,30)"]
