"""The picture of a run with objects in space: accuracy, surface distance and angle against touches."""

from __future__ import annotations

import numpy as np
from matplotlib.ticker import MaxNLocator

from tactsim.bench.results import Run
from tactsim.bench.runs.figures import BLUE, GREY, ORANGE, Picture
from tactsim.core.errors import counted
from tactsim.core.poses import FloatArray

_AIMS = {"error_mm": 1.0, "angle_deg": 5.0}  # what a part is wanted to be found to, a dotted line


def touches_figure(run: Run) -> Picture:
    """Draw accuracy with its Wilson band, and surface distance and angle with their bootstrap bands."""
    number = np.arange(1, run.readings + 1)

    def curve(name: str) -> FloatArray:
        return np.array(run.summary[name], dtype=float)  # NaN for None

    figure = Picture(figsize=(11, 3.6), layout="constrained")
    right, error, angle = figure.subplots(1, 3)
    panels = (
        (right, "accuracy", ("accuracy_low", "accuracy_high"), "share of trials right", BLUE),
        (error, "error_mm", ("error_low_mm", "error_high_mm"), "mean surface distance, mm", ORANGE),
        (angle, "angle_deg", ("angle_low_deg", "angle_high_deg"), "angle, degrees", ORANGE),
    )
    for axes, name, band, words, colour in panels:
        axes.fill_between(number, *map(curve, band), color=colour, alpha=0.2, lw=0)
        axes.plot(number, curve(name), color=colour, lw=1.8, label="mean" if name in _AIMS else None)
        if name in _AIMS:
            median = name.replace("_", "_median_")
            axes.plot(number, curve(median), color=GREY, lw=1, ls="--", label="median")
            axes.axhline(_AIMS[name], color=GREY, lw=0.8, ls=":")
            axes.set_yscale("log")
            axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
            axes.legend(frameon=False)
        axes.set(xlabel="touches", ylabel=words, xlim=(1, max(2, run.readings)))
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.spines[["top", "right"]].set_visible(False)
    right.set_ylim(0, 1.02)
    figure.suptitle(
        f"{run.config['estimator']}: {counted(len(run.trials.truth), 'trial')} over "
        f"{counted(len(run.letters), 'object')}, {run.about['protocol']}; bands: 95 %",
        fontsize=10,
        parse_math=False,
    )
    return figure
