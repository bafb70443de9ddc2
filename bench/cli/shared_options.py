"""Options that several verbs share."""

from __future__ import annotations

from typing import Annotated

import typer

ScanSet = Annotated[
    list[str] | None,
    typer.Option(
        "--scan-set",
        help="Any option of the scan, e.g. press.force=5; `bench list scan-options` names them.",
        show_default=False,
    ),
]
Seed = Annotated[int, typer.Option(min=0, help="Seed of all randomness.")]
Jobs = Annotated[int, typer.Option(min=1, help="Processes; the results do not depend on their number.")]
Cache = Annotated[
    bool,
    typer.Option("--cache/--no-cache", help="Take pressed readings from the cache, and keep them there."),
]
Licence = Annotated[
    str | None,
    typer.Option(
        help="The scan's licence by its SPDX name, like CC-BY-4.0, if it does not state its own.",
        show_default=False,
    ),
]
