"""`bench bound`: how good an estimator can be at all."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactsim.bench.cli import shared_options as shared
from tactsim.bench.cli.words import Words, key_values, with_options_of
from tactsim.bench.config import ScanWords, run_config


@with_options_of(ScanWords)
def command(
    words: Words,
    trials: Annotated[int, typer.Option(min=1, help="Trials for each letter.")] = 10,
    readings: Annotated[int, typer.Option(min=1, help="Readings a trial, without replacement.")] = 20,
    scan: Annotated[
        Path | None, typer.Option(help="Readings from a file of `bench scan` instead of the press.")
    ] = None,
    slip: Annotated[
        list[str] | None,
        typer.Option(
            help="How the object moves between touches, a random walk: walk_mm=0.5, walk_rad=0.03.",
            metavar="NAME=VALUE",
        ),
    ] = None,
    jobs: shared.Jobs = 1,
    cache: shared.Cache = True,
    out: Annotated[Path | None, typer.Option(help="Also draw a picture: the file to write, .png.")] = None,
    as_json: shared.AsJson = False,
) -> None:
    """Say how good an estimator can be: exact Bayes, and the Cramer-Rao bound of the error, by reading."""
    from functools import partial

    from tactsim.bench.bound.bound import find_bound
    from tactsim.bench.places import check_new_file, saved
    from tactsim.bench.results import to_json
    from tactsim.bench.terminal import print_bound, progress_bars
    from tactsim.core.files import write_bytes

    if out is not None:
        check_new_file(out, picture=".png")
    given = {} if scan is None else {"scan": scan}
    moving = {} if slip is None else {"slip": key_values(slip, "--slip")}
    config = run_config(**words, **given, **moving, trials=trials, readings=readings)
    with progress_bars() as progress:
        found = find_bound(config, jobs=jobs, cache=cache, progress=progress)

    def save(picture: Path) -> Path:
        write_bytes(picture, found.plot().png())
        return picture

    with saved(None if out is None else partial(save, out)) as place:
        if as_json:
            typer.echo(to_json(found.as_json()), nl=False)
            return
        print_bound(found)
        if place is not None:
            typer.echo(f"picture  {place}")
