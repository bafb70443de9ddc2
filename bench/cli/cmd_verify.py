"""`bench verify`: do some trials of a bundle again, and say whether it can be confirmed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactsim.bench.cli import shared_options as shared


def command(
    bundle: Annotated[Path, typer.Argument(metavar="BUNDLE", help="A file that `bench submit` wrote.")],
    full: Annotated[bool, typer.Option("--full", help="Do all trials again.")] = False,
    share: Annotated[
        float,
        shared.number("The share of the trials that is done again, at least 20 trials.", least=0, most=1),
    ] = 0.05,
    seed: Annotated[
        int | None,
        typer.Option(min=0, help="Seed of which trials are done again. Default: a new one each time."),
    ] = None,
    fresh: Annotated[
        bool,
        typer.Option(
            "--fresh", help="Also do one more run, with a seed that nobody could have prepared for."
        ),
    ] = False,
    record: Annotated[
        bool,
        typer.Option("--record", help="Write what was found beside the bundle, for `bench leaderboard`."),
    ] = False,
    jobs: shared.Jobs = 1,
    cache: shared.Cache = True,
) -> None:
    """Do some trials of a bundle again and compare them; exit status 1 if it cannot be confirmed."""
    import secrets
    from datetime import UTC, datetime

    import numpy as np

    from tactsim.bench.console import plain_console
    from tactsim.bench.leaderboard.bundle import Record, bundle_hash, read_bundle, write_record
    from tactsim.bench.leaderboard.verify import verify
    from tactsim.bench.places import saved
    from tactsim.bench.terminal import progress_bars
    from tactsim.core.errors import InputError, printable
    from tactsim.core.source_digest import git_commit

    read = read_bundle(bundle)
    chosen = secrets.randbelow(2**32) if seed is None else seed
    try:
        with progress_bars() as progress:
            verdict = verify(
                read,
                share=share,
                full=full,
                fresh=fresh,
                rng=np.random.default_rng(chosen),
                jobs=jobs,
                cache=cache,
                progress=progress,
            )
    except InputError as error:
        raise InputError(f"bundle {bundle}: {error}") from error

    def save() -> Path:
        made = Record(
            bundle=bundle_hash(bundle),
            verified=verdict.verified,
            said=printable(verdict.said),
            again=verdict.again,
            trials=verdict.trials,
            seed=None if full else chosen,
            commit=git_commit(),
            made=datetime.now(UTC).isoformat(timespec="seconds"),
        )
        return write_record(made, bundle)

    # What other code does not confirm is not refuted.
    counts = verdict.verified or not verdict.other_code
    with saved(save if record and counts else None) as place:
        console = plain_console()
        console.print(f"{read.method} on {read.task}", style="bold")
        for note in verdict.notes:
            console.print(f"note      {note}")
        if verdict.again:
            again = f"{verdict.again} of {verdict.trials} trials"
            console.print(f"again     {again}" + ("" if full else f", chosen with --seed {chosen}"))
        console.print(f"{'verified' if verdict.verified else 'NOT VERIFIED'}  {verdict.said}")
        if place is not None:
            console.print(f"record    {place}")
    if not verdict.verified:
        raise typer.Exit(1)
