"""Do trials with an estimator behind the fence, in an order that it cannot know."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from queue import SimpleQueue
from threading import Event, Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactsim.bench.leaderboard.confined import Confined, Limits, NoScore, confined
from tactsim.bench.placement import properties
from tactsim.bench.trials import OneTrial, Progress, TrialPlan, Trials, run_trial
from tactsim.estimators.estimator import flatten_work, unflatten_work


@contextmanager
def confined_processes(
    name: str, options: Mapping[str, Any], jobs: int = 1, limits: Limits | None = None
) -> Iterator[list[Confined]]:
    """Start `jobs` processes with an estimator each, for all runs of a method. Raises as `confined` does."""
    with ExitStack() as stack:
        yield [stack.enter_context(confined(name, options, limits or Limits())) for _ in range(jobs)]


def run_trials_confined(
    plan: TrialPlan,
    tasks: Sequence[OneTrial],
    processes: Sequence[Confined],
    *,
    rng: np.random.Generator,
    progress: Progress,
) -> tuple[Trials, dict[str, Any]]:
    """Do trials as `trials.run_trials` does, behind fences, in an order that `rng` draws.

    processes: with the estimator of `plan`. Returns the trials in the order of `tasks`, and the work, summed.
    Raises NoScore if the estimator fails in one of the trials; all processes have then ended.
    """
    tests = {truth: plan.scan.where("test", truth) for truth in {task.truth for task in tasks}}
    objects = properties(plan.scan)
    order = rng.permutation(len(tasks))
    if plan.each_held_out:  # a letter that is not known takes another fit
        truths = dict.fromkeys(task.truth for task in tasks)
        parts = [order[[tasks[i].truth == truth for i in order]] for truth in truths]
    else:
        parts = [part for part in np.array_split(order, len(processes)) if len(part)]
    idle: SimpleQueue[Confined] = SimpleQueue()
    for one in processes:
        idle.put(one)
    found: list[Trials | None] = [None] * len(tasks)
    work: Counter[str] = Counter()
    lock, stop = Lock(), Event()
    done = 0
    progress("trials", 0, len(tasks))

    def do(part: NDArray[np.int64]) -> None:
        nonlocal done
        known = plan.letters_known(tasks[part[0]].truth)
        estimator = idle.get()
        estimator.fit(plan.scan.of_letters(known) if plan.each_held_out else plan.scan)
        before = Counter(flatten_work(estimator.work))
        for i in part:
            if stop.is_set():
                return
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
        idle.put(estimator)

    with ThreadPoolExecutor(len(processes)) as threads:
        futures = [threads.submit(do, part) for part in parts]
        try:
            for future in futures:
                future.result()
        except BaseException:
            stop.set()
            for future in futures:
                future.cancel()
            for one in processes:
                one.end()
            raise
    return Trials.joined(one for one in found if one is not None), unflatten_work(work)
