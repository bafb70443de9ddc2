"""Write a leaderboard as a static site: pages that open from a disk, pictures, CSV, and the bundles themselves."""

from __future__ import annotations

import hashlib
import re
import shutil
from collections.abc import Iterable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import TypeVar
from urllib.parse import quote
from xml.etree.ElementTree import Element

from tactsim.bench.leaderboard.bundle import record_path
from tactsim.bench.leaderboard.index_page import index_page
from tactsim.bench.leaderboard.markup import h, html
from tactsim.bench.leaderboard.method_page import method_page
from tactsim.bench.leaderboard.rows import figures_csv, pairs_csv
from tactsim.bench.leaderboard.standings import Folder, Standings
from tactsim.bench.leaderboard.task_page import task_page
from tactsim.bench.leaderboard.time_picture import time_picture
from tactsim.bench.places import check_new_folder
from tactsim.bench.whole_page import whole_page
from tactsim.core.errors import counted
from tactsim.core.files import KeptBeside, new_folder, write_bytes, write_text

Key = TypeVar("Key")
_ASSETS = "leaderboard/assets/"
_STYLES = ("report/assets/page.css", f"{_ASSETS}leaderboard.css")
_MARK = "made-by-bench-leaderboard.txt"  # a folder with this file may be replaced


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
    links = _names(
        "methods", {method: method for method in sorted({one.bundle.method for one in folder.entrants})}
    )
    files = {one: f"bundles/{quote(one.path.name)}" for one in folder.entrants}
    (inside / "bundles").mkdir()
    for one in folder.entrants:
        for path in (one.path, record_path(one.path)) if one.check else (one.path,):
            shutil.copyfile(path, inside / "bundles" / path.name)
    write_text(inside / "figures.csv", figures_csv(folder.standings))
    write_text(inside / "pairs.csv", pairs_csv(folder.standings))
    for of in folder.standings:
        name = pages[of.task, of.data]
        parts = _of_task(of, name, links, files, inside)
        _page(
            inside / name,
            of.task,
            of.known.line if of.known else f"Another version's task or data: {of.data}",
            parts,
        )
    for method, name in links.items():
        entries = [
            (of, one)
            for of in folder.standings
            for one in (*of.ranked, *of.unranked)
            if one.bundle.method == method
        ]
        _page(inside / name, method, f"{counted(len(entries), 'bundle')}", method_page(entries, pages, files))
    downloads = _list({"Every figure, as CSV": "figures.csv", "Every pair of methods, as CSV": "pairs.csv"})
    parts = index_page(folder, pages, links, downloads)
    _page(inside / "index.html", "tactsim leaderboard", _LEAD, parts)
    write_text(inside / _MARK, "A static site, made by `bench leaderboard`, which may replace this folder.\n")


_LEAD = (
    "Ways to recognise an object by touch, on frozen tasks: which object is it, and where, after a few readings of a "
    "tactile pad. All methods of a task got the same readings in the same trials."
)


def _of_task(
    of: Standings, name: str, links: Mapping[str, str], files: Mapping, inside: Path
) -> list[Element]:
    pictures = {scheme: time_picture(of, scheme) for scheme in ("light", "dark")}
    drawn = {scheme: picture for scheme, picture in pictures.items() if picture is not None}
    offered = {"Every figure, as CSV": "../figures.csv", "Every pair of methods, as CSV": "../pairs.csv"}
    if drawn:
        stem = Path(name).stem
        write_bytes(inside / "pictures" / f"{stem}.svg", drawn["light"])
        write_bytes(inside / "pictures" / f"{stem}.png", time_picture(of, "light", "png") or b"")
        offered |= {
            f"Run time against error, as {kind.upper()}": f"../pictures/{stem}.{kind}"
            for kind in ("svg", "png")
        }
    bundles = _list({one.label: f"../{files[one]}" for one in (*of.ranked, *of.unranked)})
    more = h("details", {}, h("summary", {}, "The bundles: every estimate of every trial"), bundles)
    return task_page(of, links, drawn, h("div", {}, _list(offered), more))


def _page(path: Path, title: str, lead: str, parts: Iterable[Element]) -> None:
    home = "" if path.name == "index.html" else "../"
    way = h("nav", {}, h("a", {"href": f"{home}index.html"}, "Leaderboard"), f" / {title}") if home else None
    content = html(
        h(
            "header",
            {},
            *([way] if way is not None else []),
            h("div", {"class": "title"}, h("h1", {}, title), h("p", {}, lead)),
        ),
        h("main", {"id": "content", "tabindex": "-1"}, *parts),
        h("footer", {}, f"Made by tactsim {version('tactsim')}, bench leaderboard."),
    )
    scripts = [f"{_ASSETS}sorting.js"]
    write_text(path, whole_page(f"{_ASSETS}leaderboard.html", scripts, _STYLES, title=title, content=content))


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


def _list(offered: Mapping[str, str]) -> Element:
    return h(
        "ul",
        {},
        *(h("li", {}, h("a", {"href": place, "download": ""}, words)) for words, place in offered.items()),
    )
