"""The page of a task: who is how good at it, who can be told apart from whom, and who has no score and why."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from xml.etree.ElementTree import Element

import numpy as np

from tactsim.bench.leaderboard import paper_rows
from tactsim.bench.leaderboard.curve_drawing import swatch
from tactsim.bench.leaderboard.figure_words import MISSING, cell, chance, heading, rank
from tactsim.bench.leaderboard.markup import block, h, scrolling
from tactsim.bench.leaderboard.paper_rows import PaperRow
from tactsim.bench.leaderboard.ranking import LEVEL
from tactsim.bench.leaderboard.standings import Entrant, Standings

SEEN = (1, 2, 3, 5, 10, 20)  # readings after which accuracy is shown, and the last
SEEN_OF_ERROR = (10, 20)


def columns(of: Standings) -> list[str]:
    """List the figures of a task's table: what ranks, accuracy, error, error over bound, and what else is scored."""
    last = of.readings
    if not last:  # a task of another version, with which nobody was done
        return []
    accuracy = [f"accuracy@{at}" for at in sorted({*(k for k in SEEN if k < last), last})]
    error = [f"error_mm@{at}" for at in sorted({*(k for k in SEEN_OF_ERROR if k < last), last})]
    return list(dict.fromkeys([of.by, *accuracy, *error, f"efficiency@{last}", *of.scored]))


def task_page(
    of: Standings, links: Mapping[str, str], pictures: Mapping[str, bytes], downloads: Element
) -> list[Element]:
    """Make the parts of the page.

    links: the page of each method. pictures: run time against error, "light" and "dark", as SVG.
    """
    parts = [
        block(
            "Standings",
            h("p", {"class": "hint"}, _reading_it(of)),
            scrolling("Standings", standings_table(of, links)),
            _paper_note() if _paper(of) else None,
        )
    ]
    if len(of.ranked) > 1:
        table = scrolling("Each against the next", neighbours_table(of))
        parts.append(block("Each against the next", h("p", {"class": "hint"}, _comparing(of)), table))
    if pictures:
        words = f"Processor time of a reading against placement error on {of.task}"
        drawn = scrolling("Run time against error", _picture(pictures, words))
        parts.append(block("Run time against error", drawn, h("p", {"class": "hint"}, _timing(of))))
    parts.append(block("Downloads", downloads))
    return parts


def standings_table(of: Standings, links: Mapping[str, str]) -> Element:
    """Make the table of a task: ranked methods, the paper's rows, and those that have no score with their status."""
    figures = columns(of)
    heads = ["method", "rank", *map(heading, figures), "ms a reading", "checked"]
    rows = [_ranked_row(of, one, figures, links) for one in of.ranked]
    rows += [_paper_row(row, figures) for row in _paper(of)]
    rows += [
        h("tr", {"class": "none"}, _name(one, links), h("td", {"class": "rank"}, MISSING),
          h("td", {"colspan": f"{len(figures) + 2}"}, f"no score: {one.status}"))
        for one in of.unranked
    ]  # fmt: skip
    body = h("tbody", {}, *rows)
    return h("table", {"class": "wide standings sortable"}, _head(heads), body)


def _ranked_row(of: Standings, one: Entrant, figures: list[str], links: Mapping[str, str]) -> Element:
    assert one.rank is not None
    ms = one.ms_per_reading
    return h(
        "tr", {}, _name(one, links),
        h("td", {"class": "rank", "data-value": f"{of.ranked.index(one)}"}, rank(one.rank)),
        *(cell(one.figure(figure), figure) for figure in figures),
        h("td", {"class": "number", "data-value": f"{ms:.9g}"}, f"{ms:.3g}"),
        h("td", {"class": "words"}, check_tag(one)),
    )  # fmt: skip


def check_tag(one: Entrant) -> Element:
    """Say whether trials were done again, and what came of it."""
    if not one.confirmed:
        why = "" if one.check is None else one.check.said
        return h("span", {"class": "tag", "title": why}, "unconfirmed")
    assert one.check is not None
    how = "the same" if one.check.exact else "within the tolerance"
    again = f"{one.check.again} of {one.check.trials} trials, {how}"
    by = f"by commit {(one.check.commit or 'unknown')[:12]}, {one.check.made[:10]}"
    return h("span", {"class": "tag good", "title": f"{one.check.said}; {by}"}, f"done again: {again}")


def _name(one: Entrant, links: Mapping[str, str]) -> Element:
    return h(
        "th", {"scope": "row", "data-value": one.label}, swatch(one.number),
        h("a", {"href": f"../{links[one.bundle.method]}"}, one.label),
    )  # fmt: skip


def _paper(of: Standings) -> tuple[PaperRow, ...]:
    return paper_rows.ROWS if of.known is not None and of.task == paper_rows.TASK else ()


def _paper_row(row: PaperRow, figures: list[str]) -> Element:
    cells = []
    for figure in figures:
        name, _, at = figure.partition("@")
        value = row.accuracy_after(int(at)) if name == "accuracy" else None
        cells.append(h("td", {"class": "number"}, MISSING if value is None else f"{value:.2f}"))
    return h(
        "tr", {"class": "paper"}, h("th", {"scope": "row"}, row.method), h("td", {"class": "rank"}, MISSING),
        *cells, h("td", {"class": "number"}, MISSING), h("td", {"class": "words"}, "read from the paper"),
    )  # fmt: skip


def _paper_note() -> Element:
    words = (
        "In italics: what the paper's text states, for five real letters and 50 trials. An accuracy stands from the "
        "reading on after which the text states it. It was not measured here, and is neither ranked nor compared:"
    )
    rows = [h("li", {}, f"{row.method}: {row.where}.") for row in paper_rows.ROWS]
    return h("div", {"class": "hint"}, h("p", {}, words), h("ul", {}, *rows))


def neighbours_table(of: Standings) -> Element:
    """Compare each method with the next in the ranking: trials won and lost, and the difference in error."""
    heads = [
        "better placed", "next", f"{heading(of.accuracy_by)}: won, lost", "McNemar's p",
        f"{heading(of.error_by)}: difference", "bootstrap's p", "verdict",
    ]  # fmt: skip
    rows = [
        h("tr", {}, h("th", {"scope": "row"}, swatch(one.number), one.label), *_against(of, number))
        for number, one in enumerate(of.ranked[:-1])
    ]
    return h("table", {"class": "wide"}, _head(heads), h("tbody", {}, *rows))


def _against(of: Standings, i: int) -> list[Element]:
    """Compare the method at place i with the next, a cell each."""
    accuracies, errors, j = of.accuracies, of.errors, i + 1
    difference, low, high = (values[i, j] for values in (errors.difference, errors.low, errors.high))
    known = bool(np.isfinite(difference))
    told = (accuracies if of.by == of.accuracy_by else errors).p[i, j] <= LEVEL
    verdict = h("span", {"class": "tag good" if told else "tag"}, "told apart" if told else "tie")
    return [
        h("td", {"class": "words"}, swatch(of.ranked[j].number), of.ranked[j].label),
        h("td", {"class": "number"}, f"{accuracies.wins[i, j]}, {accuracies.wins[j, i]}"),
        h("td", {"class": "number"}, chance(accuracies.p[i, j])),
        h("td", {"class": "number"}, f"{difference:+.2f}", h("small", {}, f"{low:+.2f} to {high:+.2f}"))
        if known
        else h("td", {"class": "number"}, MISSING),
        h("td", {"class": "number"}, chance(errors.p[i, j]) if known else MISSING),
        h("td", {"class": "words"}, verdict),
    ]


def _head(heads: list[str]) -> Element:
    kinds = dict.fromkeys(("method", "checked", "next", "better placed", "verdict"), "words") | {
        "rank": "rank"
    }
    cells = (h("th", {"scope": "col", "class": kinds.get(one, "number")}, one) for one in heads)
    return h("thead", {}, h("tr", {}, *cells))


def _picture(pictures: Mapping[str, bytes], words: str) -> Element:
    light, dark = (
        f"data:image/svg+xml;base64,{base64.b64encode(pictures[scheme]).decode()}"
        for scheme in ("light", "dark")
    )
    return h(
        "picture", {}, h("source", {"media": "(prefers-color-scheme: dark)", "srcset": dark}),
        h("img", {"class": "time", "src": light, "alt": words}),
    )  # fmt: skip


def _reading_it(of: Standings) -> str:
    if not of.ranked:
        return "No method has a score."
    scans = len(of.ranked[0].bundle.runs)
    return (
        f"Ranked by {heading(of.by)}; {of.trials} trials in {scans} scans. A range of ranks, such as 1–3, is what the "
        "tests leave open: methods whose ranges overlap cannot all be told apart. Small: 95 % intervals over scans and "
        "trials. A click on a heading sorts."
    )


def _comparing(of: Standings) -> str:
    pairs = len(of.ranked) * (len(of.ranked) - 1) // 2
    corrected = (
        f"p values are corrected for all {pairs} pairs of this table, not only for those shown: McNemar's exact test "
        "by Holm's method, the bootstrap over scans and trials by its largest studentised difference. "
    )
    return (
        "All methods saw the same trials, and are compared trial by trial. Won: trials that only the first has right; "
        f"lost: only the next. {corrected if pairs > 1 else ''}A pair is told apart where p is at most {LEVEL:g} in "
        "the figure that ranks, else it is a tie. McNemar's test asks about the scans of this task; the bootstrap "
        "also about the next scan, of which five scans say only so much. The interval of a difference is uncorrected; "
        "below 0 the first is better."
    )


def _timing(of: Standings) -> str:
    machines = dict.fromkeys(
        f"{one.bundle.machine['processor']}, {one.bundle.machine['cores']} cores, {one.bundle.machine['system']}"
        for one in of.ranked
    )
    several = "Times of different machines do not compare. " if len(machines) > 1 else ""
    return (
        f"Processor time of a reading (its update, its estimate and its choice): median over the trials. {several}"
        f"Measured on: {'; '.join(machines)}. Bars: 95 % intervals."
    )
