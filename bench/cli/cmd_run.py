"""`bench run`: press, map, recognise and score with one estimator."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactsim.bench.cli import shared_options as shared
from tactsim.bench.cli.words import Words, with_options_of
from tactsim.bench.config import RunConfig, run_config


@with_options_of(RunConfig)
def command(
    words: Words,
    jobs: shared.Jobs = 1,
    cache: shared.Cache = True,
    out: Annotated[
        Path | None,
        typer.Option(help="A new folder for the results. Default: results/runs/...", show_default=False),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object on standard output and nothing else there.")
    ] = False,
) -> None:
    """Press the letters, learn their maps, recognise them in random places and score every reading."""
    from tactsim.bench.places import check_new_folder, new_place
    from tactsim.bench.results import to_json
    from tactsim.bench.runner import perform
    from tactsim.bench.terminal import print_run, progress_bars

    config = run_config(**words)
    folder = out or new_place(config.estimator)
    check_new_folder(folder)
    with progress_bars() as progress:
        run = perform(config, jobs=jobs, cache=cache, progress=progress)
    run.save(folder)
    if as_json:
        typer.echo(to_json(run.as_json() | {"results": str(folder)}), nl=False)
    else:
        print_run(run, folder)
