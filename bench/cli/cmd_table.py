"""`bench table`: the figures of runs, for a paper."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer


class Format(StrEnum):
    """How a table is written."""

    MARKDOWN = "markdown"
    LATEX = "latex"
    CSV = "csv"


def command(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Folders of runs or of sweeps.")],
    to: Annotated[
        Format, typer.Option(help="How to write it. LaTeX needs the package booktabs.")
    ] = Format.MARKDOWN,
    figures: Annotated[
        list[str] | None,
        typer.Option(
            "--figure",
            metavar="NAME[@READING]",
            help="A column, such as accuracy@5, error_mm@20 or settled_95; repeat for several. Default: accuracy@1, "
            "accuracy@5, settled_95 and the error at the end.",
        ),
    ] = None,
    rank: Annotated[
        str | None,
        typer.Option(
            "--rank",
            metavar="FIGURE",
            help="Order the methods by this figure, such as error_mm@20, and say which ranks the tests leave to each.",
        ),
    ] = None,
) -> None:
    """Print the figures of runs with their intervals, as Markdown, LaTeX or CSV; seeds are pooled."""
    from tactsim.bench.report.collect import find
    from tactsim.bench.results import load
    from tactsim.bench.runs import tables
    from tactsim.bench.runs.pooled import pool

    folders, remarks = find(runs)
    pools = pool(map(load, folders))
    asked = figures or tables.usual_figures(pools)
    ranks = None
    if rank is not None:
        from tactsim.bench.leaderboard.ranking import rank_words, ranked

        ranking = ranked(pools, rank)
        pools, ranks = list(ranking.pools), [rank_words(places) for places in ranking.ranks]
    if to is Format.CSV:
        typer.echo(tables.csv_table(pools, asked, ranks), nl=False)
    else:
        rows = tables.plain_rows(pools, asked, ranks)
        latex = to is Format.LATEX
        table = tables.latex_table(rows, tables.meaning(pools)) if latex else tables.markdown_table(rows)
        typer.echo(table, nl=False)
        typer.echo(f"{tables.made_of(pools)}", err=True)
    for remark in remarks:
        typer.echo(f"remark  {remark}", err=True)
