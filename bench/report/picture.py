"""The picture of time against error, as a file for a README, a paper or a slide."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter, NullLocator

from bench.report.collect import Group
from bench.report.pareto import Point, machine_line, points
from models.files import write_bytes

# One colour and one marker a method, in order; the page uses the same.
COLOURS = ("#1f6fb2", "#c8501c", "#0b8a63", "#7b4fb3", "#b8407f", "#9a7400", "#0f8a94", "#5f6670")
MARKERS = ("o", "s", "D", "^", "v", "P", "h", "X")


def save(figure: Figure, path: Path) -> None:
    """Write a figure as its name's ending says, without a date: equal figures are equal files."""
    content = BytesIO()
    kind = path.suffix.removeprefix(".")
    with mpl.rc_context({"svg.hashsalt": "tactsim"}):
        figure.savefig(
            content, format=kind, dpi=200, metadata={"Date": None} if kind == "svg" else {"Software": None}
        )
    write_bytes(path, content.getvalue())


def pareto_figure(group: Group) -> Figure:
    """Draw every method's curve over its budget: time per recognition against error and readings needed."""
    found = points(group)
    figure = Figure(figsize=(10, 5.0), layout="constrained", facecolor="white")
    left, right = figure.subplots(1, 2)
    late = group.readings * 1.35  # where the runs are drawn that have not settled
    for number, method in enumerate(group.methods):
        mine = [point for point in found if point.entry.method == method]
        colour = COLOURS[number % len(COLOURS)]
        style = {
            "color": colour, "marker": MARKERS[number % len(MARKERS)], "ms": 6, "lw": 1.4, "label": method,
        }  # fmt: skip
        placed = [point for point in mine if point.error is not None]
        left.plot([1e3 * p.seconds for p in placed], [p.error for p in placed], **style)
        for p in placed:
            left.plot([1e3 * p.seconds] * 2, [p.low, p.high], color=colour, lw=0.8)
        right.plot([1e3 * p.seconds for p in mine], [p.settled or late for p in mine], **style)
        for p in mine:
            ends = p in (mine[0], mine[-1])
            if p.error is not None and (ends or p.error_frontier):
                _note(left, p, p.error, colour)
            if p.settled is not None and (ends or p.settled_frontier):
                _note(right, p, p.settled, colour)
    _frontier(left, [(p.seconds, p.error) for p in found if p.error_frontier and p.error is not None])
    _frontier(right, [(p.seconds, p.settled) for p in found if p.settled_frontier and p.settled is not None])

    left.set(yscale="log", ylabel=f"placement error after {group.readings} readings, mm")
    left.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    left.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    left.yaxis.set_minor_formatter(NullFormatter())
    ticks = [tick for tick in (1, 2, 3, 4, 5, 7, 10, 15, 20, 30, 40, 60, 100) if tick <= group.readings]
    never = any(point.settled is None for point in found)
    right.set(yscale="log", ylabel="readings until 95 % of the trials are and stay right")
    right.yaxis.set_major_locator(FixedLocator([*ticks, late] if never else ticks))
    right.yaxis.set_major_formatter(
        FuncFormatter(lambda value, _: "later" if value > group.readings else f"{value:g}")
    )
    right.yaxis.set_minor_locator(NullLocator())
    for axes in (left, right):
        axes.set(xscale="log", xlabel=f"processor time of a recognition of {group.readings} readings, ms")
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.grid(which="major", lw=0.4, alpha=0.6)
        axes.spines[["top", "right"]].set_visible(False)
        axes.margins(0.08)
    handles, labels = left.get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside upper center", ncols=min(4, len(labels)), frameon=False, fontsize=9
    )
    trials = len(found[0].entry.run.trials.truth)
    letters = len(found[0].entry.run.about["letters"])
    task = "" if group.task == "defaults" else f"{group.task}; "
    figure.supxlabel(
        f"{task}{letters} letters, {trials} trials a point, {group.protocol}. "
        "Thick grey: the frontier. Bars: 95 % interval of the mean.\n"
        f"Time: median over the trials, on {machine_line(group.entries)}.",
        fontsize=8, color="#444444",
    )  # fmt: skip
    return figure


def _frontier(axes: Axes, corners: list[tuple[float, float]]) -> None:
    corners.sort()
    axes.plot(
        [1e3 * seconds for seconds, _ in corners], [loss for _, loss in corners],
        color="#999999", lw=7, alpha=0.35, solid_capstyle="round", zorder=0, drawstyle="steps-post",
    )  # fmt: skip


def _note(axes: Axes, point: Point, height: float, colour: str) -> None:
    """Write the budget beside a mark."""
    if point.entry.budget:
        axes.annotate(
            point.entry.budget.text, (1e3 * point.seconds, height), xytext=(6, 5),
            textcoords="offset points", fontsize=8, color=colour,
        )  # fmt: skip
