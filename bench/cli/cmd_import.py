"""`bench import`: make a scan of what was exported, or of arrays of other people."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="FILE|FOLDER", help="A folder of Parquet, or a .mcap, .h5, .npz or .mat file."
        ),
    ],
    out: Annotated[Path, typer.Option(help="The scan to write, .npz.")],
    licence: Annotated[
        str | None,
        typer.Option(
            help="The scan's licence by its SPDX name, like CC-BY-4.0, if it does not state its own.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Make a scan of what `bench export` wrote, bit for bit, or of arrays in a .npz or .mat file."""
    from tactsim.bench import formats
    from tactsim.bench.console import plain_console
    from tactsim.bench.places import check_new_file

    check_new_file(out)
    scan = formats.read(source)
    if licence is not None:
        scan = scan.licensed(licence)
    scan.save(out)
    plain_console().print(
        f"{len(scan):,} readings of {' '.join(scan.letters)}, {scan.readings.shape[1]} taxels, in {out}"
    )
