"""How outcomes are shown: a table for people, one object for machines."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from rich.table import Table

from tactsim.bench.console import plain_console
from tactsim.bench.machine import machine, versions
from tactsim.bench.stress.case import Outcome


def print_outcomes(outcomes: Sequence[Outcome]) -> None:
    """Print the table, then for every failed case where it failed and why its limit is what it is."""
    console = plain_console()
    table = Table(box=None, pad_edge=False)
    for heading in ("case", "varied", "deviation"):
        table.add_column(heading, overflow="fold")
    for heading in ("worst", "limit", "verdict"):
        table.add_column(heading, justify="right", no_wrap=True)
    for outcome in outcomes:
        case = outcome.case
        table.add_row(
            case.name,
            case.varied,
            case.deviation,
            f"{outcome.worst:.2g}",
            f"{'>=' if case.at_least else '<='} {case.limit:g}",
            verdict(outcome),
        )
    console.print(table)
    for outcome in outcomes:
        if not outcome.passed:
            console.print(
                f"{outcome.case.name}: {outcome.at}; the limit: {outcome.case.because}",
            )
    failed = sum(not outcome.passed for outcome in outcomes)
    seconds = sum(outcome.seconds for outcome in outcomes)
    console.print(f"{len(outcomes)} cases in {seconds:.0f} s, {failed or 'none'} failed")


def public(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Put the outcomes into the object that `--json` prints; a worst that is not finite is None."""
    return {
        "cases": [
            {
                "name": outcome.case.name,
                "tags": outcome.case.tags,
                "varied": outcome.case.varied,
                "deviation": outcome.case.deviation,
                "worst": outcome.worst if math.isfinite(outcome.worst) else None,
                "at": outcome.at,
                "limit": outcome.case.limit,
                "limit_is": "least" if outcome.case.at_least else "most",
                "because": outcome.case.because,
                "verdict": verdict(outcome),
                "seconds": outcome.seconds,
            }
            for outcome in outcomes
        ],
        "failed": sum(not outcome.passed for outcome in outcomes),
        "versions": versions(),
        "machine": machine(),
    }


def verdict(outcome: Outcome) -> str:
    """Say in a word whether the case keeps to its limit."""
    return "passes" if outcome.passed else "FAILS"
