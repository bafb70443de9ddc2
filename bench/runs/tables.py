"""Tables of pooled runs: a row for each method, a column for each figure, as Markdown, LaTeX or CSV."""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Iterator, Sequence

from tactsim.bench.columns import csv_text
from tactsim.bench.kinds import PLANE
from tactsim.bench.results import Run
from tactsim.bench.runs.pooled import Pooled, cell, figure_of, metric_of
from tactsim.bench.score import CURVES
from tactsim.core.errors import counted

_SHOWN = (1, 2, 3, 5, 7, 10, 15, 20, 30, 40, 60, 100, 150)  # readings that a small table shows
Rows = Sequence[Sequence[str]]
# What of a text means something to LaTeX, and how it is written there.
_LATEX = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": "$<$",
    ">": "$>$",
}
_LATEX |= {character: f"\\{character}" for character in "&%$#_{}"}


def usual_figures(pools: Sequence[Pooled]) -> list[str]:
    """Choose the figures of a table that nobody asked for others: right after 1 and 5, and the error at the end."""
    last = min(one.readings for one in pools)
    return [*dict.fromkeys(f"accuracy@{min(k, last)}" for k in (1, 5)), "settled_95", f"error_mm@{last}"]


def plain_rows(
    pools: Sequence[Pooled], figures: Sequence[str], ranks: Sequence[str] | None = None
) -> list[list[str]]:
    """Write a row for each pool, figures with their intervals; what all of them share is in no column.

    ranks: of the pools, a column in front. Raises InputError for an unknown figure or a reading that the runs do not
    have.
    """
    marks = [("protocol", [one.protocol for one in pools]), ("condition", [one.task for one in pools])]
    shown = [(name, values) for name, values in marks if len(set(values)) > 1]
    rows = [
        [
            "method",
            *(name for name, _ in shown),
            *(heading(figure, pools[0].run.kind.name) for figure in figures),
        ]
    ]
    for number, one in enumerate(pools):
        cells = [cell(one, figure) for figure in figures]
        rows.append([one.label, *(values[number] for _, values in shown), *cells])
    if ranks is None:
        return rows
    return [[first, *row] for first, row in zip(["rank", *ranks], rows, strict=True)]


def heading(figure: str, kind: str = PLANE) -> str:
    """Say in words what a figure such as accuracy@5 is."""
    name, _, at = figure.partition("@")
    return (metric_of(name, kind).heading or f"{name} after {{}}").format(at.replace(",", ", "))


def scans_and_trials(pools: Sequence[Pooled]) -> str:
    """Say of how many scans and trials the figures of a table are."""
    scans = sorted({len(one.runs) for one in pools})
    trials = sorted({len(one.trials.truth) for one in pools})
    counts = [" or ".join(map(str, of[:-1])) + " or " * (len(of) > 1) for of in (scans, trials)]
    return f"{counts[0]}{counted(scans[-1], 'scan')}, {counts[1]}{counted(trials[-1], 'trial')}"


def made_of(pools: Sequence[Pooled]) -> str:
    """Say of what a table's figures and intervals are, and how many bins were made of those asked for."""
    over = "scans and trials" if any(len(one.runs) > 1 for one in pools) else "trials of one scan"
    fewer = {
        f"; {one.budget.text} bins: {made[1]} in equal steps"
        for one in pools
        if one.budget and (made := re.search(r"= ([\d,]+) bins", one.run.about["description"]))
        if made[1] != one.budget.text
    }
    return f"{scans_and_trials(pools)}; in brackets 95 % intervals over {over}{''.join(sorted(fewer))}"


def meaning(pools: Sequence[Pooled]) -> list[str]:
    """Say what the figures of a table are of and mean, and with which code they were made."""
    made = dict.fromkeys(
        f"tactsim {run.about['versions']['tactsim']}, commit {run.about['commit'] or 'unknown'}"
        for one in pools
        for run in one.runs
    )
    return [
        made_of(pools),
        "settled by: from there on so many of the trials are right; later: not by the last reading",
        *made,
    ]


def markdown_table(rows: Rows) -> str:
    """Lay out rows, of which the first are the heads, as a table of Markdown."""
    head, *body = ["| " + " | ".join(row) + " |\n" for row in rows]
    return head + "|" + "---|" * len(rows[0]) + "\n" + "".join(body)


def latex_table(rows: Rows, notes: Sequence[str] = ()) -> str:
    """Lay out rows, of which the first are the heads, as a tabular of LaTeX with the rules of booktabs.

    notes: comments above it, so that what the figures mean stays with them.
    """
    head, *body = [" & ".join(map(_in_latex, row)) + r" \\" for row in rows]
    lines = [
        *(f"% {note}" for note in notes),
        r"% needs \usepackage{booktabs}",
        rf"\begin{{tabular}}{{l{'r' * (len(rows[0]) - 1)}}}",
        r"\toprule",
        head,
        r"\midrule",
        *body,
        r"\bottomrule",
        r"\end{tabular}",
    ]
    return "\n".join(lines) + "\n"


def _in_latex(text: str) -> str:
    escaped = "".join(_LATEX.get(character, character) for character in text)
    # A minus as such: as a hyphen it melts into the dash of an interval, and -2 to -1 reads as -2 to 1.
    signed = re.sub(r"(?<!\w)-(?=\d)", "$-$", escaped)
    return re.sub(r"(?<=\d)-(?=\d|later|\$-)", "--", signed)  # an interval


def csv_table(pools: Sequence[Pooled], figures: Sequence[str], ranks: Sequence[str] | None = None) -> str:
    """Write a row for each pool as CSV, every figure as a number with the ends of its interval, empty where unknown.

    Raises InputError as `plain_rows` does.
    """
    who = (
        "protocol", "condition", "estimator", "method", "budget_option", "budget", "seeds", "trials", "readings",
    )  # fmt: skip
    numbers = [f"{figure}{end}" for figure in figures for end in ("", "_low", "_high")]
    rows = []
    first = [[rank] for rank in ranks] if ranks else [[]] * len(pools)
    for rank, one in zip(first, pools, strict=True):
        found = [figure_of(one, figure) for figure in figures]
        rows.append(
            [
                *rank, one.protocol, one.task, one.run.estimator, one.method, *(one.budget or ("", "", ""))[::2],
                one.seeds, len(one.trials.truth), one.readings,
                *(part for figure in found for part in (figure.value, figure.low, figure.high)),
            ]
        )  # fmt: skip
    return csv_text([*(["rank"] if ranks else []), *who, *numbers], rows)


def in_notebook(run: Run) -> str:
    """Show a run in a notebook, as HTML: what was tried, a small table and the curves."""
    picture = base64.b64encode(run.plot().png(dpi=70)).decode()
    rows = "".join(f"<tr><td>{'</td><td>'.join(cells)}</td></tr>" for cells in _cells(run))
    words = (run.kind.touches, CURVES["accuracy"].column, "95 % interval", CURVES["error_mm"].column)
    heads = "".join(f"<th>{word}</th>" for word in words)
    return (
        f"<div><p><b>{html.escape(run.estimator)}</b> {html.escape(run.asked[len(run.estimator) :])}<br/>"
        f"{html.escape(run.outcome)}</p>"
        f"<div style='display:flex;gap:2em;align-items:flex-start'>"
        f"<table style='text-align:right'><thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table>"
        f"<img alt='accuracy and error against readings' src='data:image/png;base64,{picture}'/></div></div>"
    )


def _cells(run: Run) -> Iterator[tuple[str, ...]]:
    """Write some rows of the table over the reading count."""
    names = ("accuracy", "accuracy_low", "accuracy_high", "error_mm")
    for reading in sorted({row for row in (*_SHOWN, run.readings) if row <= run.readings}):
        accuracy, low, high, error = (run.summary[name][reading - 1] for name in names)
        shown = "" if error is None else f"{error:.2f}"
        yield str(reading), f"{accuracy:.3f}", f"{low:.3f} to {high:.3f}", shown
