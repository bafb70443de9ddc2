"""The options that `bench run` and `bench scan` have for objects in space, with `--task solids`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

PANEL = "Objects in space (--task solids)"

Objects = Annotated[
    str | None,
    typer.Option(
        help="Which objects: bolt,nut,key, or 30 for the first thirty (of 50), or none beside shapes. Default: 12.",
        rich_help_panel=PANEL,
        show_default=False,
    ),
]
Touches = Annotated[
    int | None, typer.Option(help="Touches a trial (20).", rich_help_panel=PANEL, show_default=False)
]
Hand = Annotated[
    Path | None,
    typer.Option(
        help="Several pads that touch at once: gripper, or a hand file (.toml).",
        rich_help_panel=PANEL,
        show_default=False,
    ),
]


OUTSIDE = (
    "is for objects in space; add --task solids, or leave it out"  # of an option, where the task is another
)
