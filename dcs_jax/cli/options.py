"""Options that several commands share."""

from typing import Annotated, Literal

import typer

from dcs_jax.checks import LARGEST_SEED

PresetName = Literal["default", "paper"]
Preset = Annotated[PresetName, typer.Option(help="Settings of the tracker.")]
Changes = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Change a setting of the preset, as in --set scale.step=1.03; repeatable.",
        show_default=False,
    ),
]
Seed = Annotated[int, typer.Option(min=0, max=LARGEST_SEED, help="Seed of the random features.")]


def together(changes: list[str] | None) -> list[str]:
    """The changes as one: they are made together."""
    return [",".join(changes)] if changes else []
