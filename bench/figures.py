"""The pictures of a run: accuracy and error against readings (the paper's figure 7), maps (figure 4)."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from tactsim.bench.run import Run
from tactsim.core import InputError

BLUE, ORANGE, GREY = "#3366aa", "#cc6633", "#666666"


class Picture(Figure):
    """A figure that a notebook shows also where pyplot was never imported."""

    def png(self, dpi: int = 150) -> bytes:
        """Give the figure as PNG, without a date so that equal figures are equal bytes."""
        content = BytesIO()
        self.savefig(content, format="png", dpi=dpi, metadata={"Software": None})
        return content.getvalue()

    def _repr_png_(self) -> bytes:
        return self.png(dpi=100)


def readings_figure(run: Run) -> Picture:
    """Draw accuracy with its Wilson band, and error with its standard error, against readings seen."""
    summary = run.summary
    number = np.arange(1, len(summary["accuracy"]) + 1)
    figure = Picture(figsize=(9, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2)

    left.fill_between(
        number, summary["accuracy_low"], summary["accuracy_high"], color=BLUE, alpha=0.2, lw=0,
        label="95 % Wilson interval",
    )  # fmt: skip
    left.plot(number, summary["accuracy"], color=BLUE, lw=1.8, label="accuracy")
    if summary["all_right_from"] is not None:
        left.axvline(
            summary["all_right_from"], color=GREY, lw=0.8, ls=":",
            label=f"all right from {summary['all_right_from']}",
        )  # fmt: skip
    left.set(
        ylim=(0, 1.02), xlim=(1, max(2, number[-1])), xlabel="readings seen", ylabel="share of trials right"
    )
    left.legend(frameon=False, loc="lower right")

    error = np.array([np.nan if v is None else v for v in summary["error_mm"]], dtype=float)
    spread = np.array([np.nan if v is None else v for v in summary["error_standard_error_mm"]], dtype=float)
    right.fill_between(
        number, np.clip(error - 1.96 * spread, 0, None), error + 1.96 * spread, color=ORANGE, alpha=0.2, lw=0,
        label="95 % interval of the mean",
    )  # fmt: skip
    right.plot(number, error, color=ORANGE, lw=1.8, label="where the letter is right")
    right.plot(number, summary["error_all_mm"], color=GREY, lw=1, ls="--", label="over all trials")
    right.set(
        xlim=(1, max(2, number[-1])), yscale="log", xlabel="readings seen", ylabel="placement error, mm"
    )
    for ax in (left, right):
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))  # there are no half readings
    right.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    right.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    right.yaxis.set_minor_formatter(NullFormatter())
    right.grid(axis="y", which="both", lw=0.3, alpha=0.6)
    right.legend(frameon=False, loc="upper right")
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    title = [
        f"{run.config['estimator']}, {run.about['description']}",
        f"{len(run.trials.truth)} trials, {run.about['protocol']}",
    ]
    figure.suptitle("\n".join(textwrap.fill(line, 110) for line in title), fontsize=10, parse_math=False)
    return figure


def maps_figure(maps: Mapping[str, Any]) -> Picture:
    """Draw the learned occupancy maps {label: map with .log_odds (rows, columns) and .extent mm}.

    Raises InputError if there are none.
    """
    if not maps:
        raise InputError("there are no maps: the run was loaded, or its estimator learns none")
    columns = min(len(maps), 6)
    rows = -(-len(maps) // columns)
    figure = Picture(figsize=(2.2 * columns + 0.9, 2.3 * rows + 0.5), layout="constrained")
    grid = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    limit = max(float(np.abs(m.log_odds).max()) for m in maps.values())
    image = None
    for axes, (label, m) in zip(grid, maps.items(), strict=False):
        image = axes.imshow(
            m.log_odds, origin="lower", extent=m.extent, cmap="RdBu_r", vmin=-limit, vmax=limit,
            interpolation="nearest",
        )  # fmt: skip
        axes.set_title(label, fontsize=10, parse_math=False)
        axes.tick_params(labelsize=7)
    for axes in grid[len(maps) :]:
        axes.set_visible(False)
    if image is not None:
        figure.colorbar(image, ax=grid[: len(maps)].tolist(), label="log-odds of occupancy", shrink=0.8)
    figure.supxlabel("mm", fontsize=8)
    return figure
