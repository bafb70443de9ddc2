"""`bench sweep`: many runs; those that a stopped sweep did are not done again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactsim.bench.cli import shared_options as shared


def command(
    source: Annotated[
        str,
        typer.Argument(
            metavar="FILE.toml|SUITE", help="A sweep file, or a suite; `bench list suites` names them."
        ),
    ],
    jobs: Annotated[int | None, typer.Option(min=1, help="Local processes. Default: one a core.")] = None,
    dask: Annotated[
        str | None, typer.Option(metavar="tcp://HOST:PORT", help="Use the workers of this Dask cluster.")
    ] = None,
    cache: shared.Cache = True,
    out: Annotated[
        Path | None,
        typer.Option(help="The sweep's folder; one that was stopped goes on. Default: results/sweeps/NAME."),
    ] = None,
) -> None:
    """Do many runs; a sweep that was stopped goes on with those that are missing when it is started again."""
    from tactsim.bench import sweep
    from tactsim.bench.console import plain_console
    from tactsim.bench.machine import cores
    from tactsim.bench.places import SWEEPS, check_folder
    from tactsim.bench.terminal import print_sweep, progress_bars

    name, configs = sweep.read(source)
    folder = out or SWEEPS / name
    check_folder(folder)
    with progress_bars() as progress:
        places = sweep.perform(
            configs,
            folder,
            jobs=jobs or cores(),
            pool=sweep.dask_pool(dask) if dask else None,
            cache=cache,
            progress=progress,
        )
    print_sweep(places)
    plain_console().print(f"results  {folder}")
