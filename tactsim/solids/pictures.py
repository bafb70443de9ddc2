"""The pictures of a run with objects in space: its curves against touches, and the surfaces that were learned."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from tactsim.bench.results import Run
from tactsim.bench.runs.figures import COLOURS, SOFT, Picture, draw_curve, over_readings, plain_log
from tactsim.core.errors import counted
from tactsim.core.poses import FloatArray

if TYPE_CHECKING:
    from tactsim.solids.learning import Surface

_AIMS = {"error_mm": 1.0, "angle_deg": 5.0}  # what a part is wanted to be found to, a dotted line


# The curves: their names, those of their band and their median, and what an axis says.
CURVES = {
    "accuracy": (("accuracy_low", "accuracy_high"), None, "share of trials right"),
    "error_mm": (("error_low_mm", "error_high_mm"), "error_median_mm", "mean surface distance, mm"),
    "angle_deg": (("angle_low_deg", "angle_high_deg"), "angle_median_deg", "angle, degrees"),
}


def touches_figure(run: Run) -> Picture:
    """Draw accuracy with its Wilson band, and surface distance and angle with their bootstrap bands."""
    figure = Picture(figsize=(11, 3.6), layout="constrained")
    for axes, (name, (_, median, words)) in zip(figure.subplots(1, 3), CURVES.items(), strict=True):
        draw_over_touches(axes, {"mean": run}, name)
        axes.set_ylabel(words)
        if median:
            draw_curve(axes, run.summary[median], color=SOFT, lw=1, ls="--", label="median")
            axes.legend(frameon=False)
    figure.suptitle(
        f"{run.config['estimator']}: {counted(len(run.trials.truth), 'trial')} over "
        f"{counted(len(run.letters), 'object')}, {run.about['protocol']}; bands: 95 %",
        fontsize=10,
        parse_math=False,
    )
    return figure


def draw_over_touches(axes: Axes, runs: Mapping[str, Run], name: str) -> None:
    """Draw one of `CURVES` of several runs, by name, each in its own colour, and what is aimed at."""
    (low, high), median, _ = CURVES[name]
    for number, (label, run) in enumerate(runs.items()):
        colour = COLOURS[number % len(COLOURS)]
        summary = run.summary
        draw_curve(axes, summary[name], summary[low], summary[high], color=colour, lw=1.8, label=label)
    if median:
        axes.axhline(_AIMS[name], color=SOFT, lw=0.8, ls=":", label="wanted")
        axes.set_yscale("log")
        plain_log(axes.yaxis)
    else:
        axes.set_ylim(0, 1.02)
    over_readings(axes, max(run.readings for run in runs.values()))
    axes.set_xlabel("touches")


# Each side: where the picture's right and up point, in the object frame; one looks along -(right x up).
_SIDES: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "along -z": ((1, 0, 0), (0, 1, 0)),
    "along y": ((1, 0, 0), (0, 0, 1)),
    "along -x": ((0, 1, 0), (0, 0, 1)),
}
_LIGHT = np.array([-0.4, 0.5, 0.77])  # from the upper left, before the picture
_INCHES = 1.25  # that a view measures
_ACROSS = 4  # objects in a row


def surfaces_figure(surfaces: Mapping[str, Surface]) -> Picture:
    """Draw each learned surface by its points, from three sides, at one scale; what is hidden is not shown."""
    rows = math.ceil(len(surfaces) / _ACROSS)
    columns = min(len(surfaces), _ACROSS)
    size = (columns * len(_SIDES) * _INCHES, rows * (_INCHES + 0.3) + 0.3)
    figure = Picture(figsize=size)
    grid = figure.subplots(rows, columns * len(_SIDES), squeeze=False)
    figure.subplots_adjust(
        left=0.01, right=0.99, bottom=0.3 / size[1], top=1 - 0.3 / size[1], wspace=0.02, hspace=0.25
    )
    half = 1.05 * max((float(np.abs(one.points).max()) for one in surfaces.values()), default=1.0)
    for axes in grid.ravel():
        axes.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
        axes.axis("off")
    for number, (label, surface) in enumerate(surfaces.items()):
        row, first = divmod(number, _ACROSS)
        for view, (right, up) in enumerate(_SIDES.values()):
            axes = grid[row, first * len(_SIDES) + view]
            seen, tone = _seen(surface, np.array(right, dtype=float), np.array(up, dtype=float))
            # In points: a view is so many inches wide, and a point of the surface stands for its spacing.
            wide = 1.8 * surface.spacing / (2 * half) * _INCHES * 72
            axes.scatter(*seen.T, c=tone, s=wide**2, cmap="bone", vmin=-0.1, vmax=1.15, linewidths=0)
        grid[row, first * len(_SIDES) + 1].set_title(label, fontsize=9, parse_math=False)
    figure.text(0.5, 0.08 / size[1], "seen " + ", ".join(_SIDES), ha="center", fontsize=8, color="#666666")
    return figure


def _seen(surface: Surface, right: FloatArray, up: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Give the points (n, 2) mm that look at the viewer, the farthest first, and how bright each is."""
    toward = np.cross(right, up)
    frame = np.stack([right, up, toward])
    points, normals = surface.points @ frame.T, surface.normals @ frame.T
    front = normals[:, 2] > 0
    order = np.argsort(points[front, 2])
    return points[front][order, :2], np.maximum(normals[front][order] @ _LIGHT, 0)
