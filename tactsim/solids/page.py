"""The page of runs with objects in space: curves, a table object by object, and trials in a view that can be turned."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tactsim.bench.experiment import gather, plan_of, silent
from tactsim.bench.kinds import Pages
from tactsim.bench.pages import render
from tactsim.bench.places import REPORT_TITLE, check_page
from tactsim.bench.report.page import Arrays
from tactsim.bench.report.picture import alone
from tactsim.bench.report.recognition import Again, do_again, trials_to_show
from tactsim.bench.results import Run
from tactsim.bench.score import Scored
from tactsim.bench.trials import TrialPlan
from tactsim.core import rigid
from tactsim.core.checking import checked
from tactsim.core.errors import InputError, counted
from tactsim.core.files import write_text
from tactsim.core.poses import FloatArray
from tactsim.solids.config import SpaceConfig
from tactsim.solids.pictures import CURVES, draw_over_touches
from tactsim.solids.score import SpaceTrials, angle
from tactsim.solids.surface_distance import drawn_evenly

_REPORT, _SPACE = "report/assets/", "/solids/assets/"
_VALUES = {
    "accuracy": "accuracy", "error": "error_mm", "errorMedian": "error_median_mm", "angle": "angle_deg",
    "angleMedian": "angle_median_deg", "coverage": "coverage_90",
}  # fmt: skip
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
        scripts=[
            f"{_REPORT}base.js",
            f"{_REPORT}tables.js",
            f"{_SPACE}scene.js",
            f"{_SPACE}space.js",
        ],
        styles=[f"{_REPORT}page.css", f"{_SPACE}space.css"],
        title=f"{REPORT_TITLE}objects in space, {counted(len(runs), 'run')}",
        plots={
            f"plot-{curve}": alone(partial(draw_over_touches, runs=runs, name=curve), f"plot-{curve}", words)
            for curve, (_, _, words) in CURVES.items()
        },
        data=data,
        arrays=arrays.text(),
    )


def _run(name: str, run: Run) -> dict[str, Any]:
    summary, trials = run.summary, run.trials
    objects = {}
    for label, values in summary["by_object"].items():
        wrong = Counter(summary["confusion"][label])
        wrong.pop(label, None)
        objects[label] = {**values, "taken": ", ".join(f"{other} {n}" for other, n in wrong.most_common(3))}
    return {
        "label": f"{run.config['estimator']} ({name}), {counted(len(trials.truth), 'trial')}",
        **{key: summary[of] for key, of in _VALUES.items()},
        "settled": summary["settled_95"],
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
    return do_again(plan, trials_to_show([run.trials]), plan.fitted(), run.objects)


def beliefs(of: Again) -> FloatArray | None:
    """Draw poses from what is believed of the label that is named, evenly by weight: (r, SHOWN, 7) object_in_robot.

    None if the estimator gives no samples.
    """
    if any(one.samples is None for one in of.estimates):
        return None
    return np.array([rigid.invert(drawn_evenly(one.samples, SHOWN)) for one in of.estimates if one.samples])


def _plan_anew(run: Run) -> TrialPlan:
    config = checked(SpaceConfig, run.config, "run")
    gathered = gather(config, jobs=1, cache=True, progress=silent)
    return plan_of(config, gathered.scan, objects=gathered.objects)
