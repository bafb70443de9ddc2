"""Write a report: the page, the pictures and the curves beside it."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from tactsim.bench.report.collect import collect, find
from tactsim.bench.report.curves import tables
from tactsim.bench.report.page import page
from tactsim.bench.report.pareto import has_curves
from tactsim.bench.report.recognition import replay_all
from tactsim.bench.results import load
from tactsim.bench.run import Run
from tactsim.bench.runner import silent
from tactsim.bench.trials import Progress
from tactsim.core import InputError
from tactsim.core.files import write_text


def write_report(
    paths: Iterable[Path], out: Path, *, progress: Progress = silent
) -> tuple[list[Path], list[str]]:
    """Make the report of the runs and sweeps in these folders; returns what `write_pages` does.

    Raises InputError for a path that holds no run, for a damaged run, or if `out` cannot be written.
    """
    folders, remarks = find(paths)
    return write_pages([(folder, load(folder)) for folder in folders], out, remarks, progress=progress)


def write_pages(
    runs: Iterable[tuple[Path, Run]], out: Path, remarks: Iterable[str] = (), *, progress: Progress = silent
) -> tuple[list[Path], list[str]]:
    """Make the report of runs, each with the folder that it is known by, at `out`.

    Returns all files written, the page first, and remarks on what is missing, `remarks` first; the page has
    them too. Beside FILE.html stand FILE-readings.csv and so on; for report.html plain readings.csv.
    Raises InputError if `out` cannot be written.
    """
    if out.is_dir():
        raise InputError(f"cannot write {out}: it is a folder; name a file in it")
    groups = collect(runs)
    replayed, failed = replay_all(groups, progress=progress)
    remarks = [*remarks]
    remarks += [f"no trial of {label} could be done again: {why}" for label, why in failed.items()]
    prefix = "" if out.stem == "report" else f"{out.stem}-"
    written = [out]
    for name, content in tables(groups, replayed).items():
        written.append(out.with_name(f"{prefix}{name}.csv"))
        write_text(written[-1], content)
    with_curves = [group for group in groups if has_curves(group)]
    for number, group in enumerate(with_curves, start=1):
        from tactsim.bench.report.picture import pareto_figure, readings_figure, save

        for name, draw in (("pareto", pareto_figure), ("readings", readings_figure)):
            figure = draw(group)
            for kind in ("png", "svg"):
                place = out.with_name(f"{prefix}{name}{'' if number == 1 else f'-{number}'}.{kind}")
                save(figure, place)
                written.append(place)
    moving = next((one.scan for one in replayed if one.scan.sequence is not None), None)
    if moving is not None:
        from tactsim.bench.report.picture import save
        from tactsim.bench.report.press_picture import press_figure

        for kind in ("png", "svg"):
            written.append(out.with_name(f"{prefix}press.{kind}"))
            save(press_figure(moving), written[-1])
    write_text(out, page(groups, replayed, remarks))
    return written, remarks
