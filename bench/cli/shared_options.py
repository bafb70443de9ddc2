"""Options that several verbs share: what is pressed, and how it is said on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Letters = Annotated[
    str | None,
    typer.Option(
        help="Which letters: AEIOU, A-Z0-9, A,E,I. Default: AEIOU, or all that --scan holds.",
        show_default=False,
    ),
]
Shape = Annotated[
    list[Path] | None,
    typer.Option(
        help="A shape of your own beside the letters: STL, OBJ, GLB or SVG; repeat for several.",
        show_default=False,
    ),
]
World = Annotated[
    str,
    typer.Option(
        help="How good the data are: default, paper-like (placement error, random classes), or a file of "
        "`bench validate`."
    ),
]
Noise = Annotated[
    str | None,
    typer.Option(
        help="Sensor noise, sd in kPa; 'off': no noise, resolution, saturation or placement error.",
        show_default=False,
    ),
]
TestPoses = Annotated[
    str,
    typer.Option(
        help="Test readings at the training poses (same, as in the paper) or off the grid (random)."
    ),
]
ScanSet = Annotated[
    list[str] | None,
    typer.Option(
        "--scan-set",
        help="Any option of the scan, e.g. press.force=5; `bench list scan-options` names them.",
        show_default=False,
    ),
]
Seed = Annotated[int, typer.Option(min=0, help="Seed of all randomness.")]
Jobs = Annotated[int, typer.Option(min=1, help="Processes; the results do not depend on it.")]
Cache = Annotated[
    bool,
    typer.Option("--cache/--no-cache", help="Take pressed readings from the cache, and keep them there."),
]
