"""`bench sweep`, `report`, `table` and `compare`: many runs, and what their figures say beside each other."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from tactsim.bench.cli import shared_options as shared


def command_sweep(
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


def command_report(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Folders of runs or of sweeps.")],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.html",
            help="The page to write. Default: report.html in the folder given, in results/ for several.",
        ),
    ] = None,
    each_seed: Annotated[
        bool,
        typer.Option(
            "--each-seed", help="Show each seed by itself; else runs that differ in the seed are pooled."
        ),
    ] = False,
) -> None:
    """Write one HTML page that opens without a network; beside it curves as CSV, and figures as PDF and SVG."""
    from tactsim.bench.places import RESULTS, check_new_file, check_page
    from tactsim.bench.report.write import check_folder, write_report
    from tactsim.bench.terminal import progress_bars
    from tactsim.core.errors import printable

    for folder in runs:
        check_folder(folder)
    target = out or (runs[0] if len(runs) == 1 else RESULTS) / "report.html"
    check_page(target)
    check_new_file(target, picture=".html")
    with progress_bars() as progress:
        written, remarks = write_report(runs, target, each_seed=each_seed, progress=progress)
    for kind, path in zip(["report", *["beside"] * (len(written) - 1)], written, strict=True):
        typer.echo(printable(f"{kind}  {path}"))
    for remark in remarks:
        typer.echo(printable(f"remark  {remark}"), err=True)


class Format(StrEnum):
    """How a table is written."""

    MARKDOWN = "markdown"
    LATEX = "latex"
    CSV = "csv"


def command_table(
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
    from tactsim.bench.report.write import find
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


def command_compare(
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
