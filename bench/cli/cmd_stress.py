"""`bench stress`: the numerical stress cases, each with its worst deviation and its limit."""

from __future__ import annotations

from typing import Annotated

import typer


def command(
    case: Annotated[
        list[str] | None, typer.Option(help="Only this case; repeat for several.", show_default=False)
    ] = None,
    tag: Annotated[
        list[str] | None,
        typer.Option(
            help="Only cases with this tag, a topic or 'quick'; repeat for several.", show_default=False
        ),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object on standard output and nothing else there.")
    ] = False,
) -> None:
    """Vary inputs over many decades and measure the worst deviation; exit status 1 if a case fails."""
    from tactsim.bench.results import to_json
    from tactsim.bench.stress import chosen_cases, run_cases
    from tactsim.bench.stress.outcomes import print_outcomes, public
    from tactsim.bench.terminal import progress_bars

    cases = chosen_cases(case or (), tag or ())
    with progress_bars() as progress:
        outcomes = run_cases(cases, progress)
    if as_json:
        typer.echo(to_json(public(outcomes)), nl=False)
    else:
        print_outcomes(outcomes)
    if not all(outcome.passed for outcome in outcomes):
        raise typer.Exit(1)
