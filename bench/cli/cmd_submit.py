"""`bench submit`: do a task with a method, and write the one file that others can check."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactsim.bench.cli import shared_options as shared


def command(
    task: Annotated[str, typer.Argument(metavar="TASK", help="A frozen task; `bench tasks` names them all.")],
    estimator: Annotated[str, typer.Option(help="The estimator; `bench list` names them all.")],
    out: Annotated[Path, typer.Option(help="The bundle, a file that is to be written.")],
    options: Annotated[
        list[str] | None,
        typer.Option("--set", help="An option of the estimator, key=value; repeat for several."),
    ] = None,
    title: Annotated[
        str | None, typer.Option(help="How tables call the method. Default: its name and options.")
    ] = None,
    reproducible: Annotated[
        bool,
        typer.Option(
            "--reproducible/--not-reproducible",
            help="Whether the same seeds give the same answers to the bit.",
        ),
    ] = True,
    jobs: shared.Jobs = 1,
    cache: shared.Cache = True,
    as_json: shared.AsJson = False,
) -> None:
    """Do all runs of a task with a method, and write one file that others can check; exit status 1 without a score."""
    from tactsim.bench.config import key_values
    from tactsim.bench.console import plain_console
    from tactsim.bench.leaderboard.bundle import DONE, SUFFIX, figures_of, write_bundle
    from tactsim.bench.leaderboard.submit import Method, submit
    from tactsim.bench.places import check_new_file, saved
    from tactsim.bench.results import to_json
    from tactsim.bench.tasks import task as read_task
    from tactsim.bench.terminal import progress_bars

    check_new_file(out, Path(task), suffix=SUFFIX)
    method = Method(estimator, key_values(options or [], "--set"))
    with progress_bars() as progress:
        bundle, output = submit(
            task, method, title=title, reproducible=reproducible, jobs=jobs, cache=cache, progress=progress
        )
    done = bundle.status == DONE
    scored = figures_of(bundle, read_task(task).scored) if done else {}

    def save() -> Path:
        write_bundle(bundle, out)
        return out

    with saved(save) as place:
        if output:
            plain_console(stderr=True).print(output)
        if as_json:
            said = {"task": bundle.task, "method": bundle.method, "status": bundle.status, "figures": scored}
            typer.echo(to_json(said | {"bundle": place and str(place)}), nl=False)
        else:
            console = plain_console()
            console.print(f"{bundle.method} on {bundle.task}", style="bold")
            for figure, value in scored.items():
                console.print(f"{figure}  {'-' if value is None else f'{value:.4g}'}")
            console.print(f"status  {bundle.status}")
            if place is not None:
                console.print(f"bundle  {place}")
    if not done:
        raise typer.Exit(1)
