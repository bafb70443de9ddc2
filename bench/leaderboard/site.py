"""Write a leaderboard as a static site: one page that opens from a disk, every figure as CSV, and the bundles."""

from __future__ import annotations

import json
import shlex
import shutil
from collections.abc import Iterable, Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any
from urllib.parse import quote

from markupsafe import Markup
from matplotlib.axes import Axes

from tactsim.bench.columns import csv_text
from tactsim.bench.leaderboard.bundle import DONE, record_path
from tactsim.bench.leaderboard.ranking import LEVEL, rank_words
from tactsim.bench.leaderboard.standings import Entrant, Folder, Standings
from tactsim.bench.pages import render
from tactsim.bench.places import check_new_folder
from tactsim.bench.report.curves import frontier
from tactsim.bench.report.picture import alone, draw_frontier, look
from tactsim.bench.runs.figures import plain_log
from tactsim.bench.runs.pooled import cell
from tactsim.bench.runs.tables import heading
from tactsim.core.errors import InputError
from tactsim.core.files import KeptBeside, new_folder, write_text

_ASSETS = "leaderboard/assets/"
_MARK = "made-by-bench-leaderboard.txt"  # a folder with this file may be replaced
_LONGEST = 34  # characters of a label in a legend
FIGURES = ("task", "task_data", "method", "estimator", "file", "status", "rank_best", "rank_worst", "figure", "value",
           "low", "high", "trials", "scans")  # fmt: skip


def check_out(out: Path) -> None:
    """Raise InputError unless a site can be made at `out`: in a new folder, or in the place of a site."""
    if out.suffix == ".html":
        raise InputError(f"{out}: a site is a folder, with index.html and all bundles; give its name")
    if not (out / _MARK).is_file():
        check_new_folder(out)


def write_site(folder: Folder, out: Path) -> None:
    """Write the site to `out`, whole or not at all; a site that was made before is replaced.

    Raises InputError as `check_out` does, or if `out` cannot be written.
    """
    check_out(out)
    if not out.exists() or not any(out.iterdir()):
        with new_folder(out) as inside:
            _write(folder, inside)
        return
    out = out.resolve()  # of a link, or the working folder, it has a name
    made, before = (out.with_name(f".{out.name}.{word}") for word in ("new", "before"))
    for left in (made, before):  # by one that was killed
        shutil.rmtree(left, ignore_errors=True)
    with new_folder(made) as inside:
        _write(folder, inside)
    try:
        out.rename(before)
        made.rename(out)
    except OSError as error:
        raise KeptBeside(out, error, made) from error
    shutil.rmtree(before, ignore_errors=True)


def _write(folder: Folder, inside: Path) -> None:
    (inside / "bundles").mkdir()
    for one in folder.entrants:
        for path in (one.path, record_path(one.path)) if one.check else (one.path,):
            shutil.copyfile(path, inside / "bundles" / path.name)
    write_text(inside / "figures.csv", csv_text(FIGURES, _figures(folder.standings)))
    page = render(
        f"{_ASSETS}page.html",
        scripts=("report/assets/sorting.js",),
        styles=("report/assets/page.css", f"{_ASSETS}leaderboard.css"),
        title="tactsim leaderboard", version=version("tactsim"), folder=folder, level=f"{LEVEL:g}",
        heading=heading, cell=cell, rank=rank_words, drawn=time_picture, command=command, facts=_facts,
        place=lambda one: f"bundles/{quote(one.path.name)}",
        machines=lambda of: list(dict.fromkeys(_machine(one) for one in of.ranked)),
    )  # fmt: skip
    write_text(inside / "index.html", page)
    write_text(inside / _MARK, "A static site, made by `bench leaderboard`, which may replace this folder.\n")


def time_picture(of: Standings) -> Markup | None:
    """Draw processor time against error, as SVG in the page's colours; None if no method has an error."""
    if of.ranking is None:
        return None
    by = of.ranking.error_by
    found = [(one, one.ms_per_reading, one.figure(by)) for one in of.ranked]
    points = [(one, ms, error, error.value) for one, ms, error in found if error.value and ms > 0]
    if not points:
        return None
    first = frontier([ms for _, ms, _, _ in points], [value for *_, value in points])

    def draw(axes: Axes) -> None:
        for one, ms, error, value in points:
            colour, marker = look(one.number)
            if error.low is not None and error.high is not None:
                axes.plot([ms, ms], [max(error.low, 1e-9), error.high], color=colour, lw=0.9)
            label = one.label if len(one.label) <= _LONGEST else f"{one.label[: _LONGEST - 1]}…"
            axes.plot([ms], [value], ls="", marker=marker, ms=7, color=colour, label=label)
        corners = [(ms, value) for (_, ms, _, value), best in zip(points, first, strict=True) if best]
        draw_frontier(axes, corners)
        axes.set(xscale="log", yscale="log", xlabel="processor time of a reading, ms", ylabel=heading(by))
        for axis in (axes.xaxis, axes.yaxis):
            plain_log(axis)
        axes.margins(0.08)
        axes.figure.legend(loc="outside right upper", frameon=False, fontsize=9)

    words = f"Processor time of a reading against placement error on {of.task}"
    size = 9, max(4.2, 0.21 * len(points) + 0.6)
    return alone(draw, f"time-{of.task}", words, size)


def command(one: Entrant) -> str:
    """Write the command that does these trials again; every name in it is quoted for a shell."""
    bundle = one.bundle
    words = ["bench", "submit", bundle.task, "--estimator", bundle.estimator, "--title", bundle.method]
    for name, value in bundle.options.items():
        words += ["--set", f"{name}={_option(value)}"]
    words += [] if bundle.reproducible else ["--not-reproducible"]
    return shlex.join([*words, "--out", one.path.name])


def _option(value: Any) -> str:
    """Write the value of an option as `--set` reads it."""
    if value is None:
        return "none"
    return value if isinstance(value, str) else json.dumps(value)


def _facts(one: Entrant) -> dict[str, str | None]:
    """Say what ran, where and with which code."""
    bundle, check = one.bundle, one.check
    options = ", ".join(f"{name} {_option(value)}" for name, value in bundle.options.items())
    return {
        "estimator": f"{bundle.estimator}, from {bundle.package or 'tactsim itself'}",
        "options given": options or "none: the defaults",
        "described as": bundle.runs[0].about["description"] if bundle.runs else None,
        "reproducible": "yes: the same bits" if bundle.reproducible else "no: within what chance allows",
        "made": f"{bundle.made}, at commit {bundle.commit or 'unknown'}",
        "hash of the source": bundle.source_hash,
        "hash of the readings": bundle.task_data,
        "versions": ", ".join(f"{name} {version}" for name, version in bundle.versions.items()),
        "checked": f"{check.said} ({check.made}, commit {check.commit or 'unknown'})" if check else "not yet",
        "machine": _machine(one),
    }


def _machine(one: Entrant) -> str:
    machine = one.bundle.machine
    return f"{machine.processor}, {machine.cores} cores, {machine.system}"


def _figures(standings: Iterable[Standings]) -> Iterator[Sequence[Any]]:
    """Give every figure of every method; a method without a score has one row with its status."""
    for of in standings:
        for one in (*of.ranked, *of.unranked):
            who = (of.task, of.data, one.bundle.method, one.bundle.estimator, one.path.name, one.status)
            if one.status != DONE:
                yield *who, *[""] * (len(FIGURES) - len(who))
                continue
            counts = len(one.pooled.ids), len(one.bundle.runs)
            for figure in of.columns:
                found = one.figure(figure)
                yield *who, *(one.rank or ("", "")), figure, found.value, found.low, found.high, *counts
            yield *who, *(one.rank or ("", "")), "ms", one.ms_per_reading, None, None, *counts
