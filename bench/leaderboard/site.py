"""Write a leaderboard as a static site: pages that open from a disk, pictures, CSV, and the bundles themselves."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import shlex
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import quote

from tactsim.bench.leaderboard import drawings, figure_words, solved
from tactsim.bench.leaderboard.bundle import record_path
from tactsim.bench.leaderboard.ranking import LEVEL
from tactsim.bench.leaderboard.standings import Entrant, Folder, Standings
from tactsim.bench.pages import render
from tactsim.bench.places import check_new_folder
from tactsim.bench.results import csv_text
from tactsim.core.errors import counted
from tactsim.core.files import KeptBeside, new_folder, write_bytes, write_text

Key = TypeVar("Key")
_ASSETS = "leaderboard/assets/"
_SCRIPTS = ("report/assets/sorting.js", f"{_ASSETS}tables.js")
_STYLES = ("report/assets/page.css", f"{_ASSETS}leaderboard.css")
_MARK = "made-by-bench-leaderboard.txt"  # a folder with this file may be replaced
_LEAD = (
    "Ways to recognise an object by touch, on frozen tasks: which object is it, and where, after a few readings of a "
    "tactile pad. All methods of a task got the same readings in the same trials."
)
FIGURES = ("task", "task_data", "method", "estimator", "file", "status", "rank_best", "rank_worst", "figure", "value",
           "low", "high", "trials", "scans")  # fmt: skip
PAIRS = ("task", "task_data", "method", "other", "accuracy", "only_method_right", "only_other_right", "mcnemar_p",
         "error", "difference", "difference_low", "difference_high", "bootstrap_p")  # fmt: skip


def check_out(out: Path) -> None:
    """Raise InputError unless a site can be made at `out`: in a new folder, or in the place of a site."""
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
    pages = _names("tasks", {(of.task, of.data): _task_slug(of) for of in folder.standings})
    entered: dict[str, list[tuple[Standings, Entrant]]] = {}
    for of in folder.standings:
        for one in (*of.ranked, *of.unranked):
            entered.setdefault(one.bundle.method, []).append((of, one))
    entered = dict(sorted(entered.items()))
    links = _names("methods", {method: method for method in entered})
    files = {one: f"bundles/{quote(one.path.name)}" for one in folder.entrants}
    tables = {"Every figure, as CSV": "figures.csv", "Every pair of methods, as CSV": "pairs.csv"}

    (inside / "bundles").mkdir()
    for one in folder.entrants:
        for path in (one.path, record_path(one.path)) if one.check else (one.path,):
            shutil.copyfile(path, inside / "bundles" / path.name)
    write_text(inside / "figures.csv", csv_text(FIGURES, _figures(folder.standings)))
    write_text(inside / "pairs.csv", csv_text(PAIRS, _pairs(folder.standings)))

    def page(name: str, template: str, title: str, lead: str, **context: Any) -> None:
        text = render(
            f"{_ASSETS}{template}.html", scripts=_SCRIPTS, styles=_STYLES, title=title, lead=lead,
            home="../" if "/" in name else "", version=version("tactsim"), words=figure_words, drawings=drawings,
            pages=pages, links=links, files=files, **context,
        )  # fmt: skip
        write_text(inside / name, text)

    for of in folder.standings:
        name = pages[of.task, of.data]
        pictures, drawn = _pictures(of, inside / "pictures" / Path(name).stem)
        bundles = {one.label: files[one] for one in (*of.ranked, *of.unranked)}
        machines = dict.fromkeys(_machine(one) for one in of.ranked)
        lead = of.known.line if of.known else f"Another version's task or data: {of.data}"
        page(
            name, "task", of.task, lead,
            of=of, pictures=pictures, offered=tables | drawn, bundles=bundles, machines=list(machines),
            level=f"{LEVEL:g}",
        )  # fmt: skip
    for method, entries in entered.items():
        lead = counted(len(entries), "bundle")
        page(links[method], "method", method, lead, entries=entries, command=command, facts=_facts)
    known = [of for of in folder.standings if of.known and of.ranked]
    if known:
        charts = [("All tasks", None, known), *((of.task, of, [of]) for of in known)]
        page(
            "all/solved.html", "solved", "Targets solved", "Which share of all targets a method reaches, and how soon.",
            charts=[(name, of, _shown_solved(group)) for name, of, group in charts], targets=solved.TARGETS,
            count=len(known),
        )  # fmt: skip
    page("index.html", "index", "tactsim leaderboard", _LEAD, folder=folder, entered=entered, offered=tables)
    write_text(inside / _MARK, "A static site, made by `bench leaderboard`, which may replace this folder.\n")


def _pictures(of: Standings, stem: Path) -> tuple[dict[str, str], dict[str, str]]:
    """Draw run time against error: for the page by its light, and as files beside it, by what they are."""
    drawn = {scheme: drawings.time_picture(of, scheme) for scheme in ("light", "dark")}
    files = {"svg": drawn["light"], "png": drawings.time_picture(of, "light", "png")}
    offered = {}
    for kind, content in files.items():
        if content is not None:
            write_bytes(stem.with_name(f"{stem.name}.{kind}"), content)
            offered[f"Run time against error, as {kind.upper()}"] = f"pictures/{stem.name}.{kind}"
    return {scheme: _address(content) for scheme, content in drawn.items() if content is not None}, offered


def _shown_solved(standings: Sequence[Standings]) -> dict[str, str]:
    """Draw what has been solved of these tasks, for the page by its light."""
    lines = solved.solved(standings)
    return {scheme: _address(solved.picture(lines, scheme)) for scheme in ("light", "dark")}


def _address(svg: bytes) -> str:
    """Write a picture as an address that a page can name."""
    return f"data:image/svg+xml;base64,{base64.b64encode(svg).decode()}"


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
    bundle = one.bundle
    options = ", ".join(f"{name} {_option(value)}" for name, value in bundle.options.items())
    return {
        "estimator": bundle.estimator,
        "from": bundle.package or "tactsim itself",
        "options given": options or "none: the defaults",
        "described as": bundle.runs[0].about["description"] if bundle.runs else None,
        "reproducible": "yes: the same bits again"
        if bundle.reproducible
        else "no: within what chance allows",
        "made": bundle.made,
        "commit of tactsim": bundle.commit or "unknown",
        "hash of the source": bundle.source_hash,
        "hash of the readings": bundle.task_data,
        "versions": ", ".join(f"{name} {version}" for name, version in bundle.versions.items()),
        "checked": _checked(one),
        "machine": _machine(one),
    }


def _checked(one: Entrant) -> str:
    if one.check is None:
        return "not yet: unconfirmed"
    check = one.check
    chosen = "" if check.seed is None else f", with --seed {check.seed}"
    by = f"by commit {check.commit or 'unknown'} on {check.machine.processor}, {check.made}{chosen}"
    return f"{check.said}: {check.again} of {check.trials} trials were done again {by}"


def _machine(one: Entrant) -> str:
    machine = one.bundle.machine
    return f"{machine['processor']}, {machine['cores']} cores, {machine['system']}"


def _figures(standings: Iterable[Standings]) -> Iterator[Sequence[Any]]:
    """Give every figure of every method; a method without a score has one row with its status."""
    for of in standings:
        for one in (*of.ranked, *of.unranked):
            who = (of.task, of.data, one.bundle.method, one.bundle.estimator, one.path.name, one.status)
            if one.rank is None:
                yield *who, *[""] * (len(FIGURES) - len(who))
                continue
            counts = len(one.bundle.ids), len(one.bundle.runs)
            for figure in of.columns:
                found = one.figure(figure)
                yield *who, *one.rank, figure, found.value, found.low, found.high, *counts
            yield *who, *one.rank, "ms", one.ms_per_reading, None, None, *counts


def _pairs(standings: Iterable[Standings]) -> Iterator[Sequence[Any]]:
    """Give the comparison of every pair of ranked methods."""
    for of in standings:
        for one in of.pairs:
            yield (
                of.task, of.data, one.first.label, one.second.label, of.accuracy_by, one.won, one.lost, one.accuracy_p,
                of.error_by, one.difference, one.low, one.high, one.error_p,
            )  # fmt: skip


def _task_slug(of: Standings) -> str:
    return of.task if of.known else f"{of.task}-{of.data[:12]}"


def _names(folder: str, words: Mapping[Key, str]) -> dict[Key, str]:
    """Name a page for each key after its words, in signs that are safe in a path, no two alike."""
    found: dict[Key, str] = {}
    for key, text in words.items():
        name = re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")[:60]
        if not name or f"{folder}/{name}.html" in found.values():
            name = f"{name}-{hashlib.sha256(text.encode()).hexdigest()[:12]}".strip("-")
        found[key] = f"{folder}/{name}.html"
    return found
