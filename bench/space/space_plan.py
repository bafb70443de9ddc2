"""`SpacePlan`: all that a worker needs to do trials in space, and the workers that do them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cached_property
from time import perf_counter
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from tactsim.bench.space.pads import pads
from tactsim.bench.space.space_config import SpaceConfig
from tactsim.bench.space.space_trials import SpaceTask, SpaceTrials, run_trial
from tactsim.bench.space.surface_distance import POINTS, Surface
from tactsim.bench.trials import Progress
from tactsim.core.seeds import stream
from tactsim.core.space_scan import SpaceScan
from tactsim.core.workers import batches, wait_for, worker_processes
from tactsim.estimators import Estimator, create
from tactsim.estimators.estimator import flatten_work, no_exit, unflatten_work

if TYPE_CHECKING:
    from tactsim.models import Solid


@dataclass(frozen=True, eq=False)
class SpacePlan:
    """What is tried: the configuration and the readings that are learned from. It can be sent to another process."""

    config: SpaceConfig
    scan: SpaceScan

    @cached_property
    def solids(self) -> list[Solid]:
        """Build the solids and read the meshes. Raises InputError for one that does not exist or is none."""
        return solids_of(self.config)

    @cached_property
    def surfaces(self) -> dict[str, Surface]:
        """Give what the distance needs of each solid."""
        return {one.name: surface_of(one) for one in self.solids}

    def fitted(self) -> Estimator:
        """Make the estimator and fit it."""
        estimator = create(self.config.estimator, **self.config.set)
        fit_in_space(estimator, self.scan)
        return estimator

    def run(
        self, estimator: Estimator, tasks: Sequence[SpaceTask], report: Callable[[int], None]
    ) -> tuple[SpaceTrials, dict[str, int]]:
        """Do trials here with the fitted estimator; returns them and its work, flattened, without that of fitting.

        report: called with how many are done, from 0.
        """
        press = pads(self.solids, self.config)
        labels = self.scan.objects
        before = Counter(flatten_work(estimator.work))
        parts = []
        with no_exit(self.config.estimator):
            for done, task in enumerate(tasks):
                report(done)
                parts.append(
                    run_trial(
                        estimator, press, task, self.surfaces[task.truth], labels=labels,
                        touches=self.config.touches, seed=self.config.seed, explore=self.config.explore,
                    )
                )  # fmt: skip
            work = Counter(flatten_work(estimator.work))
        report(len(tasks))
        work.subtract(before)
        return SpaceTrials.joined(parts), dict(work)


def fit_in_space(estimator: Estimator, scan: SpaceScan) -> None:
    """Fit an estimator of objects in space: its `fit` takes a `SpaceScan` where the others' take a `Scan`."""
    with no_exit(estimator):
        cast("Any", estimator).fit(scan)


def solids_of(config: SpaceConfig) -> list[Solid]:
    """Build the solids of a run and read its meshes. Raises InputError for one that does not exist or is none."""
    from tactsim.press.space import solids_of as pressed

    return pressed(config.scan_options)


def surface_of(solid: Solid) -> Surface:
    """Take from a solid what the distance needs; the points are the same whatever else is tried."""
    points, _ = solid.sample_surface(POINTS, stream(0, solid.name, "surface distance"))
    return Surface(points, np.asarray(solid.symmetry.rotations), solid.symmetry.axis)


def try_in_space(
    plan: SpacePlan, estimator: Estimator, tasks: list[SpaceTask], *, jobs: int, progress: Progress
) -> tuple[SpaceTrials, dict[str, Any], float]:
    """Fit the estimator and do the trials; with several jobs in worker processes, which fit their own meanwhile.

    Returns the trials in the order of `tasks`, the estimators' work, summed, and the seconds that the fit took; but for
    these it does not depend on `jobs`.
    """
    begin = perf_counter()
    with nullcontext() if jobs == 1 else worker_processes(min(jobs, len(tasks))) as executor:
        sent = []
        if executor is not None:
            parts = batches(tasks, jobs)
            sent = [(len(part), executor.submit(_run_chunk, plan, part)) for part in parts]
        progress("map", 0, 1)
        fit_in_space(estimator, plan.scan)
        progress("map", 1, 1)
        fitting = perf_counter() - begin
        if executor is None:
            results = [plan.run(estimator, tasks, lambda done: progress("trials", done, len(tasks)))]
        else:
            results = wait_for(sent, lambda done, total: progress("trials", done, total))
    work: Counter[str] = Counter()
    for _, of_part in results:
        work.update(of_part)
    return SpaceTrials.joined(trials for trials, _ in results), unflatten_work(work), fitting


_fitted: dict[str, tuple[SpacePlan, Estimator]] = {}  # of a worker process: the plan that it works on


def _run_chunk(plan: SpacePlan, tasks: list[SpaceTask]) -> tuple[SpaceTrials, dict[str, int]]:
    """Do some trials in a worker process, which fits an estimator once for all chunks of a plan."""
    key = f"{plan.config.digest} {plan.scan.digest}"
    if key not in _fitted:
        _fitted.clear()
        _fitted[key] = plan, plan.fitted()
    kept, estimator = _fitted[key]
    return kept.run(estimator, tasks, lambda done: None)
