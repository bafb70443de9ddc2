"""`bench leaderboard`: make a page of the bundles in a folder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="The folder of bundles (*.tar.xz).")],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="SITE",
            help="The site's folder; a site that stands there is replaced. Default: site in FOLDER.",
        ),
    ] = None,
) -> None:
    """Rank the methods of a folder of bundles, task by task, and write a page of them."""
    from tactsim.bench.cli.app import FAILED
    from tactsim.bench.leaderboard.site import check_out, write_site
    from tactsim.bench.leaderboard.standings import read_folder
    from tactsim.bench.terminal import progress_bars
    from tactsim.core.errors import InputError, printable

    if not folder.is_dir():
        raise InputError(f"{folder}: there is no such folder; name one of bundles")
    target = out or folder / "site"
    check_out(target)
    with progress_bars() as progress:
        found = read_folder(folder, progress=progress)
    write_site(found, target)
    typer.echo(printable(f"site  {target / 'index.html'}"))
    for path, why in found.unreadable:
        typer.echo(printable(f"unreadable  {path.name}: {why}"), err=True)
    if found.unreadable:
        raise typer.Exit(FAILED)
