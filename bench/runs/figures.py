"""What draws every curve, and the pictures of a run: accuracy and error by reading (the paper's figure 7), maps (4)."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping, Sequence
from importlib.resources import files
from io import BytesIO
from typing import Any, TypeAlias

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, NullLocator

from tactsim.bench.intervals import Z_95
from tactsim.bench.results import Run
from tactsim.bench.score import error_limits
from tactsim.core import InputError
from tactsim.core.errors import counted
from tactsim.core.poses import FloatArray

# In files colours are those of a light page; `report.picture.embedded` gives them back their names, for a page that may
# be dark.
NAMES = {
    light: f"var({name})"
    for name, light in re.findall(
        r"(--[\w-]+): light-dark\((#\w+)",
        (files("tactsim.bench") / "report/assets/page.css").read_text(encoding="utf-8"),
    )
}
_COLOUR_OF = {name: light for light, name in NAMES.items()}
INK, SOFT, GRID, FRONTIER = (_COLOUR_OF[f"var(--{name})"] for name in ("ink", "soft", "grid", "frontier"))
# One colour a method, in order; the page has the same.
COLOURS = tuple(light for light, name in NAMES.items() if re.fullmatch(r"var\(--m\d+\)", name))
BLUE, ORANGE = COLOURS[:2]
Figures: TypeAlias = Sequence[float | None] | FloatArray  # one after each reading

# What of a file's metadata would differ from one time to the next.
_DATES = {"svg": "Date", "png": "Software", "pdf": "CreationDate"}


def as_bytes(figure: Figure, kind: str = "png", dpi: int = 150, salt: str = "tactsim") -> bytes:
    """Give a figure as PNG, SVG or PDF, without a date so that equal figures are equal bytes. salt: of names in SVG."""
    content = BytesIO()
    # Fonts as TrueType: publishers refuse Type 3, the default.
    with mpl.rc_context({"svg.hashsalt": salt, "pdf.fonttype": 42}):
        figure.savefig(content, format=kind, dpi=dpi, metadata={_DATES[kind]: None})
    return content.getvalue()


def draw_curve(
    axes: Axes, values: Figures, low: Figures | None = None, high: Figures | None = None, *,
    color: str, band: str | None = None, gid: str | None = None, **style: Any,
) -> list[Line2D]:  # fmt: skip
    """Draw figures (n,) after each reading, None where there is none, within their interval; returns the line.

    band: what a legend says of the interval. style: of the line.
    """
    seen = np.arange(1, len(values) + 1)
    if len(values) == 1:  # a line of one reading is a mark, on the axis
        style = {"marker": "o", "clip_on": False, **style}
    if low is not None and high is not None:
        below, above = (np.array(end, dtype=float) for end in (low, high))
        if len(values) == 1:
            axes.vlines(seen, below, above, color, lw=4, alpha=0.3, clip_on=False, label=band or "", gid=gid)
        else:
            axes.fill_between(seen, below, above, color=color, alpha=0.15, lw=0, label=band, gid=gid)
    return axes.plot(seen, np.array(values, dtype=float), color=color, gid=gid, **{"lw": 1.5, **style})


def plain_log(axis: Axis) -> None:
    """Write the numbers 1, 2, 5, 10 ... beside a logarithmic axis, as they are."""
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter(lambda value, _: f"{value:g}")
    axis.set_minor_formatter(NullFormatter())


class Picture(Figure):
    """A figure that a notebook shows even if pyplot was never imported."""

    def png(self, dpi: int = 150) -> bytes:
        """Give the figure as PNG; see `as_bytes`."""
        return as_bytes(self, dpi=dpi)

    def _repr_png_(self) -> bytes:
        return self.png(dpi=100)


def readings_figure(run: Run) -> Picture:
    """Draw accuracy with its Wilson band, and error with its standard error, against readings seen."""
    title = [
        ", ".join(filter(None, (run.config["estimator"], run.about["description"]))),
        f"{counted(len(run.trials.truth), 'trial')}, {run.about['protocol']}",
    ]
    lines = [part for line in title for part in textwrap.wrap(line, 110)]
    figure = Picture(figsize=(9, 3.8))
    # Margins in inches: measuring every text for them would take as long as drawing.
    top = 1 - (0.13 + 0.17 * len(lines)) / 3.8
    figure.subplots_adjust(left=0.55 / 9, right=1 - 0.2 / 9, bottom=0.5 / 3.8, top=top, wspace=0.2)
    panels = [_draw_accuracy, _draw_error] if run.trials.places else [_draw_accuracy]
    for axes, draw in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
        draw(run, axes)
        # A title without a place is moved away from all ticks, which are measured for it.
        axes.set_title("", y=1)
        axes.xaxis.set_label_coords(0.5, -0.105)
    figure.suptitle("\n".join(lines), y=1 - 0.06 / 3.8, fontsize=10, parse_math=False)
    return figure


def draw_curves(run: Run, ax: Any) -> Any:
    """Draw accuracy on one Axes, or accuracy and error on two, and return them. Raises InputError for anything else."""
    both = list(np.ravel(ax))
    if len(both) not in (1, 2) or not all(isinstance(axes, Axes) for axes in both):
        raise InputError("ax: give matplotlib Axes, one for the accuracy or two for accuracy and error")
    for axes, draw in zip(both, (_draw_accuracy, _draw_error), strict=False):
        draw(run, axes)
    return ax


def _draw_accuracy(run: Run, axes: Axes) -> None:
    summary = run.summary
    band = summary["accuracy_low"], summary["accuracy_high"]
    style = {"color": BLUE, "band": "95 % Wilson interval", "lw": 1.8, "label": "accuracy"}
    draw_curve(axes, summary["accuracy"], *band, **style)
    if (first := summary["all_right_from"]) is not None:
        axes.axvline(first, color=SOFT, lw=0.8, ls=":", label=f"all right from {first}")
    axes.set(ylim=(0, 1.02), ylabel="share of trials right")
    axes.legend(frameon=False, loc="lower right")
    over_readings(axes, run.readings)


def _draw_error(run: Run, axes: Axes) -> None:
    error, spread, error_all = (
        np.array(run.summary[name], dtype=float)
        for name in ("error_mm", "error_standard_error_mm", "error_all_mm")
    )
    below, above = error - Z_95 * spread, error + Z_95 * spread
    low, high = error_limits([error, error_all, above], run.bound_mm)
    draw_curve(
        axes, np.maximum(error, low), np.clip(below, low, None), above, color=ORANGE,
        band="95 % interval of the mean", lw=1.8, label="where the letter is right",
    )  # fmt: skip
    if np.isfinite(run.bound_mm).any():
        draw_curve(axes, run.bound_mm, color=INK, lw=1, ls=(0, (5, 3)), label="Cramer-Rao bound")
    draw_curve(axes, np.maximum(error_all, low), color=SOFT, lw=1, ls="--", label="over all trials")
    axes.set(ylim=(low, high), yscale="log", ylabel="placement error, mm")
    plain_log(axes.yaxis)
    axes.yaxis.set_minor_locator(NullLocator())
    axes.grid(axis="y", lw=0.3, alpha=0.6)
    axes.legend(frameon=False, loc="upper right")
    over_readings(axes, run.readings)


def over_readings(axes: Axes, readings: int) -> None:
    """Let the axis along run over the readings of a trial, which are whole."""
    axes.set(xlim=(1, max(2, readings)), xlabel="readings seen")
    axes.spines[["top", "right"]].set_visible(False)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))  # no half readings


def maps_figure(maps: Mapping[str, Any]) -> Picture:
    """Draw the learned occupancy maps {label: map with .log_odds (rows, columns) and .extent mm}.

    Raises InputError if there are none.
    """
    if not maps:
        raise InputError("there are no maps: the run was loaded, or its estimator learns none")
    columns = min(len(maps), 6)
    rows = -(-len(maps) // columns)
    # Inches: a map and the space to the next, then the margins, as in `readings_figure`.
    titles = [textwrap.fill(label, 20) for label in maps]  # as wide as a map
    more = 0.17 * max(title.count("\n") for title in titles)
    side, across, down = 1.6, 0.4, 0.5 + more
    left, right, bottom, top = 0.4, 1.0, 0.55, 0.35 + more
    width = left + columns * (side + across) - across + right
    height = bottom + rows * (side + down) - down + top
    figure = Picture(figsize=(width, height))
    figure.subplots_adjust(
        left=left / width, right=1 - right / width, bottom=bottom / height, top=1 - top / height,
        wspace=across / side, hspace=down / side,
    )  # fmt: skip
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    alike = len({tuple(m.extent) for m in maps.values()}) == 1
    limit = max(float(np.abs(m.log_odds).max()) for m in maps.values())
    image = None
    for number, (axes, title, m) in enumerate(zip(grid, titles, maps.values(), strict=False)):
        image = axes.imshow(
            m.log_odds, origin="lower", extent=m.extent, cmap="RdBu_r", vmin=-limit, vmax=limit,
            interpolation="nearest",
        )  # fmt: skip
        axes.set_title(title, fontsize=10, parse_math=False, y=1)
        axes.tick_params(labelsize=7)
        if alike and number % columns:  # the first of the row says it
            axes.set_yticks([])
    for axes in grid[len(maps) :]:
        axes.set_visible(False)
    if image is not None:
        tall = min(height - bottom - top, 3.0)
        place = 1 - 0.8 / width, (bottom + height - top - tall) / 2 / height
        beside = figure.add_axes((*place, 0.12 / width, tall / height))
        figure.colorbar(image, cax=beside, label="log-odds of occupancy").ax.tick_params(labelsize=8)
    figure.supxlabel("mm", x=(left + width - right) / 2 / width, y=0.1 / height, fontsize=8)
    return figure
