"""Write a report: find its runs, and make the page, the pictures and the curves beside it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from tactsim.bench.config import RunConfig
from tactsim.bench.cramer_rao import bounds_of_trials
from tactsim.bench.experiment import silent
from tactsim.bench.kinds import PLANE
from tactsim.bench.plane import NO_BOUND
from tactsim.bench.report import Pages, Sheet, check_page, is_report
from tactsim.bench.report.curves import COLUMNS, has_curves, tables
from tactsim.bench.report.page import page
from tactsim.bench.report.recognition import readings_of, replay_all
from tactsim.bench.results import Run
from tactsim.bench.runs.pooled import Group, collect
from tactsim.bench.runs.saved import load, sweep_order
from tactsim.bench.trials import Progress
from tactsim.core import InputError, Scan
from tactsim.core.checking import checked
from tactsim.core.files import write_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_KINDS = ("png", "svg", "pdf")


def write_report(
    paths: Iterable[Path],
    out: Path,
    *,
    progress: Progress = silent,
    sheet: Sheet = Sheet(),  # noqa: B008  (frozen)
) -> tuple[list[Path], list[str]]:
    """Make the report of the runs and sweeps in these folders; returns what `write_pages` does.

    Raises InputError for a path that holds no run, for a damaged run, or if `out` cannot be written.
    """
    folders, remarks = find(paths)
    runs = [(folder, load(folder)) for folder in folders]
    return write_pages(runs, out, remarks, progress=progress, sheet=sheet)


def write_pages(
    runs: Iterable[tuple[Path, Run]],
    out: Path,
    remarks: Iterable[str] = (),
    *,
    progress: Progress = silent,
    sheet: Sheet = Sheet(),  # noqa: B008  (frozen)
) -> tuple[list[Path], list[str]]:
    """Make the report of runs, each with the folder that it is known by, at `out`.

    Runs that differ in the seed alone are shown as one.
    Returns all files written, the page first, and remarks on what is missing, `remarks` first; the page has
    them too. Beside FILE.html stand FILE-readings.csv and so on; for report.html plain readings.csv.
    What an older report left there is replaced. Raises InputError if `out` cannot be written, or if something else
    stands where a file of the report would.
    """
    if out.is_dir():
        raise InputError(f"cannot write {out}: it is a folder; name a file in it")
    runs = list(runs)
    several = list(dict.fromkeys(run.kind.name for _, run in runs))
    if len(several) > 1:
        raise InputError(f"a report is of runs of one kind, and these are {' and '.join(several)}; make two")
    if sheet != Sheet() and several != [PLANE]:
        raise InputError("--width, --panel and --no-caption are of letters in the plane; leave them out")
    return runs[0][1].kind.page(Pages(runs, out, list(remarks), progress, sheet))


def write_plane_pages(of: Pages) -> tuple[list[Path], list[str]]:
    """Make the report of runs with letters in the plane; see `write_pages`."""
    out = of.out
    scans: dict[str, Scan] = {}
    bounded = ((folder, _with_bounds(run, scans)) for folder, run in of.runs)
    groups = collect(bounded)
    prefix = "" if out.stem == "report" else f"{out.stem}-"
    pictures = _pictures(groups)
    _check_beside(out, prefix, [names for names, *_ in pictures])
    replayed, failed = replay_all(groups, scans, progress=of.progress)
    remarks = [*of.remarks]
    for label, run in ((entry.label, entry.run) for group in groups for entry in group.entries):
        remarks += [f"{label}: {line}" for line in run.cautions]
    remarks += [f"no trial of {label} could be done again: {why}" for label, why in failed.items()]
    written = [out]
    for name, content in tables(groups, replayed).items():
        written.append(out.with_name(f"{prefix}{name}.csv"))
        write_text(written[-1], content)
    from tactsim.bench.report.picture import save

    for names, draw, group in pictures:
        figure = draw(group, of.sheet)
        for name in names:
            written.append(out.with_name(f"{prefix}{name}"))
            save(figure, written[-1])
    write_text(out, page(groups, replayed, remarks))
    return written, remarks


def _with_bounds(run: Run, scans: dict[str, Scan]) -> Run:
    """Work out the bound of a run's error where the run was not asked for it and its readings can be had again."""
    if run.bounds is not None or run.about.get("no_bound") != NO_BOUND:
        return run
    try:
        scan = run.plan.scan if run.plan else readings_of(run, scans)
        config = checked(RunConfig, run.config, "run")
    except InputError:
        return run
    if scan.digest != run.about["readings_digest"]:  # another version of tactsim presses otherwise
        return run
    bounds, _ = bounds_of_trials(scan, run.trials, config.explore, config.moving)
    return replace(run, bounds=bounds)


def _pictures(groups: Sequence[Group]) -> Sequence[tuple[list[str], Callable[[Group, Sheet], Figure], Group]]:
    """List the pictures of a report: the names of their files, what draws them, and of which section.

    Where no method has several budgets there is no PNG: the folder of a run has a readings.png of its own.
    """
    from tactsim.bench.report.picture import pareto_figure, readings_figure

    pictures = []
    for number, group in enumerate(groups, start=1):
        kinds = _KINDS if has_curves(group) else _KINDS[1:]
        drawn = [("pareto", pareto_figure)] * has_curves(group) + [("readings", readings_figure)]
        for name, draw in drawn:
            section = name if number == 1 else f"{name}-{number}"
            pictures.append(([f"{section}.{kind}" for kind in kinds], draw, group))
    return pictures


def _check_beside(out: Path, prefix: str, pictures: Sequence[Sequence[str]]) -> None:
    """Raise InputError if a file stands where one of a report would be, and no report stands there.

    pictures: names of files.
    """
    check_page(out)
    if is_report(out):
        return
    names = [f"{name}.csv" for name in COLUMNS]
    names += [name for of_one in pictures for name in of_one]
    for place in (out.with_name(f"{prefix}{name}") for name in names):
        if place.exists():
            raise InputError(
                f"{place} is of no report and would be replaced; move it, or name another page, which names the rest"
            )


def find(paths: Iterable[Path]) -> tuple[list[Path], list[str]]:
    """List the folders of runs: each path is one, or holds them, or is a sweep with runs/ below it.

    Returns them, a sweep's in its own order, and a remark on every sweep that has not ended.
    Raises InputError for a path that is none of these.
    """
    found: dict[Path, Path] = {}
    remarks = []
    for path in paths:
        folders = _runs_of(path)
        for folder in folders:
            found.setdefault(folder.resolve(), folder)
        if (path / "sweep.json").is_file():
            asked = sweep_order(path)
            if len(folders) < len(asked):
                remarks.append(f"{path} has not ended: {len(folders)} of its {len(asked)} runs are there")
    return list(found.values()), remarks


def check_folder(path: Path) -> None:
    """Raise InputError unless a folder stands at `path`, as of a run or a sweep."""
    if not path.is_dir():
        why = "it is no folder" if path.exists() else "there is no such folder"
        raise InputError(f"{path}: {why}; name folders of runs or of a sweep")


def _runs_of(path: Path) -> list[Path]:
    if (path / "run.json").is_file():
        return [path]
    check_folder(path)
    holder = path / "runs" if (path / "runs").is_dir() else path
    # A name with a dot in front is a run that is being written.
    inside = sorted(entry for entry in holder.iterdir() if entry.is_dir() and not entry.name.startswith("."))
    if holder == path:  # where other things may lie, too
        inside = [folder for folder in inside if (folder / "run.json").is_file()]
    if not any((folder / "run.json").is_file() for folder in inside):
        raise InputError(f"{path} is neither the folder of a run nor of a sweep: no run.json there or below")
    if (path / "sweep.json").is_file():
        order = sweep_order(path)
        inside.sort(key=lambda folder: order.get(folder.name, len(order)))
    return inside
