"""The first page of a leaderboard: the tasks with who leads, the methods, what could not be read, how to join."""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree.ElementTree import Element

from tactsim.bench.leaderboard.bundle import DONE
from tactsim.bench.leaderboard.curve_drawing import swatch
from tactsim.bench.leaderboard.figure_words import MISSING, heading, rank, text_of
from tactsim.bench.leaderboard.markup import block, h, scrolling
from tactsim.bench.leaderboard.standings import Entrant, Folder, Standings

_NAMED = 3  # leading methods that are named


def index_page(
    folder: Folder, pages: Mapping[tuple[str, str], str], links: Mapping[str, str], downloads: Element
) -> list[Element]:
    """Make the parts of the page. pages: of the tasks, by name and data. links: of the methods."""
    known = [of for of in folder.standings if of.known]
    others = [of for of in folder.standings if not of.known]
    parts = [block("Tasks", _tasks(known, pages, links))] if known else []
    parts.append(block("Methods", _methods(folder, pages, links)))
    if others:
        words = (
            "Bundles of tasks that this version of tactsim does not have, or has with other data. They are compared "
            "among themselves only."
        )
        parts.append(
            block("Other versions of tasks", h("p", {"class": "hint"}, words), _tasks(others, pages, links))
        )
    if folder.unreadable:
        lines = [h("li", {}, f"{path.name}: {why}") for path, why in folder.unreadable]
        parts.append(block("Could not be read", h("ul", {"class": "remark"}, *lines)))
    parts += [block("How a method gets here", _joining()), block("Downloads", downloads)]
    return parts


def _tasks(
    standings: list[Standings], pages: Mapping[tuple[str, str], str], links: Mapping[str, str]
) -> Element:
    heads = ("task", "methods", "ahead", "best figure")
    rows = []
    for of in standings:
        unranked = h("small", {}, f"{len(of.unranked)} without a score") if of.unranked else None
        best = f"{heading(of.by)}: {text_of(of.ranked[0].figure(of.by), of.by)}" if of.ranked else MISSING
        about = h("small", {}, of.known.line if of.known else f"data {of.data[:12]}")
        name = h("th", {"scope": "row"}, h("a", {"href": pages[of.task, of.data]}, of.task), about)
        count = h("td", {"class": "number"}, f"{len(of.ranked)}", unranked)
        rows.append(h("tr", {}, name, count, _ahead(of, links), h("td", {"class": "words"}, best)))
    return _table("Tasks", heads, rows)


def _ahead(of: Standings, links: Mapping[str, str]) -> Element:
    """Name those who may be first: nobody is better beyond chance."""
    first = [one for one in of.ranked if one.rank is not None and one.rank[0] == 1]
    words: list[Element | str] = []
    for one in first[:_NAMED]:
        words += [
            ", " if words else "",
            swatch(one.number),
            h("a", {"href": links[one.bundle.method]}, one.label),
        ]
    if len(first) > _NAMED:
        words.append(f" and {len(first) - _NAMED} more")
    tied = h("small", {}, "cannot be told apart") if len(first) > 1 else None
    return h("td", {"class": "words"}, *words, tied)


def _methods(folder: Folder, pages: Mapping[tuple[str, str], str], links: Mapping[str, str]) -> Element:
    entered: dict[str, list[tuple[Standings, Entrant]]] = {method: [] for method in links}
    for of in folder.standings:
        for one in (*of.ranked, *of.unranked):
            entered[one.bundle.method].append((of, one))
    rows = []
    for method, entries in entered.items():
        places: list[Element | str] = []
        for of, one in entries:
            place = f"rank {rank(one.rank)} of {len(of.ranked)}" if one.status == DONE else one.status
            places += [
                ", " if places else "",
                h("a", {"href": pages[of.task, of.data]}, of.task),
                f": {place}",
            ]
        bundle = entries[0][1].bundle
        rows.append(
            h(
                "tr", {},
                h("th", {"scope": "row"}, swatch(entries[0][1].number), h("a", {"href": links[method]}, method)),
                h("td", {"class": "words about"}, bundle.package or "tactsim"),
                h("td", {"class": "words"}, *places),
            )
        )  # fmt: skip
    return _table("Methods", ("method", "from", "tasks"), rows)


def _joining() -> Element:
    steps = {
        "bench submit TASK --estimator NAME --out BUNDLE.zip": "runs the method and writes one file.",
        "bench verify BUNDLE.zip --record": "does some of its trials again, compares them, and says so beside it.",
        "bench leaderboard FOLDER": "makes this site of the folder that both are put into.",
    }
    return h("ol", {}, *(h("li", {}, h("code", {}, command), f" {what}") for command, what in steps.items()))


def _table(label: str, heads: tuple[str, ...], rows: list[Element]) -> Element:
    kinds = {"methods": "number", "from": "words about"}
    cells = (h("th", {"scope": "col", "class": kinds.get(one, "words")}, one) for one in heads)
    head = h("thead", {}, h("tr", {}, *cells))
    return scrolling(label, h("table", {"class": "wide"}, head, h("tbody", {}, *rows)))
