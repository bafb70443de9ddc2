"""`bench sweep`, `report`, `table` and `compare`: many runs, and what their figures say beside each other."""

from __future__ import annotations

from dataclasses import replace
from itertools import groupby
from pathlib import Path
from typing import Literal

import typer

from tactsim.bench.cli import shared_options as shared
from tactsim.bench.console import plain_console, plain_table
from tactsim.bench.places import RESULTS, SWEEPS, check_folder, check_new_file
from tactsim.bench.report import check_page
from tactsim.core.errors import InputError, printable


def command_sweep(
    source: str = typer.Argument(
        ..., metavar="FILE.toml|SUITE", help="A sweep file, or a suite; `bench list suites` names them."
    ),
    jobs: int | None = typer.Option(None, min=1, help="Local processes. Default: one a core."),
    dask: str | None = typer.Option(None, metavar="tcp://HOST:PORT", help="Use this Dask cluster's workers."),
    cache: shared.Cache = True,
    also: list[str] | None = typer.Option(
        None, metavar="ESTIMATOR", help="Ask the same of this one too, such as your own; repeat for several."
    ),
    out: Path | None = typer.Option(
        None, help="The sweep's folder; one that was stopped goes on. Default: results/sweeps/NAME."
    ),
) -> None:
    """Do many runs; a sweep that was stopped goes on with those that are missing when it is started again."""
    from tactsim.bench import sweep
    from tactsim.bench.machine import cores
    from tactsim.bench.terminal import progress_bars

    name, configs = sweep.read(source, also or ())
    folder = out or SWEEPS / name
    check_folder(folder)
    with progress_bars() as progress:
        pool = sweep.dask_pool(dask) if dask else None
        places = sweep.perform(
            configs, folder, jobs=jobs or cores(), pool=pool, cache=cache, progress=progress
        )
    _print_sweep(places)
    plain_console().print(f"results  {folder}")


def _print_sweep(places: list[Path]) -> None:
    """Print one line a method, a table for each protocol and task: only what may be compared shares a table.

    Runs that differ in the seed alone share a line, with intervals over scans and trials.
    """
    from tactsim.bench.results import Run
    from tactsim.bench.runs import tables
    from tactsim.bench.runs.pooled import pool

    console = plain_console()
    pooled = groupby(pool(map(Run.load, places)), key=lambda one: (one.protocol, one.task))
    for (protocol, task), grouped in pooled:
        pools = list(grouped)
        console.print(protocol, style="bold", end="; ")
        console.print(f"{task}; {tables.made_of(pools)}")
        head, *rows = tables.plain_rows(pools, [*tables.usual_figures(pools), "ms"])
        table = plain_table(*head)
        for row in rows:
            table.add_row(*row)
        console.print(table)


def command_report(
    runs: list[Path] = typer.Argument(..., metavar="RUN...", help="Folders of runs or of sweeps."),
    out: Path | None = typer.Option(
        None,
        metavar="FILE.html",
        help="The page to write. Default: report.html in the folder given, in results/ for several.",
    ),
    width: str = typer.Option("7.16in", help="Of the figures beside the page, of type 8 pt: 3.4in, 86mm."),
    panel: Literal["accuracy", "error"] | None = typer.Option(
        None, help="Only this panel of the curves over readings. Default: both."
    ),
    caption: bool = typer.Option(True, "--caption/--no-caption", help="Say below a figure what it is of."),
) -> None:
    """Write one HTML page that opens without a network; beside it curves as CSV, and figures as PDF and SVG."""
    from tactsim.bench.report import Sheet
    from tactsim.bench.report.write import check_folder, write_report
    from tactsim.bench.terminal import progress_bars

    sheet = Sheet(_inches(width), panel, caption)
    for folder in runs:
        check_folder(folder)
    target = out or (runs[0] if len(runs) == 1 else RESULTS) / "report.html"
    check_page(target)
    check_new_file(target, picture=".html")
    with progress_bars() as progress:
        written, remarks = write_report(runs, target, progress=progress, sheet=sheet)
    for kind, path in zip(["report", *["beside"] * (len(written) - 1)], written, strict=True):
        typer.echo(printable(f"{kind}  {path}"))
    for remark in remarks:
        typer.echo(printable(f"remark  {remark}"), err=True)


def _inches(text: str) -> float:
    """Read a width such as 3.4in, 86mm or 8.6cm. Raises InputError."""
    units = {"in": 1.0, "mm": 1 / 25.4, "cm": 1 / 2.54}
    number = shared.finite_number(text[:-2])
    found = 0.0 if number is None else number * units.get(text[-2:], 0.0)
    if not 1 <= found <= 40:
        raise InputError(f"--width {text!r}: give 1 to 40 inches, such as 3.4in or 86mm")
    return found


def command_table(
    runs: list[Path] = typer.Argument(..., metavar="RUN...", help="Folders of runs or of sweeps."),
    to: Literal["markdown", "latex", "csv"] = typer.Option(
        "markdown", help="How to write it. LaTeX needs the package booktabs."
    ),
    figures: list[str] | None = typer.Option(
        None,
        "--figure",
        metavar="NAME[@READING]",
        help="A column, such as accuracy@5, error_mm@20 or settled_95; repeat for several. Default: accuracy@1, "
        "accuracy@5, settled_95 and the error at the end.",
    ),
    rank: str | None = typer.Option(
        None,
        "--rank",
        metavar="FIGURE",
        help="Order the methods by this figure, such as error_mm@20, and say which ranks the tests leave to each.",
    ),
) -> None:
    """Print the figures of runs with their intervals, as Markdown, LaTeX or CSV; seeds are pooled."""
    from tactsim.bench.report.write import find
    from tactsim.bench.runs import tables
    from tactsim.bench.runs.pooled import pool
    from tactsim.bench.runs.saved import load

    folders, remarks = find(runs)
    pools = pool(map(load, folders))
    asked = figures or tables.usual_figures(pools)
    ranks = None
    if rank is not None:
        from tactsim.bench.leaderboard.ranking import rank_words, ranked

        ranking = ranked(pools, rank)
        pools, ranks = list(ranking.pools), [rank_words(places) for places in ranking.ranks]
    if to == "csv":
        typer.echo(tables.csv_table(pools, asked, ranks), nl=False)
    else:
        rows = tables.plain_rows(pools, asked, ranks)
        latex = to == "latex"
        table = tables.latex_table(rows, tables.meaning(pools)) if latex else tables.markdown_table(rows)
        typer.echo(table, nl=False)
        typer.echo(f"{tables.made_of(pools)}", err=True)
    for remark in remarks:
        typer.echo(f"remark  {remark}", err=True)


def command_compare(
    base: Path = typer.Argument(..., help="The folder of the run to compare with."),
    new: list[Path] = typer.Argument(..., metavar="NEW...", help="The folder of a run to judge, or more."),
) -> None:
    """Compare runs on the same trials with a first one; exit status 1 if any is worse beyond chance."""
    from tactsim.bench.compare import compare
    from tactsim.bench.runs.saved import load

    folders = [base, *new]
    for i, folder in enumerate(folders):
        if folder.resolve() in (of.resolve() for of in folders[:i]):
            raise InputError(f"{folder} is given twice; give each run once")
    if len(new) > 1:
        _compare_all(folders)
        return
    differences = compare(load(base), load(new[0]))
    table = plain_table("figure", "base", "new", "new - base", "McNemar p", "verdict")
    for row in differences:
        interval = "" if row.low is None else f"{row.low:+.4f} to {row.high:+.4f}"
        p = "" if row.p is None else f"{row.p:.3g}"
        table.add_row(row.name, _number(row.base), _number(row.new), interval, p, row.verdict)
    plain_console().print(table)
    _fail_if([row.name for row in differences if row.verdict == "worse"])


def _fail_if(worse: list[str]) -> None:
    if worse:
        typer.echo(printable(f"worse: {', '.join(worse)}"))
        raise typer.Exit(1)


def _compare_all(folders: list[Path]) -> None:
    """Compare each of several runs with the first, their p corrected for all pairs as a leaderboard's are."""
    from tactsim.bench.compare import check_same_trials
    from tactsim.bench.leaderboard.ranking import LEVEL, ranked
    from tactsim.bench.runs.pooled import cell, pool
    from tactsim.bench.runs.saved import load
    from tactsim.bench.runs.tables import heading

    runs = [load(folder) for folder in folders]
    for run in runs[1:]:
        check_same_trials(runs[0], run)
    pools = [
        replace(pool([run])[0], method=str(folder), budget=None, mark="")
        for run, folder in zip(runs, folders, strict=True)
    ]
    ranking = ranked(pools, f"accuracy@{min(5, *(run.readings for run in runs))}")
    place = {one.method: number for number, one in enumerate(ranking.pools)}
    base, worse = place[str(folders[0])], []
    kind = runs[0].kind.name
    table = plain_table(
        "run",
        heading(ranking.accuracy_by, kind),
        "p",
        heading(ranking.error_by, kind),
        "p",
        "against the first",
    )
    for folder in folders:
        i, wins = place[str(folder)], ranking.accuracies.wins
        ahead = wins[i, base] - wins[base, i], -ranking.errors.difference[i, base]
        p = (ranking.accuracies.p[i, base], ranking.errors.p[i, base])
        verdicts = [
            f"{'better' if by > 0 else 'worse'} in {what}"
            for what, by, chance in zip(("accuracy", "error"), ahead, p, strict=True)
            if chance <= LEVEL
        ]
        worse += [str(folder)] * any(one.startswith("worse") for one in verdicts)
        figures = [cell(ranking.pools[i], by) for by in (ranking.accuracy_by, ranking.error_by)]
        first = i == base
        shown = [
            "" if first or figure == "-" else f"{chance:.3f}" if chance >= 0.001 else "<0.001"
            for figure, chance in zip(figures, p, strict=True)
        ]
        said = "" if first else ", ".join(verdicts) or "not told apart"
        table.add_row(str(folder), figures[0], shown[0], figures[1], shown[1], said)
    plain_console().print(table)
    plain_console().print(
        f"p: McNemar's exact test by Holm's method, and a bootstrap by its largest difference, each corrected for all "
        f"{len(folders) * (len(folders) - 1) // 2} pairs"
    )
    _fail_if(worse)


def command_runs(folder: Path = typer.Argument(Path("results"), help="Where to look, at any depth.")) -> None:
    """List all runs of a folder with their figures after the last reading, the newest last."""
    from tactsim.bench.report.write import check_folder
    from tactsim.bench.runs.pooled import cell, metric_of, pool
    from tactsim.bench.runs.saved import load

    check_folder(folder)
    found, remarks = [], []
    for path in sorted(folder.rglob("run.json")):
        if any(part.startswith(".") for part in path.relative_to(folder).parts):
            continue  # it is being written
        try:
            run = load(path.parent)
            found.append((str(run.times.get("started", "")), path.parent, pool([run])[0]))
        except InputError as error:
            remarks.append(str(error))
    if not found:
        raise InputError(f"{folder}: no run in it or below; `bench run` makes one")
    names = ("accuracy", "settled_95", "error_mm")  # after the last reading
    heads = (metric_of(name).column for name in names)
    unlike = len({one.protocol for *_, one in found}) > 1
    table = plain_table(
        "begun", "run", "method", "data", *["protocol"] * unlike, "readings", *heads, words=4 + unlike
    )
    for begun, path, one in sorted(found, key=lambda of: of[:2]):
        asked = (f"{name}@{one.readings}" if metric_of(name).of_readings else name for name in names)
        figures = [cell(one, figure).partition(" ")[0] for figure in asked]  # their intervals: bench table
        words = [begun[:16], str(path), one.label, one.task, *[one.protocol] * unlike]
        table.add_row(*words, str(one.readings), *figures)
    plain_console().print(table)
    for remark in remarks:
        typer.echo(f"remark  {printable(remark)}", err=True)


def _number(value: float | None) -> str:
    if value is None:
        return "later"
    return str(value) if isinstance(value, int) else f"{value:.4f}"
