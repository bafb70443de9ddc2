"""The picture of a task: processor time of a reading against placement error, a mark for each method."""

from __future__ import annotations

from io import BytesIO

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from tactsim.bench.leaderboard.figure_words import heading
from tactsim.bench.leaderboard.standings import Standings
from tactsim.bench.report.pareto import frontier
from tactsim.bench.report.picture import look

SCHEMES = {"light": ("#ffffff", "#161b22", "#d9dee5"), "dark": ("#161b23", "#e8ecf2", "#2c3440")}
_IN_A_COLUMN = 24  # labels beside the picture


def time_picture(of: Standings, scheme: str = "light", kind: str = "svg") -> bytes | None:
    """Draw the picture on a ground of `scheme`, as SVG or PNG without a date; None if no method has an error."""
    found = [(one, one.ms_per_reading, one.figure(of.error_by)) for one in of.ranked]
    points = [(one, ms, error, error.value) for one, ms, error in found if error.value and ms > 0]
    if not points:
        return None
    ground, ink, line = SCHEMES[scheme]
    style = dict.fromkeys(
        ("text.color", "axes.labelcolor", "xtick.color", "ytick.color", "axes.edgecolor"), ink
    )
    with mpl.rc_context({"svg.hashsalt": "tactsim", "text.parse_math": False, **style}):  # type: ignore[dict-item]
        figure = Figure(
            figsize=(9, max(4.2, 0.21 * len(points) + 0.6)), layout="constrained", facecolor=ground
        )
        axes = figure.subplots()
        axes.set_facecolor(ground)
        for one, ms, error, value in points:
            colour, marker = look(one.number, scheme)
            if error.low is not None and error.high is not None:
                axes.plot([ms, ms], [max(error.low, 1e-9), error.high], color=colour, lw=0.9)
            axes.plot([ms], [value], ls="", marker=marker, ms=7, color=colour, label=_short(one.label))
        first = frontier([ms for _, ms, _, _ in points], [value for *_, value in points])
        corners = sorted((ms, value) for (_, ms, _, value), best in zip(points, first, strict=True) if best)
        axes.plot(*zip(*corners, strict=True), color="#999999", lw=7, alpha=0.3, solid_capstyle="round", zorder=0,
                  drawstyle="steps-post")  # fmt: skip
        axes.set(
            xscale="log", yscale="log", xlabel="processor time of a reading, ms", ylabel=heading(of.error_by)
        )
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axis.set_minor_formatter(NullFormatter())
        axes.grid(which="major", lw=0.5, color=line)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
        axes.margins(0.08)
        figure.legend(
            loc="outside right upper", frameon=False, fontsize=9, ncols=1 + len(points) // _IN_A_COLUMN
        )
        content = BytesIO()
        figure.savefig(
            content, format=kind, dpi=160, metadata={"Date": None} if kind == "svg" else {"Software": None}
        )
    return content.getvalue()


def _short(label: str, most: int = 34) -> str:
    return label if len(label) <= most else f"{label[: most - 1]}…"
