"""The plots of a report: two pictures as files, for a paper or a slide, and each plot alone for the page."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from markupsafe import Markup, escape
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from tactsim.bench.report import Sheet
from tactsim.bench.report.curves import Point, axis_of_errors, below_bound, machine_line, points, reliability
from tactsim.bench.runs import paper
from tactsim.bench.runs.figures import (
    BLUE,
    COLOURS,
    FRONTIER,
    GRID,
    INK,
    NAMES,
    SOFT,
    Picture,
    as_bytes,
    draw_curve,
    over_readings,
    plain_log,
)
from tactsim.bench.runs.pooled import Group, Pooled
from tactsim.bench.score import rank_band, ranks
from tactsim.core.errors import InputError, counted
from tactsim.core.files import write_bytes
from tactsim.models import Letter

DASHES = ("-", (0, (5, 3)), (0, (1.5, 2)), (0, (6, 2, 1.5, 2)), (0, (1, 2)))
CROWD = 12  # runs beyond which curves would hide each other: then only each method's largest budget is drawn
LONGEST_LABEL = 48  # characters of a method in a legend
MARKERS = ("o", "s", "D", "^", "v", "P", "h", "p")
_COLUMN = 5  # inches, below which panels stand above each other
_ALONE = (4.2, 2.8)  # inches of a plot on the page, which stretches it
_TYPE: dict[Any, Any] = {
    "font.size": 8.0, "text.parse_math": False, "axes.linewidth": 0.6, "xtick.major.width": 0.6,
    "ytick.major.width": 0.6, "grid.linewidth": 0.6, "axes.spines.top": False, "axes.spines.right": False,
}  # fmt: skip
_ON_A_PAGE = _TYPE | {"grid.color": GRID, "figure.facecolor": "none", "axes.facecolor": "none"} | dict.fromkeys(
    ("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color"), SOFT
)  # fmt: skip
# Of the axes of `pareto_figure`, about what a digit of a note is wide, a line high, and half a mark in both.
_LETTER, _LINE, _MARK = 0.0225, 0.048, (0.012, 0.014)


def look(number: int) -> tuple[str, str]:
    """Choose the colour and the marker of a method by its number; 128 methods all look different."""
    return COLOURS[number % len(COLOURS)], MARKERS[(number + number // len(COLOURS)) % len(MARKERS)]


def save(figure: Figure, path: Path) -> None:
    """Write a figure in the format that the path's ending names, without a date: equal figures, equal files."""
    write_bytes(path, as_bytes(figure, path.suffix.removeprefix("."), dpi=250))


@mpl.rc_context(_ON_A_PAGE)
def alone(
    draw: Callable[[Axes], object], name: str, words: str, inches: tuple[float, float] | None = None
) -> Markup:
    """Draw one plot for a page, as SVG in the page's colours. name: unique in the page. words: what it shows.

    inches: how large, if more than a plot alone stands there.
    """
    figure = Figure(figsize=inches or _ALONE, layout="constrained" if inches else None)
    if not inches:  # to measure all texts for margins takes as long as to draw
        figure.subplots_adjust(left=0.11, right=0.97, bottom=0.15, top=0.96)
    axes = figure.subplots()
    axes.grid(which="major")
    draw(axes)
    return embedded(figure, name, words)


def plots(group: Group, name: str) -> dict[str, Markup]:
    """Draw all plots of a group for the page: {name of the plot: SVG}. name: of the group, unique in the page.

    What belongs to run i of the group has the class run-i.
    """
    sure = any(value is not None for entry in group.entries for value in entry.summary["coverage_90"])
    found: dict[str, tuple[Callable[..., object], str]] = {
        "share": (_draw_share, "Accuracy against readings seen"),
        "stated": (_draw_reliability, f"Reliability diagram of the {group.thing}'s probability"),
    }
    if group.places:
        found["error"] = (_draw_error, "Placement error against readings seen")
    if sure:
        found["held"] = (_draw_held, "Coverage of the 90 % regions against readings seen")
        found["ranks"] = (_draw_ranks, "Distribution of the ranks of the truth, less an even one")
    if len(group.entries) > 1:
        if any(point.error is not None for point in points(group)):
            found["time"] = (_draw_time, "Computing time against placement error")
        found["settled"] = (_draw_settled, "Computing time against readings needed")
    return {
        f"{name}-{plot}": alone(partial(draw, group=group), f"{name}-{plot}", words)
        for plot, (draw, words) in found.items()
    }


@mpl.rc_context(_TYPE)
def pareto_figure(group: Group, sheet: Sheet = Sheet()) -> Figure:  # noqa: B008  (frozen)
    """Draw every method's curve over its budget: time per recognition against error and readings needed."""
    figure, (left, right) = _panels(sheet, 2, 3.9)
    for axes, draw in ((left, _draw_time), (right, _draw_settled)):
        axes.grid(which="major", lw=0.4, alpha=0.6)
        draw(axes, group)
        axes.set_xlabel(f"processor time of a recognition of {group.readings} readings, ms")
    left.set_ylabel(f"placement error after {group.readings} readings, mm")
    right.set_ylabel("readings until 95 % stay right")
    _legend(figure, left.lines)
    if sheet.caption:
        bars = "Thick grey: the frontier. Bars: 95 % interval of the mean."
        _caption(figure, group, f"{bars}\nTime: median over the trials, on {machine_line(group.entries)}.")
    return figure


@mpl.rc_context(_TYPE)
def readings_figure(group: Group, sheet: Sheet = Sheet()) -> Figure:  # noqa: B008  (frozen)
    """Draw accuracy and error of all runs against readings seen, with bands: the paper's figures 6 and 7."""
    both = ("accuracy", "error") if group.places else ("accuracy",)
    shown = both if sheet.panel is None else (sheet.panel,)
    if not set(shown) <= set(both):
        raise InputError(f"there is no error to draw: no run places its {group.thing}s; leave --panel out")
    figure, panels = _panels(sheet, len(shown), 3.6)
    budgets = 1 if len(group.entries) > CROWD else len(DASHES)
    lines: list[Line2D] = []
    for axes, panel in zip(panels, shown, strict=True):
        axes.grid(which="major", lw=0.4, alpha=0.6)
        if panel == "accuracy":
            _draw_share(axes, group, budgets)
            axes.set_ylabel("share of trials right")
        else:
            noted = _draw_error(axes, group, budgets)
            axes.set_ylabel("placement error, mm")
        lines += noted if lines else axes.lines
    if sheet.panel == "error":
        lines = [line for line in lines if np.isfinite(np.asarray(line.get_ydata(), dtype=float)).any()]
    _legend(figure, lines)  # above: within the plot it would hide a curve
    if sheet.caption:
        of_error = [f"Error where the {group.thing} is right."] * ("error" in shown)
        notes = below_bound(group) if of_error else []
        _caption(figure, group, "\n".join([" ".join([*of_error, "Bands: 95 % intervals."]), *notes]))
    return figure


def _panels(sheet: Sheet, count: int, height: float) -> tuple[Figure, list[Axes]]:
    """Make a figure of one or two panels; height: inches of two beside each other on a sheet of the usual width."""
    beside = count if sheet.width >= _COLUMN else 1
    usual = beside == 2 and sheet.width == Sheet.width
    high = height if usual else 0.7 * sheet.width * count / beside**2
    figure = Figure(figsize=(sheet.width, high), layout="constrained", facecolor="white")
    return figure, figure.subplots(count // beside, beside, squeeze=False).ravel().tolist()


def _curves(group: Group, budgets: int = 128) -> Iterator[tuple[Pooled, int, dict[str, Any]]]:
    """Give the runs that are drawn, of each method so many budgets, how many are larger, and how its curve looks."""
    for number, method in enumerate(group.methods):
        mine = [(i, entry) for i, entry in enumerate(group.entries) if entry.method == method]
        for rank, (i, entry) in enumerate(mine[::-1][:budgets]):  # the largest budget is the solid line
            style = {"ls": DASHES[rank % len(DASHES)], "label": entry.label, "gid": f"run-{i}"}
            yield entry, rank, {"color": look(number)[0], **style}


def _over_all_readings(axes: Axes, group: Group) -> None:
    over_readings(axes, max(entry.readings for entry in group.entries))


def _draw_share(axes: Axes, group: Group, budgets: int = 128) -> None:
    for entry, rank, style in _curves(group, budgets):
        draw_curve(axes, entry.summary["accuracy"], *entry.band("accuracy"), **style)
        printed = paper.in_figure(entry.run)
        if printed is not None and printed.readings <= entry.readings:
            fill, edge = (style["color"], INK) if rank == 0 else ("white", style["color"])
            axes.plot(
                printed.readings, printed.share, marker="*", ms=13, mfc=fill, mec=edge, ls="none", clip_on=False,
                zorder=5, label=f"the paper, {printed.amount:,} {printed.option}", gid=style["gid"],
            )  # fmt: skip
    axes.set(ylim=(0, 1.02))
    _over_all_readings(axes, group)


def _draw_error(axes: Axes, group: Group, budgets: int = 128) -> list[Line2D]:
    """Draw errors; returns the lines that are no run's."""
    least, most = axis_of_errors(group)
    noted: list[Line2D] = []
    for entry, _, style in _curves(group, budgets):
        curves = (
            np.maximum(least, np.array(curve, dtype=float))
            for curve in (entry.summary["error_mm"], *entry.error_band)
        )
        draw_curve(axes, *curves, **style)
        printed = paper.in_figure(entry.run)
        if printed is not None and printed.error is not None:
            label = f"the paper: {printed.error:g} mm ({printed.amount:,} {printed.option})"
            line = {"color": INK, "lw": 0.9, "ls": ":", "label": label, "gid": style["gid"]}
            noted.append(axes.axhline(printed.error, **line))
    bounded = next((entry for entry in group.entries if any(entry.against_bound["bound_mm"])), None)
    if bounded is not None:
        bound = np.array(bounded.against_bound["bound_mm"], dtype=float)
        noted += draw_curve(axes, bound, color=INK, lw=1, ls=DASHES[1], label="Cramer-Rao bound")
    axes.set(yscale="log", ylim=(least, most))
    plain_log(axes.yaxis)
    _over_all_readings(axes, group)
    return noted


def _draw_held(axes: Axes, group: Group) -> None:
    axes.axhline(0.9, color=FRONTIER, lw=1.2, ls="--")
    for entry, _, style in _curves(group):
        draw_curve(axes, entry.summary["coverage_90"], **style)
    axes.set(ylim=(0, 1.02))
    _over_all_readings(axes, group)


def _draw_ranks(axes: Axes, group: Group) -> None:
    """Draw by how much more than an even share of the ranks, after the last reading, is below each rank.

    Within the band lie ranks of beliefs that are right, everywhere at once, in 95 of 100 runs (`score.rank_band`).
    """
    fewest = math.inf
    for entry, _, style in _curves(group):
        found = ranks(entry.scored, entry.readings - 1)
        if count := len(found):
            fewest = min(fewest, count)
            rank, share = np.repeat([0, *found, 1], 2), np.repeat(np.arange(count + 1) / count, 2)
            axes.plot(rank[1:-1], share - rank[1:-1], lw=1.2, **style)
    if fewest < math.inf:
        band = rank_band(int(fewest))
        axes.axhspan(-band, band, color=FRONTIER, alpha=0.25, lw=0)
    axes.axhline(0, color=FRONTIER, lw=1.2, ls="--")
    axes.set(xlim=(0, 1), xlabel="rank of the truth")


def _draw_reliability(axes: Axes, group: Group) -> None:
    """Draw what was stated against what came true; the larger a mark, the more estimates it stands for."""
    axes.axline((0, 0), slope=1, color=FRONTIER, lw=1.2, ls="--")
    of_runs = [
        (reliability(entry.trials), style, look(group.methods.index(entry.method))[1])
        for entry, _, style in _curves(group)
    ]
    most = max(one.count for found, *_ in of_runs for one in found)
    for found, style, marker in of_runs:
        stated, right, count = np.array([(one.probability, one.right, one.count) for one in found]).T
        axes.plot(stated, right, alpha=0.75, lw=1, **style)
        size = (3 + 8 * np.sqrt(count / most)) ** 2
        axes.scatter(
            stated, right, size, fc="none", ec=style["color"], lw=1.5, marker=marker, clip_on=False, zorder=3
        )
    axes.set(xlim=(0, 1.02), ylim=(0, 1.02), xlabel="probability stated")


def _draw_time(axes: Axes, group: Group) -> None:
    least, _ = axis_of_errors(group)
    placed = [(point, point.error) for point in points(group) if point.error is not None]
    found = [_Mark(point, max(error, least), point.error_frontier) for point, error in placed]
    for mark in found:
        colour = look(group.methods.index(mark.point.entry.method))[0]
        ends = [max(end or 0.0, least) for end in (mark.point.low, mark.point.high)]
        axes.plot([mark.place[0]] * 2, ends, color=colour, lw=0.8)
    _draw_points(axes, group, found)
    plain_log(axes.yaxis)


def _draw_settled(axes: Axes, group: Group) -> None:
    late = group.readings * 1.35  # where the runs are drawn that have not settled
    found = [_Mark(point, point.settled or late, point.settled_frontier) for point in points(group)]
    _draw_points(axes, group, found)
    ticks = [tick for tick in (1, 2, 3, 4, 5, 7, 10, 15, 20, 30, 40, 60, 100) if tick <= group.readings]
    never = any(mark.height == late for mark in found)
    axes.yaxis.set_major_locator(FixedLocator([*ticks, late] if never else ticks))
    axes.yaxis.set_major_formatter(
        FuncFormatter(lambda value, _: "later" if value > group.readings else f"{value:g}")
    )
    axes.yaxis.set_minor_locator(NullLocator())


@dataclass(frozen=True)
class _Mark:
    """Where a run is drawn: at its time and this height. best: whether it is on the frontier."""

    point: Point
    height: float
    best: bool

    @property
    def place(self) -> tuple[float, float]:
        """Give its processor time, ms, and its height."""
        return 1e3 * self.point.seconds, self.height


def _draw_points(axes: Axes, group: Group, found: Sequence[_Mark]) -> None:
    """Draw runs by their time, joined by method, with the frontier behind them and budgets beside them."""
    noted: list[tuple[_Mark, str]] = []
    for number, method in enumerate(group.methods):
        mine = [mark for mark in found if mark.point.entry.method == method]
        colour, marker = look(number)
        places = np.array([mark.place for mark in mine]).reshape(-1, 2).T
        axes.plot(*places, color=colour, marker=marker, ms=6, lw=1.4, label=method)
        noted += [(mark, colour) for mark in mine if mark.best or mark in (mine[0], mine[-1])]
    draw_frontier(axes, [mark.place for mark in found if mark.best])
    axes.set(xscale="log", yscale="log", xlabel="processor time of a recognition, ms")
    plain_log(axes.xaxis)
    axes.margins(0.08)
    _write(axes, noted, found)


def _legend(figure: Figure, lines: Sequence[Line2D]) -> None:
    # Matplotlib leaves out what begins with an underscore, as a method of `__main__` does.
    handles = [line for line in lines if not str(line.get_label()).startswith("_child")]
    labels = []
    for label in (str(line.get_label()) for line in handles):
        short = textwrap.shorten(label, LONGEST_LABEL, placeholder="…") or label[:LONGEST_LABEL]
        labels.append(f" {short}" if label.startswith("_") else short)
    width = figure.get_figwidth()
    of_column = (5 * max(map(len, labels)) + 40) / 72  # inches: 5 pt a letter at most, beside its line
    columns = max(1, min(int(width / of_column), 4, len(labels)))
    rows = -(-len(labels) // columns)
    more = 0.19 * max(0, rows - round(6 * width / Sheet.width))  # inches: the plots keep theirs
    figure.set_figheight(figure.get_figheight() + more)
    figure.legend(handles, labels, loc="outside upper center", ncols=columns, frameon=False, fontsize=8)


def _caption(figure: Figure, group: Group, text: str) -> None:
    trials, scans = (
        counted(numbers[-1], what) if numbers[0] == numbers[-1] else f"{numbers[0]} to {numbers[-1]} {what}s"
        for numbers, what in (
            (sorted(len(entry.trials.truth) for entry in group.entries), "trial"),
            (sorted(len(entry.runs) for entry in group.entries), "scan"),
        )
    )
    full = figure.get_figwidth() / Sheet.width
    tried = counted(len(group.entries[0].run.letters), group.thing)
    task = "" if group.task == "defaults" else f"{group.task}; "
    caption = f"{task}{tried}, {trials} of {scans}, {group.protocol}. {text}"
    lines = [part for line in caption.split("\n") for part in textwrap.wrap(line, int(140 * full))]
    if full < 1:  # the plots of a narrow figure keep their height
        figure.set_figheight(figure.get_figheight() + 0.13 * len(lines))
    figure.supxlabel("\n".join(lines), fontsize=7, color="#444444")


def _write(axes: Axes, noted: list[tuple[_Mark, str]], marks: Sequence[_Mark]) -> None:
    """Write budgets beside their marks, right or left, above or below; where there is no room, leave them out."""
    shares = axes.transLimits.transform(axes.transScale.transform([mark.place for mark in marks]))
    taken = [tuple(box) for box in np.hstack([shares - _MARK, shares + _MARK])]  # left, low, right, high
    noted.sort(key=lambda of: not of[0].best)  # the frontier's first, if room is short
    for mark, colour in noted:
        budget = mark.point.entry.budget
        if not budget:
            continue
        x, y = axes.transLimits.transform(axes.transScale.transform(mark.place))
        wide = _LETTER * len(budget.text)
        for side, up in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
            left, low = x + (0.015 if side > 0 else -0.015 - wide), y + (0.012 if up > 0 else -0.012 - _LINE)
            box = left, low, left + wide, low + _LINE
            if all(box[0] >= o[2] or o[0] >= box[2] or box[1] >= o[3] or o[1] >= box[3] for o in taken):
                taken.append(box)
                axes.annotate(
                    budget.text, mark.place, xytext=(5 * side, 4 * up), textcoords="offset points", fontsize=7,
                    gid="note", color=colour, ha="left" if side > 0 else "right", va="bottom" if up > 0 else "top",
                    bbox={"fc": "white", "ec": "none", "alpha": 0.75, "pad": 0.3},
                )  # fmt: skip
                break


def embedded(figure: Figure, name: str, words: str) -> Markup:
    """Give a figure as SVG for a page, without a style of its own, in the page's colours and type.

    name: unique in the page. words: what it shows, for who does not see it. An artist's gid becomes a class.
    """
    with mpl.rc_context({"svg.fonttype": "none"}):
        drawn = as_bytes(figure, "svg", salt=name).decode()
    drawn = drawn[drawn.index("<svg") :].partition(">")[2]
    view = f"0 0 {72 * figure.get_figwidth():g} {72 * figure.get_figheight():g}"
    drawn = re.sub(r"<(metadata|style|!--).*?(</\1>|-->)", "", drawn, flags=re.DOTALL)
    drawn = re.sub(
        r'<g id="(?:([a-z]+(?:-\d+)?)|[^"]*)"', lambda g: f'<g class="{g[1]}"' if g[1] else "<g", drawn
    )
    drawn = re.sub(r'style="([^"]*)"', _attributes, drawn)
    drawn = re.sub(r"(\d\.\d\d)\d+", r"\1", drawn)
    head = f'<svg class="plot" role="img" aria-label="{escape(words)}" viewBox="{view}">'
    return Markup(head + re.sub(r"\n\s*", "\n", drawn))


def _attributes(style: re.Match[str]) -> str:
    """Write a style as attributes, which a page's policy allows, with its colours by name."""
    pairs = dict(one.split(": ", 1) for one in style[1].strip("; ").split("; ") if one)
    font = pairs.pop("font", None)
    if font:
        pairs["font-size"] = re.findall(r"[\d.]+px", font)[0]
    return " ".join(f'{name}="{NAMES.get(value, value)}"' for name, value in pairs.items())


def draw_frontier(axes: Axes, corners: Iterable[tuple[float, float]]) -> None:
    """Draw behind all else what no point is at once left of and below."""
    axes.plot(
        *np.array(sorted(corners)).reshape(-1, 2).T, color=FRONTIER, lw=7, alpha=0.35, solid_capstyle="round",
        zorder=0, drawstyle="steps-post",
    )  # fmt: skip


def outlines_figure(letters: Sequence[Letter]) -> Picture:
    """Draw the outlines of shapes, mm in their own frames."""
    side = 2.6
    figure = Picture(figsize=(side * len(letters), side + 0.3), layout="constrained")
    for axes, letter in zip(figure.subplots(1, len(letters), squeeze=False)[0], letters, strict=True):
        # One path of all contours: holes are left out by the winding of their corners.
        path = Outline.make_compound_path(
            *(Outline(np.vstack([contour, contour[:1]]), closed=True) for contour in letter.contours)
        )
        axes.add_patch(PathPatch(path, facecolor=BLUE, alpha=0.35, edgecolor=BLUE, lw=1.2))
        axes.set_aspect("equal")
        axes.autoscale_view()
        left, low, right, high = letter.footprint.bounds()
        size = f"{right - left:.1f} x {high - low:.1f} mm"
        axes.set_title(f"{letter.name}\n{size}", fontsize=9, parse_math=False)
        axes.tick_params(labelsize=7)
        axes.set_xlabel("mm", fontsize=8)
    return figure
