"""The pictures of a report as files, for a README, a paper or a slide."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator

from tactsim.bench.report.curves import Point, axis_of_errors, below_bound, machine_line, points
from tactsim.bench.runs import paper
from tactsim.bench.runs.figures import as_bytes, plain_log
from tactsim.bench.runs.pooled import Group
from tactsim.core.errors import counted
from tactsim.core.files import write_bytes

# One colour and one marker a method, in order; the page (assets/page.css and charts.js) uses the same.
COLOURS = (
    "#1f6fb2", "#c8501c", "#0b8a63", "#7b4fb3", "#b8407f", "#8a6800", "#0c7f8a", "#5f6670",
    "#7a0c14", "#1d5e14", "#27339b", "#7a0f74", "#8874b4", "#304254", "#3f86f2", "#5c8a00",
)  # fmt: skip
DASHES = ("-", (0, (5, 3)), (0, (1.5, 2)), (0, (6, 2, 1.5, 2)), (0, (1, 2)))
CROWD = 12  # runs beyond which curves would hide each other: then only each method's largest budget is drawn
LONGEST_LABEL = 48  # characters of a method in a legend
MARKERS = ("o", "s", "D", "^", "v", "P", "h", "p")
WIDTH = 7.16  # inches: both columns of a page of the IEEE
_TYPE: dict[Any, Any] = {
    "font.size": 8.0,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
}
# Of the axes of `pareto_figure`, about what a digit of a note is wide, a line high, and half a mark in both.
_LETTER, _LINE, _MARK = 0.0225, 0.048, (0.012, 0.014)

# The same for a dark ground.
DARK_COLOURS = (
    "#66b0ee", "#f58f5c", "#44c99a", "#b795ee", "#ee86b9", "#d9b648", "#4fc6d3", "#a9b2be",
    "#a39c38", "#b5f2d3", "#7687f0", "#e2596c", "#36989e", "#f3cdf3", "#bd68bd", "#f4e34a",
)  # fmt: skip


def look(number: int, scheme: str = "light") -> tuple[str, str]:
    """Choose the colour and the marker of a method by its number; 128 methods all look different."""
    colours = DARK_COLOURS if scheme == "dark" else COLOURS
    return colours[number % len(COLOURS)], MARKERS[(number + number // len(COLOURS)) % len(MARKERS)]


def save(figure: Figure, path: Path) -> None:
    """Write a figure in the format that the path's ending names, without a date: equal figures, equal files."""
    write_bytes(path, as_bytes(figure, path.suffix.removeprefix("."), dpi=250))


@mpl.rc_context(_TYPE)
def pareto_figure(group: Group) -> Figure:
    """Draw every method's curve over its budget: time per recognition against error and readings needed."""
    found = points(group)
    figure = Figure(figsize=(WIDTH, 3.9), layout="constrained", facecolor="white")
    left, right = figure.subplots(1, 2)
    late = group.readings * 1.35  # where the runs are drawn that have not settled
    left_notes, right_notes = list[_Note](), list[_Note]()
    for number, method in enumerate(group.methods):
        mine = [point for point in found if point.entry.method == method]
        colour, marker = look(number)
        style = {"color": colour, "marker": marker, "ms": 6, "lw": 1.4, "label": method}
        placed = [point for point in mine if point.error is not None]
        left.plot([1e3 * p.seconds for p in placed], [p.error for p in placed], **style)
        for p in placed:
            left.plot([1e3 * p.seconds] * 2, [p.low, p.high], color=colour, lw=0.8)
        right.plot([1e3 * p.seconds for p in mine], [p.settled or late for p in mine], **style)
        for p in mine:
            ends = p in (mine[0], mine[-1])
            if p.error is not None and (ends or p.error_frontier):
                left_notes.append(_Note(p, p.error, colour, p.error_frontier))
            if p.settled is not None and (ends or p.settled_frontier):
                right_notes.append(_Note(p, p.settled, colour, p.settled_frontier))
    _frontier(left, [(p.seconds, p.error) for p in found if p.error_frontier and p.error is not None])
    _frontier(right, [(p.seconds, p.settled) for p in found if p.settled_frontier and p.settled is not None])

    left.set(yscale="log", ylabel=f"placement error after {group.readings} readings, mm")
    plain_log(left.yaxis)
    ticks = [tick for tick in (1, 2, 3, 4, 5, 7, 10, 15, 20, 30, 40, 60, 100) if tick <= group.readings]
    never = any(point.settled is None for point in found)
    right.set(yscale="log", ylabel="readings until 95 % stay right")
    right.yaxis.set_major_locator(FixedLocator([*ticks, late] if never else ticks))
    right.yaxis.set_major_formatter(
        FuncFormatter(lambda value, _: "later" if value > group.readings else f"{value:g}")
    )
    right.yaxis.set_minor_locator(NullLocator())
    for axes in (left, right):
        axes.set(xscale="log", xlabel=f"processor time of a recognition of {group.readings} readings, ms")
        plain_log(axes.xaxis)
        axes.grid(which="major", lw=0.4, alpha=0.6)
        axes.spines[["top", "right"]].set_visible(False)
        axes.margins(0.08)
    _write(left, left_notes, [(1e3 * p.seconds, p.error) for p in found if p.error is not None])
    _write(right, right_notes, [(1e3 * p.seconds, p.settled or late) for p in found])
    _legend(figure, left.lines)
    _caption(
        figure,
        group,
        "Thick grey: the frontier. Bars: 95 % interval of the mean.\n"
        f"Time: median over the trials, on {machine_line(group.entries)}.",
    )
    return figure


@mpl.rc_context(_TYPE)
def readings_figure(group: Group) -> Figure:
    """Draw accuracy and error of all runs against readings seen, with bands: the paper's figures 6 and 7."""
    figure = Figure(figsize=(WIDTH, 3.6), layout="constrained", facecolor="white")
    left, right = figure.subplots(1, 2)
    least, most = axis_of_errors(group)
    noted: list[Line2D] = []
    for number, method in enumerate(group.methods):
        mine = [entry for entry in group.entries if entry.method == method]
        budgets = 1 if len(group.entries) > CROWD else len(DASHES)
        for rank, entry in enumerate(mine[::-1][:budgets]):  # the largest budget is the solid line
            style = {"color": look(number)[0], "lw": 1.5, "label": entry.label}
            style["ls"] = DASHES[rank]
            seen, summary = np.arange(1, entry.readings + 1), entry.summary
            error, low, high = (
                np.maximum(least, np.array(curve, dtype=float))
                for curve in (summary["error_mm"], *entry.error_band)
            )
            for axes, curve, below, above in (
                (left, summary["accuracy"], summary["accuracy_low"], summary["accuracy_high"]),
                (right, error, low, high),
            ):
                axes.fill_between(seen, below, above, color=style["color"], alpha=0.1, lw=0)
                axes.plot(seen, curve, **style)
            printed = paper.in_figure(entry.run)
            if printed is not None and printed.readings <= entry.readings:
                fill, edge = (style["color"], "black") if rank == 0 else ("white", style["color"])
                left.plot(
                    printed.readings, printed.share, marker="*", ms=13, mfc=fill, mec=edge, ls="none", clip_on=False,
                    zorder=5, label=f"the paper, {printed.amount:,} {printed.option}",
                )  # fmt: skip
            if printed is not None and printed.error is not None:
                label = f"the paper: {printed.error:g} mm ({printed.amount:,} {printed.option})"
                noted.append(right.axhline(printed.error, color="black", lw=0.9, ls=":", label=label))
    bounded = next((entry for entry in group.entries if any(entry.against_bound["bound_mm"])), None)
    if bounded is not None:
        bound = np.array(bounded.against_bound["bound_mm"], dtype=float)
        noted += right.plot(
            np.arange(1, len(bound) + 1), bound, color="black", lw=1, ls=(0, (5, 3)), label="Cramer-Rao bound"
        )
    left.set(ylim=(0, 1.02), ylabel="share of trials right")
    right.set(yscale="log", ylim=(least, most), ylabel="placement error, mm")
    plain_log(right.yaxis)
    for axes in (left, right):
        axes.xaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
        axes.set(xlim=(1, max(2, *(entry.readings for entry in group.entries))), xlabel="readings seen")
        axes.grid(which="major", lw=0.4, alpha=0.6)
        axes.spines[["top", "right"]].set_visible(False)
    _legend(figure, [*left.lines, *noted])  # above: within the plot it would hide a curve
    _caption(
        figure,
        group,
        "\n".join(["Error where the letter is right. Bands: 95 % intervals.", *below_bound(group)]),
    )
    return figure


def _legend(figure: Figure, lines: Sequence[Line2D]) -> None:
    # Matplotlib leaves out what begins with an underscore, as a method of `__main__` does.
    named = [(line, str(line.get_label())) for line in lines]
    handles = [line for line, label in named if not label.startswith("_child")]
    labels = [
        (" " if label.startswith("_") else "")
        + (textwrap.shorten(label, LONGEST_LABEL, placeholder="…") or label[:LONGEST_LABEL])
        for _, label in named
        if not label.startswith("_child")
    ]
    columns = min(3 if max(map(len, labels)) > 24 else 4, len(labels))
    rows = -(-len(labels) // columns)
    figure.set_figheight(figure.get_figheight() + 0.19 * max(0, rows - 6))  # inches: the plots keep theirs
    figure.legend(handles, labels, loc="outside upper center", ncols=columns, frameon=False, fontsize=8)


def _caption(figure: Figure, group: Group, text: str) -> None:
    trials, scans = (
        counted(numbers[-1], what) if numbers[0] == numbers[-1] else f"{numbers[0]} to {numbers[-1]} {what}s"
        for numbers, what in (
            (sorted(len(entry.trials.truth) for entry in group.entries), "trial"),
            (sorted(len(entry.runs) for entry in group.entries), "scan"),
        )
    )
    letters = len(group.entries[0].run.about["letters"])
    task = "" if group.task == "defaults" else f"{group.task}; "
    caption = f"{task}{letters} letters, {trials} of {scans}, {group.protocol}. {text}"
    figure.supxlabel(
        "\n".join(part for line in caption.split("\n") for part in textwrap.wrap(line, 140)),
        fontsize=7,
        color="#444444",
    )


def _frontier(axes: Axes, corners: list[tuple[float, float]]) -> None:
    corners.sort()
    axes.plot(
        [1e3 * seconds for seconds, _ in corners], [loss for _, loss in corners],
        color="#999999", lw=7, alpha=0.35, solid_capstyle="round", zorder=0, drawstyle="steps-post",
    )  # fmt: skip


@dataclass(frozen=True)
class _Note:
    """The budget of a point, to be written beside its mark. first: whether it goes before others if room is short."""

    point: Point
    height: float
    colour: str
    first: bool


def _write(axes: Axes, notes: list[_Note], marks: list[tuple[float, float]]) -> None:
    """Write budgets beside their marks, right or left, above or below; where there is no room, leave them out."""
    shares = axes.transLimits.transform(axes.transScale.transform(marks))
    taken = [tuple(box) for box in np.hstack([shares - _MARK, shares + _MARK])]  # left, low, right, high
    for note in sorted(notes, key=lambda note: not note.first):
        budget = note.point.entry.budget
        if not budget:
            continue
        place = (1e3 * note.point.seconds, note.height)
        x, y = axes.transLimits.transform(axes.transScale.transform(place))
        wide = _LETTER * len(budget.text)
        for side, up in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
            left, low = x + (0.015 if side > 0 else -0.015 - wide), y + (0.012 if up > 0 else -0.012 - _LINE)
            box = left, low, left + wide, low + _LINE
            if not any(
                box[0] < old[2] and old[0] < box[2] and box[1] < old[3] and old[1] < box[3] for old in taken
            ):
                taken.append(box)
                axes.annotate(
                    budget.text, place, xytext=(5 * side, 4 * up), textcoords="offset points", fontsize=7,
                    color=note.colour, ha="left" if side > 0 else "right", va="bottom" if up > 0 else "top",
                    bbox={"fc": "white", "ec": "none", "alpha": 0.75, "pad": 0.3},
                )  # fmt: skip
                break
