"""The drawings of a leaderboard: run time against error on a task; a method's mark and its curves over the readings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from tactsim.bench.leaderboard.figure_words import heading
from tactsim.bench.leaderboard.standings import Entrant, Standings
from tactsim.bench.report.pareto import frontier
from tactsim.bench.report.picture import COLOURS, look
from tactsim.bench.runs.figures import as_bytes, plain_log

SCHEMES = {"light": ("#ffffff", "#161b22", "#d9dee5"), "dark": ("#161b23", "#e8ecf2", "#2c3440")}
_IN_A_COLUMN = 24  # labels beside the picture


def ground_style(scheme: str) -> dict[Any, Any]:
    """Give the settings of matplotlib for a picture on a ground of `scheme`; labels are no formulas."""
    coloured = ("text.color", "axes.labelcolor", "xtick.color", "ytick.color", "axes.edgecolor")
    return {"text.parse_math": False, **dict.fromkeys(coloured, SCHEMES[scheme][1])}


def time_picture(of: Standings, scheme: str = "light", kind: str = "svg") -> bytes | None:
    """Draw the picture on a ground of `scheme`, as SVG or PNG without a date; None if no method has an error."""
    found = [(one, one.ms_per_reading, one.figure(of.error_by)) for one in of.ranked]
    points = [(one, ms, error, error.value) for one, ms, error in found if error.value and ms > 0]
    if not points:
        return None
    ground, _, line = SCHEMES[scheme]
    with mpl.rc_context(ground_style(scheme)):
        figure = Figure(
            figsize=(9, max(4.2, 0.21 * len(points) + 0.6)), layout="constrained", facecolor=ground
        )
        axes = figure.subplots()
        axes.set_facecolor(ground)
        for one, ms, error, value in points:
            colour, marker = look(one.number, scheme)
            if error.low is not None and error.high is not None:
                axes.plot([ms, ms], [max(error.low, 1e-9), error.high], color=colour, lw=0.9)
            axes.plot([ms], [value], ls="", marker=marker, ms=7, color=colour, label=shortened(one.label))
        first = frontier([ms for _, ms, _, _ in points], [value for *_, value in points])
        corners = sorted((ms, value) for (_, ms, _, value), best in zip(points, first, strict=True) if best)
        axes.plot(*zip(*corners, strict=True), color="#999999", lw=7, alpha=0.3, solid_capstyle="round", zorder=0,
                  drawstyle="steps-post")  # fmt: skip
        axes.set(
            xscale="log", yscale="log", xlabel="processor time of a reading, ms", ylabel=heading(of.error_by)
        )
        for axis in (axes.xaxis, axes.yaxis):
            plain_log(axis)
        axes.grid(which="major", lw=0.5, color=line)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
        axes.margins(0.08)
        figure.legend(
            loc="outside right upper", frameon=False, fontsize=9, ncols=1 + len(points) // _IN_A_COLUMN
        )
        return as_bytes(figure, kind, dpi=160)


def shortened(label: str, most: int = 34) -> str:
    """Cut a label that is too long for a legend."""
    return label if len(label) <= most else f"{label[: most - 1]}…"


def colour(number: int) -> str:
    """Name the class of a method's colour in the page's style."""
    return f"m{number % len(COLOURS)}"


def outline(number: int, r: float = 4.5) -> str:
    """Draw the marker of a method about (0, 0), as large as a circle of radius r, as the picture of a task has it."""
    _, marker = look(number)
    if marker == "o":
        return f"M{-r} 0a{r} {r} 0 1 0 {2 * r} 0a{r} {r} 0 1 0 {-2 * r} 0Z"
    if marker == "P":
        q = r / 2.4
        corners = [(-q, -r), (q, -r), (q, -q), (r, -q), (r, q), (q, q), (q, r), (-q, r), (-q, q), (-r, q), (-r, -q),
                   (-q, -q)]  # fmt: skip
        return f"M{_path(corners)}Z"
    count, turn = {"s": (4, 45), "D": (4, 0), "^": (3, -90), "v": (3, 90), "h": (6, 0), "p": (5, -90)}[marker]
    angles = [math.radians(turn + 360 * k / count) for k in range(count)]
    return f"M{_path([(1.2 * r * math.cos(angle), 1.2 * r * math.sin(angle)) for angle in angles])}Z"


WIDTH, HEIGHT, LEFT, BELOW, ABOVE, RIGHT = 340.0, 200.0, 38.0, 34.0, 10.0, 8.0  # of a curve
_AT = (1, 2, 3, 5, 7, 10, 15, 20, 30, 40, 60, 100, 150)  # readings at which a curve is drawn
_TICKS = (1, 2, 3, 5, 10, 20, 30, 40, 60, 100, 150)


def curve_of(one: Entrant, name: str, share: bool) -> dict[str, Any]:
    """Compute the paths of a figure, such as accuracy, with its intervals against the readings seen.

    share: whether it is a share from 0 to 1; else it is drawn to a logarithmic scale.
    """
    readings = [at for at in sorted({*_AT, one.readings}) if at <= one.readings]
    found = [(at, one.figure(f"{name}@{at}")) for at in readings]
    points = [
        (at, [of.value if end is None else end for end in (of.value, of.low, of.high)])
        for at, of in found
        if of.value is not None
    ]
    low, high = (0.0, 1.0) if share else _decades([end for _, ends in points for end in ends if end])

    def x(reading: float) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * math.log(reading) / math.log(max(one.readings, 2))

    def y(value: float | None) -> float:
        assert value is not None
        part = value if share else math.log(max(value, low) / low) / math.log(high / low)
        return HEIGHT - BELOW - (HEIGHT - BELOW - ABOVE) * part

    line, lower, upper = ([(x(at), y(ends[end])) for at, ends in points] for end in range(3))
    return {
        "width": f"{WIDTH:g}", "height": f"{HEIGHT:g}",
        "left": f"{LEFT - 5:.1f}", "below": f"{HEIGHT - BELOW + 15:.1f}",
        "middle": f"{(LEFT + WIDTH - RIGHT) / 2:.1f}", "bottom": f"{HEIGHT - 3:.1f}",
        "levels": [
            (f"{value:g}", f"{y(value) + 4:.1f}", f"M{_path([(LEFT, y(value)), (WIDTH - RIGHT, y(value))])}")
            for value in ((0.0, 0.5, 1.0) if share else _levels(low, high))
        ],
        "readings": [(f"{tick}", f"{x(tick):.1f}") for tick in _TICKS if tick <= one.readings],
        "line": f"M{_path(line)}" if line else "",
        "band": f"M{_path([*upper, *lower[::-1]])}Z",
        "dots": "".join(f"M{a - 3:.1f} {b:.1f}a3 3 0 1 0 6 0a3 3 0 1 0 -6 0Z" for a, b in line),
    }  # fmt: skip


def _decades(values: Sequence[float]) -> tuple[float, float]:
    """Choose a logarithmic axis of at least a factor of four about these values."""
    low, high = (min(values), max(values)) if values else (1.0, 1.0)
    return min(low, high / 4) * 0.9, high * 1.1


def _levels(low: float, high: float) -> list[float]:
    steps = [step * 10.0**power for power in range(-4, 4) for step in (1, 2, 5)]
    shown = [round(step, 6) for step in steps if low <= step <= high]
    return shown if len(shown) <= 6 else [step for step in shown if math.log10(step).is_integer()]


def _path(points: Sequence[tuple[float, float]]) -> str:
    return "L".join(f"{a:.1f} {b:.1f}" for a, b in points)
