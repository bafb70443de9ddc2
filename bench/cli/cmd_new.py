"""`bench new`: a repository of a user's own, for an estimator or a source."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    kind: Annotated[str, typer.Argument(metavar="KIND", help="What to make: estimator or source.")],
    name: Annotated[str, typer.Argument(help="Its name: lower-case words with hyphens between them.")],
    out: Annotated[
        Path | None, typer.Option(help="A new folder. Default: one called as the repository.")
    ] = None,
) -> None:
    """Make a repository of your own for an estimator or a source, with its tests and its workflow."""
    from tactsim.bench.console import plain_console
    from tactsim.bench.new import make

    folder = make(kind, name, out)
    console = plain_console()
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            console.print(str(path))
    console.print(f"{folder / 'README.md'} says how to go on")
