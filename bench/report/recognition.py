"""Do one trial of a run again and keep what the estimator believed after every reading."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tactsim import models
from tactsim.bench.config import OF_SOURCE, RunConfig
from tactsim.bench.experiment import gather, silent
from tactsim.bench.kinds import load
from tactsim.bench.placement import Properties
from tactsim.bench.results import Run
from tactsim.bench.runs.pooled import Group, Pooled
from tactsim.bench.score import errors, settled_at
from tactsim.bench.sent_trials import fit_plan
from tactsim.bench.trials import OneTrial, Progress, Touch, TrialPlan, Trials, check_readings, run_trial
from tactsim.core import Scan, compose, invert, transform
from tactsim.core.checking import checked
from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.estimators import Estimate, Estimator, PlaneBelief
from tactsim.estimators.estimator import no_exit
from tactsim.estimators.likelihoods.occupancy import OccupancyMap, maps_of
from tactsim.press import ScanOptions, scan_letters

# A Gaussian in the plane is within so many standard deviations with 90 %.
_TWO_DIMENSIONS_90 = math.sqrt(-2 * math.log(0.1))
MOST = 8  # runs of a protocol that are done again, one for each method


@dataclass(frozen=True, eq=False)
class Recognition:
    """One trial of a run, reading by reading, n readings.

    answer: the right label. kind: "typical" or "hardest". same: whether it gave again what the run recorded.
    pressures: (n, taxels) kPa. sensor_in_object: (n, 3). estimate_in_object: (n, 3), where the estimate
    puts the object, in the frame in which it truly lies. probabilities: (n, labels). robot_in_object:
    (n, 3) estimated. region: (n, 5) where the centre of mass is with 90 %, if the belief is taken as Gaussian: an
    ellipse's centre x, y, half axes and angle, in the frame in which the object truly lies; None if the estimator does
    not say. radius: (n,) mm, of the 90 % region. plane: one belief a reading, or None if the estimator shows none.
    """

    entry: Pooled
    task: OneTrial
    answer: str
    kind: str
    same: bool
    labels: tuple[str, ...]
    label: list[str]
    pressures: FloatArray
    sensor_in_object: FloatArray
    estimate_in_object: FloatArray
    probabilities: FloatArray
    robot_in_object: FloatArray
    true_pose: FloatArray
    error: FloatArray
    region: FloatArray | None
    radius: FloatArray
    plane: list[PlaneBelief] | None


@dataclass(frozen=True, eq=False)
class Replayed:
    """The trials of one run that were done again, with the readings and the maps."""

    entry: Pooled
    scan: Scan
    maps: Mapping[str, OccupancyMap]
    recognitions: tuple[Recognition, ...]


def representatives(groups: Sequence[Group]) -> list[tuple[Group, Pooled]]:
    """Choose the runs whose trials are done again, at most `MOST` of a protocol.

    They are the runs of the protocol's first task, of each method the one with the largest budget.
    """
    chosen = []
    for protocol in dict.fromkeys(group.protocol for group in groups):
        group = next(group for group in groups if group.protocol == protocol)
        last = {entry.method: entry for entry in group.entries}  # sorted by budget: the largest stays
        chosen += [(group, entry) for entry in list(last.values())[:MOST]]
    return chosen


def trials_to_show(runs: Sequence[Trials]) -> dict[str, OneTrial]:
    """Choose the trials to show, the same for all these runs: a typical one and the hardest.

    Trials are ordered by the reading from which they are and stay right, averaged over the runs. The typical
    trial is the median, the hardest is the last.
    """
    settled = [dict(zip(one.ids, settled_at(one.right).tolist(), strict=True)) for one in runs]
    common = [key for key in settled[0] if all(key in of_run for of_run in settled)]
    common.sort(key=lambda key: sum(of_run[key] for of_run in settled))
    tasks = {"typical": OneTrial(*common[(len(common) - 1) // 2]), "hardest": OneTrial(*common[-1])}
    return tasks if len(common) > 1 else {"typical": tasks["typical"]}


def replay_all(
    groups: Sequence[Group], scans: dict[str, Scan], *, progress: Progress = silent
) -> tuple[list[Replayed], dict[str, str]]:
    """Do the chosen trials of the chosen runs again. scans: see `readings_of`.

    Returns them, and for the runs that could not be done again the reason, by label.
    """
    chosen = representatives(groups)
    done: list[Replayed] = []
    failed: dict[str, str] = {}
    for number, (group, entry) in enumerate(chosen):
        progress("replay", number, len(chosen))
        tasks = trials_to_show([other.run.trials for of, other in chosen if of is group])
        try:
            done.append(_replay(entry, tasks, scans))
        except InputError as error:
            failed[entry.label] = str(error)
    progress("replay", len(chosen), len(chosen))
    return done, failed


def _replay(entry: Pooled, tasks: Mapping[str, OneTrial], scans: dict[str, Scan]) -> Replayed:
    plan = entry.run.plan or _plan_anew(entry, tasks, scans)
    estimator = fit_plan(plan)
    recognitions = tuple(
        _recognition(entry, one) for one in do_again(plan, tasks, estimator, entry.run.objects)
    )
    return Replayed(entry, plan.scan, maps_of(estimator), recognitions)


def _plan_anew(entry: Pooled, tasks: Mapping[str, OneTrial], scans: dict[str, Scan]) -> TrialPlan:
    """Put together what trials of a loaded run need. Raises InputError if its readings cannot be had again."""
    scan = readings_of(entry.run, scans)
    config = _config(entry.run)
    check_readings(scan, sorted({task.truth for task in tasks.values()}), entry.readings, config.hold_out)
    return load(config.kind).plan(config, scan, None, None)


def readings_of(run: Run, scans: dict[str, Scan]) -> Scan:
    """Get the readings of a loaded run, each scan once. Raises InputError if they cannot be had again.

    scans: those that were had already; the run's is added.
    """
    config = _config(run)
    from_files = config.scan is not None or config.presses is not None
    options = None if from_files else run.about["scan"].get("options")
    words = {*OF_SOURCE}
    if config.presses is not None:
        words |= {"trials", "readings"}
    if config.train_presses is not None:
        words |= {"train_presses", "seed"}
    which = config.model_dump(mode="json", include=words)
    key = json.dumps([options, which], sort_keys=True)
    if key not in scans:
        pressed = None if from_files else _pressed_again(options, config)
        scans[key] = gather(config, scan=pressed).scan
    return scans[key]


def _config(run: Run) -> RunConfig:
    """Check the configuration of a run, with the shapes that its folder keeps in place of the user's files."""
    shapes = {"shapes": run.shape_files} if run.shape_files else {}
    return checked(RunConfig, run.config | shapes, "run")


def _pressed_again(options: Any, config: RunConfig) -> Scan:
    """Press letters again with the options that the scan of a run states, and the shapes of `_config`.

    Raises InputError if the readings were given in Python and pressing does not give them again, for example
    because they are a real pad's.
    """
    if options is not None:
        shapes = {"shapes": tuple(map(str, config.shapes))} if config.shapes else {}
        scan, _ = scan_letters(checked(ScanOptions, options | shapes, "scan.options"))
        scan = replace(scan, meta={**scan.meta, "options": options})
        if config.given in (None, scan.digest):
            return scan
    raise InputError("its readings were given in Python, and pressing does not give them again")


@dataclass(frozen=True, eq=False)
class Again:
    """One trial of a run, done again: what it came to, and after each touch the estimate, and the plane's belief.

    kind: "typical" or "hardest". plane: None if the estimator shows none.
    """

    task: OneTrial
    kind: str
    trials: Trials
    estimates: list[Estimate]
    touches: list[Touch]
    plane: list[PlaneBelief] | None


def do_again(
    plan: TrialPlan, tasks: Mapping[str, OneTrial], estimator: Estimator, objects: Mapping[str, Any]
) -> list[Again]:
    """Do trials again with the fitted estimator, by what they are. objects: a run's, see `Run`."""
    found = []
    for kind, task in tasks.items():
        fitted, known = plan.fitted_for(task.truth, estimator)
        seen: list[tuple[Estimate, Touch, PlaneBelief | None]] = []

        def keep(estimate: Estimate, touch: Touch, of: Estimator = fitted, seen: Any = seen) -> None:
            seen.append((estimate, touch, of.belief_over_plane()))

        test, measure = plan.test_readings(task), objects[task.truth]
        with no_exit(fitted):
            trials = run_trial(fitted, test, task, plan.rules, letters=known, of=measure, observe=keep)
        estimates, touches, beliefs = map(list, zip(*seen, strict=True))
        found.append(Again(task, kind, trials, estimates, touches, None if None in beliefs else beliefs))
    return found


def _recognition(entry: Pooled, of: Again) -> Recognition:
    estimates, trial, objects = of.estimates, of.trials, entry.run.objects
    took = len(estimates)  # the trial may have ended before it had all its touches
    true_pose, pose = trial.true_pose[0, :took], trial.pose[0, :took]
    error = errors(trial, objects)[0, :took]
    labels = tuple(dict.fromkeys(label for e in estimates for label in e.probabilities))
    return Recognition(
        entry=entry, task=of.task, answer=str(trial.answer[0]), kind=of.kind,
        same=_same(trial, entry.run.trials), labels=labels, label=trial.label[0, :took].tolist(),
        pressures=np.array([touch.reading for touch in of.touches]),
        sensor_in_object=compose(true_pose, np.array([touch.sensor_in_robot for touch in of.touches])),
        estimate_in_object=compose(true_pose, invert(pose)),
        probabilities=np.array([[e.probabilities.get(label, 0.0) for label in labels] for e in estimates]),
        robot_in_object=pose, true_pose=true_pose,
        error=error if entry.run.trials.places else np.full_like(error, np.nan),
        region=regions(estimates, true_pose, objects[of.task.truth]), radius=trial.radius_90[0, :took],
        plane=of.plane,
    )  # fmt: skip


def regions(estimates: Sequence[Estimate], true_pose: FloatArray, of: Properties) -> FloatArray | None:
    """Draw the belief about the centre of mass as an ellipse after each reading: (n, 5), see `Recognition`.

    true_pose: (n, 3) T_R^O at each reading.
    """
    found = []
    for estimate, true in zip(estimates, true_pose, strict=True):
        if estimate.samples is None:
            return None
        placed, weights = invert(estimate.samples.poses), estimate.samples.weights
        centre = transform(placed, np.array([of.centre]))[:, 0]
        x, y, _ = compose(true, [*np.average(centre, axis=0, weights=weights), 0.0])
        squares, axes = np.linalg.eigh(np.cov(centre.T, aweights=weights, ddof=0))
        half = _TWO_DIMENSIONS_90 * np.sqrt(np.maximum(squares[::-1], 0))
        found.append([x, y, *half, true[2] + np.arctan2(axes[1, 1], axes[0, 1])])
    return np.array(found)


def _same(trial: Trials, recorded: Trials) -> bool:
    row = (recorded.truth == trial.truth[0]) & (recorded.trial == trial.trial[0])
    return bool(
        np.array_equal(recorded.touch_index[row], trial.touch_index)
        and np.array_equal(recorded.label[row], trial.label)
        and np.allclose(recorded.pose[row], trial.pose, rtol=0, atol=1e-6)
    )


def drawing(label: str, scan: Scan, shape_files: Sequence[Path] = ()) -> list[FloatArray] | None:
    """Give the contours that an object was drawn with, (k, 2) mm each, in its own frame; None if nobody knows them.

    A letter of a simulated scan has the catalogue's outline, a shape of `shape_files` that of its file.
    """
    if "options" in scan.meta and label in models.names():
        return [np.asarray(contour) for contour in models.letter(label).contours]
    for path in shape_files:
        if path.stem == label:
            return [np.asarray(contour) for contour in models.shape(path).contours]
    return None


def map_outline(label: str, maps: Mapping[str, OccupancyMap]) -> list[FloatArray]:
    """Find where a map says that occupied and empty are equally likely: contours (k, 2) mm, none without a map."""
    if label not in maps:
        return []
    from contourpy import contour_generator

    chart = maps[label]
    rows, columns = (chart.cell * np.arange(count) for count in chart.log_odds.shape)
    x, y = chart.origin[0] + columns, chart.origin[1] + rows
    lines = contour_generator(x, y, chart.log_odds).lines(0.0)
    return [np.asarray(line) for line in lines if len(line) > 8]


def taxel_size(scan: Scan) -> list[float]:
    """Guess a taxel's width and height, mm, from the usual spacing of the taxels' centres."""
    gaps = [np.diff(np.unique(np.round(scan.taxel_xy[:, axis], 3))) for axis in (0, 1)]
    return [round(0.94 * float(np.median(gap)), 3) if len(gap) else 1.0 for gap in gaps]
