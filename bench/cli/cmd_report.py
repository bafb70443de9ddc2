"""`bench report`: write a report of runs as one page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
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
    from tactsim.bench.report.collect import check_folder
    from tactsim.bench.report.write import write_report
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
