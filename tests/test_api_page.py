"""How the API page shows what is in the code: docs/griffe_fields.py."""

from pathlib import Path

import pytest

griffe = pytest.importorskip("griffe", reason="the pages are built with the extra docs")

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def package():
    extensions = griffe.load_extensions(str(ROOT / "docs" / "griffe_fields.py"))
    return griffe.load("dcs_jax", search_paths=[str(ROOT)], extensions=extensions)


def test_arguments_are_a_list(package):
    text = package["runners.stream.track_stream"].docstring.value
    items = [line for line in text.splitlines() if line.startswith("- `")]
    assert [item.split("`")[1] for item in items] == [
        "frames",
        "boxes",
        "keys",
        "config",
        "slots",
        "chunk",
        "states",
    ]
    first = text.index(items[0])
    assert text[first - 2 : first] == "\n\n"  # Markdown wants an empty line before a list
    following = text[first:].splitlines()[1]
    assert following.startswith("    ")  # a line of the same item
    assert text.endswith("where a frame is not.")


def test_fields_of_a_class_are_a_list(package):
    assert "\n- `start`: index of the first" in package["runners.stream.Chunk"].docstring.value


def test_other_lines_with_a_colon_stay(package):
    text = package["runners.stream.track_stream"].docstring.value
    assert "\n    for chunk in dcs_jax.track_stream(" in text


@pytest.mark.parametrize(
    ("setting", "default"),
    [
        ("Config.pool_size", "50"),
        ("Config.block", "1 / 3"),
        ("Config.selector", "'l1'"),
        ("Config.canvas", "40"),
        ("Config.lam", "0.01"),
        ("Verification.recent_rate", "0.07"),
    ],
)
def test_a_setting_has_its_default(package, setting, default):
    assert str(package[f"config.{setting}"].value) == default
