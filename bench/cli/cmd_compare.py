"""`bench compare`: say whether one run is worse than another, beyond chance."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    base: Annotated[Path, typer.Argument(help="The folder of the run to compare with.")],
    new: Annotated[Path, typer.Argument(help="The folder of the run to judge.")],
) -> None:
    """Compare two runs on the same trials; exit status 1 if NEW is worse beyond the interval."""
    from tactsim.bench.compare import compare
    from tactsim.bench.console import plain_console, plain_table
    from tactsim.bench.results import load

    differences = compare(load(base), load(new))
    table = plain_table("figure", "base", "new", "new - base", "McNemar p", "verdict")
    for row in differences:
        table.add_row(
            row.name,
            _number(row.base),
            _number(row.new),
            "" if row.low is None else f"{row.low:+.4f} to {row.high:+.4f}",
            "" if row.p is None else f"{row.p:.3g}",
            row.verdict,
        )
    plain_console().print(table)
    worse = [row.name for row in differences if row.verdict == "worse"]
    if worse:
        plain_console().print(f"worse: {', '.join(worse)}")
        raise typer.Exit(1)


def _number(value: float | None) -> str:
    if value is None:
        return "-"
    return str(value) if isinstance(value, int) else f"{value:.4f}"
