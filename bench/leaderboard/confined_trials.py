"""Do trials with an estimator behind the fence, in an order that it cannot know."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from threading import Event, Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactsim.bench.leaderboard.confined import Confined, Limits, NoScore, confined
from tactsim.bench.placement_error import properties
from tactsim.bench.trial_plan import TrialPlan
from tactsim.bench.trials import Progress, Task, Trials, run_trial
from tactsim.bench.work_counts import flatten_work, unflatten_work


def run_trials_confined(
    plan: TrialPlan,
    tasks: Sequence[Task],
    *,
    rng: np.random.Generator,
    jobs: int = 1,
    limits: Limits | None = None,
    progress: Progress,
) -> tuple[Trials, dict[str, Any], Confined]:
    """Do trials as `trial_workers.run_trials` does, in `jobs` processes behind fences, in an order that `rng` draws.

    Returns the trials in the order of `tasks`, the work, summed, and an estimator that tells how it is set up.
    Raises InputError as `confined` does, and NoScore if the estimator fails in one of the trials.
    """
    limits = limits or Limits()
    tests = {truth: plan.scan.where("test", truth) for truth in {task.truth for task in tasks}}
    objects = properties(plan.scan)
    order = rng.permutation(len(tasks))
    if plan.each_held_out:  # one process for each letter that is not known
        truths = dict.fromkeys(task.truth for task in tasks)
        parts = [order[[tasks[i].truth == truth for i in order]] for truth in truths]
    else:
        parts = [part for part in np.array_split(order, min(jobs, len(tasks))) if len(part)]
    found: list[Trials | None] = [None] * len(tasks)
    work: Counter[str] = Counter()
    lock, stop, running = Lock(), Event(), list[Confined]()
    done = 0
    progress("trials", 0, len(tasks))

    def do(part: NDArray[np.int64]) -> Confined:
        nonlocal done
        known = plan.letters_known(tasks[part[0]].truth)
        scan = plan.scan.of_letters(known) if plan.each_held_out else plan.scan
        with confined(plan.estimator, plan.options, scan, limits) as estimator:
            running.append(estimator)
            estimator.fit(scan)
            before = Counter(flatten_work(estimator.work))
            for i in part:
                if stop.is_set():
                    break
                task = tasks[i]
                try:
                    found[i] = run_trial(
                        estimator, tests[task.truth], task, letters=known, readings=plan.readings, seed=plan.seed,
                        of=objects[task.truth], explore=plan.explore, slip=plan.slip, press=plan.press,
                        clock=estimator.clock,
                    )  # fmt: skip
                except NoScore as error:
                    place = f"seed {plan.seed}, letter {task.truth}, trial {task.trial}"
                    raise NoScore(f"{error.status}; {place}", error.output) from error
                with lock:
                    done += 1
                    progress("trials", done, len(tasks))
            with lock:
                work.update(flatten_work(estimator.work))
                work.subtract(before)
        return estimator

    with ThreadPoolExecutor(jobs) as threads:
        futures = [threads.submit(do, part) for part in parts]
        try:
            estimators = [future.result() for future in futures]
        except BaseException:
            stop.set()
            for future in futures:
                future.cancel()
            for one in running:
                one.end()
            raise
    return Trials.joined(one for one in found if one is not None), unflatten_work(work), estimators[0]
