"""`bench stress`: the numerical stress cases, each with its worst deviation and its limit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from tactsim.bench.cli import shared_options as shared

if TYPE_CHECKING:
    from tactsim.bench.stress import Outcome


def command(
    case: Annotated[list[str] | None, typer.Option(help="Only this case; repeat for several.")] = None,
    tag: Annotated[
        list[str] | None,
        typer.Option(help="Only cases with this tag, a topic or 'quick'; repeat for several."),
    ] = None,
    as_json: shared.AsJson = False,
) -> None:
    """Vary inputs over many decades and measure the worst deviation; exit status 1 if a case fails."""
    from tactsim.bench.machine import machine, versions
    from tactsim.bench.results import to_json
    from tactsim.bench.stress import chosen_cases, run_cases
    from tactsim.bench.terminal import progress_bars

    cases = chosen_cases(case or (), tag or ())
    with progress_bars() as progress:
        outcomes = run_cases(cases, progress)
    failed = sum(not outcome.passed for outcome in outcomes)
    if as_json:
        said = {"cases": [outcome.as_json() for outcome in outcomes], "failed": failed}
        typer.echo(to_json(said | {"versions": versions(), "machine": machine()}), nl=False)
    else:
        _print(outcomes)
    if failed:
        raise typer.Exit(1)


def _print(outcomes: Sequence[Outcome]) -> None:
    """Print the table, then for every failed case where it failed and why its limit is what it is."""
    from tactsim.bench.console import plain_console, plain_table
    from tactsim.core.errors import counted

    console = plain_console()
    table = plain_table("case", "varied", "deviation", "worst", "limit", "verdict", words=3)
    for outcome in outcomes:
        case = outcome.case
        limit = f"<= {case.limit:g}"
        table.add_row(case.name, case.varied, case.deviation, f"{outcome.worst:.2g}", limit, outcome.verdict)
    console.print(table)
    failed = [outcome for outcome in outcomes if not outcome.passed]
    for outcome in failed:
        console.print(f"{outcome.case.name}: {outcome.at}; the limit: {outcome.case.because}")
    seconds = sum(outcome.seconds for outcome in outcomes)
    console.print(f"{counted(len(outcomes), 'case')} in {seconds:.0f} s, {len(failed) or 'none'} failed")
