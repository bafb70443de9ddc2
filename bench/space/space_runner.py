"""Do one run with objects in space: touch or load, fit the estimator, do the trials, score them."""

from __future__ import annotations

from datetime import UTC, datetime
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from tactsim.bench.experiment import silent
from tactsim.bench.machine import machine, peak_memory_mb, versions
from tactsim.bench.space.space_config import SpaceConfig
from tactsim.bench.space.space_plan import SpacePlan, solids_of, surface_of, try_in_space
from tactsim.bench.space.space_run import Shape, SpaceRun
from tactsim.bench.space.space_trials import tasks_of
from tactsim.bench.trials import Progress
from tactsim.core.errors import InputError
from tactsim.core.source_digest import git_commit
from tactsim.core.space_scan import SpaceScan
from tactsim.estimators import create
from tactsim.estimators.estimator import about_estimator, proposes_none
from tactsim.estimators.space.space_field import surfaces_of

if TYPE_CHECKING:
    from tactsim.models import Solid


def perform_in_space(config: SpaceConfig, *, jobs: int = 1, progress: Progress = silent) -> SpaceRun:
    """Touch the objects or load their readings, fit the estimator, do all trials and score them.

    jobs: processes for the trials. progress(stage, done, total) is called for the stages "press", "map" and "trials".

    Raises InputError for a configuration that does not fit together.
    """
    start = perf_counter()
    estimator = create(config.estimator, **config.set)  # a wrong option is reported before the work
    if not estimator.in_space:
        raise InputError(
            f"estimator {config.estimator} recognises objects in the plane; `bench list` names those for --task solids"
        )
    if config.explore == "information" and not estimator.proposes:
        raise proposes_none(config.estimator)
    scan, solids, work = gather_in_space(config, progress=progress)
    plan = SpacePlan(config, scan)

    tasks = tasks_of([one.name for one in solids], config.trials)

    fitting = perf_counter()
    trials, tried, fit_seconds = try_in_space(plan, estimator, tasks, jobs=jobs, progress=progress)
    end = perf_counter()
    spent = trials.update_s + trials.estimate_s + trials.propose_s
    about: dict[str, Any] = {
        "protocol": protocol_name(config),
        "objects": [one.name for one in solids],
        **about_estimator(estimator),
        "scan": dict(scan.meta),
        "readings_digest": scan.digest,
        "taxel_points": scan.taxel_points.tolist(),
        "versions": versions(),
        "commit": git_commit(),
        "machine": machine(),
    }
    times = {
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "jobs": jobs,
        "peak_memory_mb": peak_memory_mb(),
        "seconds": {
            "scan": fitting - start,
            "fit": fit_seconds,
            "trials": end - fitting - fit_seconds,
            "total": end - start,
            "update_per_touch": float(trials.update_s.mean()),
            "estimate_per_touch": float(trials.estimate_s.mean()),
            "propose_per_touch": float(trials.propose_s.mean()),
            "recognition": float(spent.sum(axis=1).mean()),
            "recognition_most": float(spent.sum(axis=1).max()),
        },
    }
    shapes = {one.name: Shape(one.vertices, one.faces, surface_of(one)) for one in solids}
    work = {**work, **tried, "skipped": work.get("skipped", {}) | tried["skipped"]}
    return SpaceRun(
        config.model_dump(mode="json"), about, shapes, work, trials, times, plan, surfaces_of(estimator)
    )


def protocol_name(config: SpaceConfig) -> str:
    """Name the protocol of a run; only results of one protocol share a table."""
    order = "touches from random sides" if config.explore == "random" else "touches chosen by information"
    return f"objects in space, {order}" + (f", hand {config.hand.stem}" if config.hand else "")


def gather_in_space(
    config: SpaceConfig, *, progress: Progress
) -> tuple[SpaceScan, list[Solid], dict[str, Any]]:
    """Touch the objects or load the readings: returns those of the run's objects, the objects, and the work.

    Raises InputError if an object has no training readings.
    """
    from tactsim.press.space import scan_solids

    solids = solids_of(config)
    if config.scan is None:
        scan, work = scan_solids(
            config.scan_options,
            progress=lambda done, total: progress("press", done, total),
        )
    else:
        scan, work = SpaceScan.load(config.scan), {"presses": 0, "skipped": {}}
    names = [one.name for one in solids]
    trained = scan.where("train").objects
    for name in names:
        if name not in trained:
            raise InputError(
                f"--scan {config.scan} holds no training readings of {name}; it has {', '.join(trained)}"
            )
    return scan.chosen(np.isin(scan.labels, names)), solids, work
