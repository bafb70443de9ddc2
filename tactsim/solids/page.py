"""What is drawn of runs with objects in space: curves and learned surfaces, and the page with trials to turn."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes

from tactsim.bench.experiment import gather
from tactsim.bench.kinds import load
from tactsim.bench.pages import render
from tactsim.bench.report import REPORT_TITLE, Pages, check_page
from tactsim.bench.report.page import Arrays, shown_figures
from tactsim.bench.report.picture import alone
from tactsim.bench.report.recognition import Again, do_again, trials_to_show
from tactsim.bench.results import Run
from tactsim.bench.runs.figures import COLOURS, SOFT, Picture, draw_curve, over_readings, plain_log
from tactsim.bench.score import Scored
from tactsim.bench.sent_trials import fit_plan
from tactsim.bench.trials import TrialPlan
from tactsim.core import rigid
from tactsim.core.checking import checked
from tactsim.core.errors import InputError, counted
from tactsim.core.files import write_text
from tactsim.core.poses import FloatArray
from tactsim.solids.kind import SpaceConfig
from tactsim.solids.score import SpaceTrials, angle, drawn_evenly

if TYPE_CHECKING:
    from tactsim.solids.field import Surface


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


_REPORT, _SPACE = "report/assets/", "/solids/assets/"
_DOTS = 24  # surface points of each pose of a belief


def write_space_page(of: Pages) -> tuple[list[Path], list[str]]:
    """Write the page of runs in space; returns the files written, and remarks on what is missing.

    Raises InputError if it cannot be written.
    """
    out, runs = of.out, {folder.name: run for folder, run in of.runs}
    check_page(out)
    replayed: dict[str, list[Again]] = {}
    remarks = list(of.remarks)
    for number, (name, run) in enumerate(runs.items()):
        of.progress("replay", number, len(runs))
        try:
            replayed[name] = replay(run)
        except InputError as error:
            remarks.append(f"no trial of {name} could be done again: {error}")
    of.progress("replay", len(runs), len(runs))
    write_text(out, page(runs, replayed, remarks))
    return [out], remarks


def page(runs: Mapping[str, Run], replayed: Mapping[str, Sequence[Again]], remarks: Sequence[str]) -> str:
    """Make the HTML of the page. The same runs give the same page."""
    arrays = Arrays()
    first = next(iter(runs.values()))
    shown = [(name, one) for name, several in replayed.items() for one in several]
    labels = list(dict.fromkeys(label for run in runs.values() for label in run.letters))
    named = {label for _, one in shown for label in (*one.trials.label[0].tolist(), str(one.trials.truth[0]))}
    shapes = {label: shape for run in runs.values() for label, shape in run.objects.items() if label in named}
    points, pitch = _taxels(first)
    reach = max(
        (float(np.linalg.norm(shape.vertices, axis=1).max()) for shape in shapes.values()), default=30.0
    )
    data = {
        "facts": f"{counted(len(runs), 'run')} · {first.about['protocol']} · "
        f"{first.about['machine']['processor']}",
        "versions": ", ".join(f"{name} {number}" for name, number in sorted(first.about["versions"].items())),
        "remarks": list(remarks),
        "figures": _figures(first),
        "labels": labels,
        "objects": labels,
        "runs": [_run(name, run) for name, run in runs.items()],
        "taxelPoints": points,
        "pitch": pitch,
        "reach": reach + 12.0,
        "shapes": {
            label: {
                "vertices": arrays.add(shape.vertices, "f4"),
                "faces": arrays.add(shape.faces, "u4"),
                "points": arrays.add(shape.points[:_DOTS], "f4"),
            }
            for label, shape in shapes.items()
        },
        "trials": [_trial(name, runs[name], one, labels, arrays) for name, one in shown],
    }
    return render(
        f"{_REPORT}page.html",
        scripts=[f"{_REPORT}base.js", f"{_REPORT}tables.js", f"{_SPACE}space.js"],
        styles=[f"{_REPORT}page.css", f"{_SPACE}space.css"],
        title=f"{REPORT_TITLE}objects in space, {counted(len(runs), 'run')}",
        plots={
            f"plot-{curve}": alone(partial(draw_over_touches, runs=runs, name=curve), f"plot-{curve}", words)
            for curve, (_, _, words) in CURVES.items()
        },
        data=data,
        arrays=arrays.text(),
    )


def _figures(run: Run) -> dict[str, Any]:
    return {name: how for name, how in shown_figures(run.kind.name).items() if name in run.summary}


def _run(name: str, run: Run) -> dict[str, Any]:
    summary, trials = run.summary, run.trials
    objects = {}
    for label, values in summary["by_object"].items():
        wrong = Counter(summary["confusion"][label])
        wrong.pop(label, None)
        objects[label] = {**values, "taken": ", ".join(f"{other} {n}" for other, n in wrong.most_common(3))}
    return {
        "label": f"{run.config['estimator']} ({name}), {counted(len(trials.truth), 'trial')}",
        "figures": {
            name: [summary[name]] if isinstance(summary[name], list) else summary[name]
            for name in _figures(run)
        },
        "seconds": float(trials.seconds.sum(axis=1).mean()),
        "objects": objects,
    }


def _trial(name: str, run: Run, of: Again, labels: Sequence[str], arrays: Arrays) -> dict[str, Any]:
    trials, scored = of.trials, Scored(of.trials, run.objects)
    assert isinstance(trials, SpaceTrials)
    poses = beliefs(of)

    def listed(values: Any) -> list[float | None]:
        return [None if np.isnan(value) else round(float(value), 4) for value in values]

    return {
        "run": name,
        "kind": of.kind,
        "truth": str(trials.truth[0]),
        "trial": int(trials.trial[0]),
        "label": trials.label[0].tolist(),
        "met": trials.met[0].tolist(),
        "error": listed(np.where(trials.named, scored.error, np.nan)[0]),
        "angle": listed(np.where(trials.named, angle(scored), np.nan)[0]),
        "probabilities": [
            [round(one.probabilities.get(label, 0.0), 5) for label in labels] for one in of.estimates
        ],
        "truePose": arrays.add(rigid.invert(trials.true_pose[0, 0]), "f4"),
        "pose": arrays.add(rigid.invert(trials.pose[0]), "f4"),
        "sensors": arrays.add([touch.sensor_in_robot for touch in of.touches], "f4"),
        "readings": arrays.add([touch.reading for touch in of.touches], "f4"),
        "belief": None if poses is None else arrays.add(poses, "f4"),
    }


def _taxels(run: Run) -> tuple[list[list[float]], float]:
    """Give the taxels' places on the pad, mm, and the least distance between two."""
    points = np.asarray(run.about["taxel_points"])
    apart = np.linalg.norm(points[:, None] - points, axis=-1)
    np.fill_diagonal(apart, np.inf)
    return points.round(4).tolist(), float(min(apart.min(), 10.0))


SHOWN = 40  # poses of a belief


def replay(run: Run) -> list[Again]:
    """Do a typical trial of a run and the hardest again. Raises InputError if its readings cannot be had again."""
    plan = run.plan or _plan_anew(run)
    return do_again(plan, trials_to_show([run.trials]), fit_plan(plan), run.objects)


def beliefs(of: Again) -> FloatArray | None:
    """Draw poses from what is believed of the label that is named, evenly by weight: (r, SHOWN, 7) object_in_robot.

    None if the estimator gives no samples.
    """
    if any(one.samples is None for one in of.estimates):
        return None
    return np.array([rigid.invert(drawn_evenly(one.samples, SHOWN)) for one in of.estimates if one.samples])


def _plan_anew(run: Run) -> TrialPlan:
    config = checked(SpaceConfig, run.config, "run")
    gathered = gather(config)
    return load(config.kind).plan(config, gathered.scan, None, gathered.objects)
