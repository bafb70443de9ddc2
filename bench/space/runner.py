"""Do one run with objects in space: touch or load, fit the estimator, do the trials, score them."""

from __future__ import annotations

from datetime import UTC, datetime
from time import perf_counter
from typing import Any

import numpy as np

from tactsim.bench.machine import machine, peak_memory_mb, versions
from tactsim.bench.runner import about_estimator, silent
from tactsim.bench.space.config import SpaceConfig
from tactsim.bench.space.plan import SpacePlan, run_trials, solids_of, surface_of
from tactsim.bench.space.run import Shape, SpaceRun
from tactsim.bench.space.trials import tasks_of
from tactsim.bench.trials import Progress
from tactsim.core.errors import InputError
from tactsim.core.source_digest import git_commit
from tactsim.core.space_scan import SpaceScan
from tactsim.estimators import create
from tactsim.estimators.estimator import proposes_none


def perform_in_space(
    config: SpaceConfig, *, jobs: int = 1, cache: bool = True, progress: Progress = silent
) -> SpaceRun:
    """Touch the objects or load their readings, fit the estimator, do all trials and score them.

    jobs: processes. cache: whether touches may be read from the cache and kept there. progress(stage, done, total) is
    called for the stages "press", "map" and "trials".

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
    solids = solids_of(config)
    scan, work = _scan(config, jobs, cache, progress)
    missing = [one.name for one in solids if one.name not in scan.where("train").objects]
    if missing:
        raise InputError(f"--scan {config.scan} holds no training readings of {missing[0]}")
    scan = scan.some(np.isin(scan.labels, [one.name for one in solids]))
    plan = SpacePlan(config, scan)

    fitting = perf_counter()
    progress("map", 0, 1)
    estimator.fit(scan)
    progress("map", 1, 1)

    trying = perf_counter()
    tasks = tasks_of([one.name for one in solids], config.trials)
    trials, tried = run_trials(plan, estimator, tasks, jobs=jobs, progress=progress)
    end = perf_counter()
    spent = trials.update_s + trials.estimate_s + trials.propose_s
    about: dict[str, Any] = {
        "protocol": protocol_name(config),
        "objects": [one.name for one in solids],
        **about_estimator(estimator),
        "scan": dict(scan.meta),
        "readings_digest": scan.digest,
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
            "fit": trying - fitting,
            "trials": end - trying,
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
    return SpaceRun(config.model_dump(mode="json"), about, shapes, work, trials, times, plan)


def protocol_name(config: SpaceConfig) -> str:
    """Name the protocol of a run; only results of one protocol share a table."""
    order = "touches from random sides" if config.explore == "random" else "touches chosen by information"
    return f"objects in space, {order}" + (f", hand {config.hand.stem}" if config.hand else "")


def _scan(
    config: SpaceConfig, jobs: int, cache: bool, progress: Progress
) -> tuple[SpaceScan, dict[str, Any]]:
    if config.scan is not None:
        return SpaceScan.load(config.scan), {"presses": 0, "skipped": {}}
    from tactsim.press.space import scan_solids

    return scan_solids(
        config.scan_options,
        jobs=jobs,
        cache=cache,
        progress=lambda done, total: progress("press", done, total),
    )
