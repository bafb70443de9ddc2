"""Do the trials of a plan, here or in worker processes that fit an estimator once and keep it."""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Callable
from functools import partial
from itertools import groupby
from typing import Any

from tactsim.bench.in_chunks import done_in_chunks
from tactsim.bench.placement_error import properties
from tactsim.bench.trial_plan import TrialPlan
from tactsim.bench.trials import OneTrial, Progress, Trials, run_trial
from tactsim.bench.work_counts import flatten_work, unflatten_work
from tactsim.estimators import Estimator
from tactsim.estimators.estimator import no_exit


def run_trials(
    plan: TrialPlan, estimator: Estimator, tasks: list[OneTrial], *, jobs: int = 1, progress: Progress
) -> tuple[Trials, dict[str, Any]]:
    """Do all trials, here with the fitted `estimator` or in `jobs` processes that fit their own.

    Returns the trials in the order of `tasks` and the estimators' work, summed. The results do not
    depend on `jobs`.
    """
    if jobs == 1 or len(tasks) == 1:
        progress("trials", 0, len(tasks))
        return _run_here(plan, estimator, tasks, lambda done: progress("trials", done, len(tasks)))
    parts, work = done_in_chunks(partial(run_chunk, plan.portable()), tasks, jobs=jobs, progress=progress)
    return Trials.joined(parts), unflatten_work(work)


def _run_here(
    plan: TrialPlan, estimator: Estimator, tasks: list[OneTrial], report: Callable[[int], None]
) -> tuple[Trials, dict[str, Any]]:
    tests = {truth: plan.scan.where("test", truth) for truth in {task.truth for task in tasks}}
    objects = properties(plan.scan)
    work: Counter[str] = Counter()
    parts = []
    with no_exit(plan.estimator):
        for truth, of_letter in groupby(tasks, key=lambda task: task.truth):
            fitted, letters = plan.fitted_for(truth, estimator), plan.letters_known(truth)
            before = Counter(flatten_work(fitted.work))
            for task in of_letter:
                parts.append(
                    run_trial(
                        fitted, tests[truth], task, letters=letters,
                        readings=plan.readings, seed=plan.seed, of=objects[truth], explore=plan.explore,
                        slip=plan.slip, press=plan.press,
                    )
                )  # fmt: skip
                report(len(parts))
            work.update(flatten_work(fitted.work))
            work.subtract(before)
    return Trials.joined(parts), unflatten_work(work)


def run_chunk(plan: TrialPlan, tasks: list[OneTrial]) -> tuple[Trials, dict[str, int]]:
    """Do some trials in a worker process; an estimator is fitted once for all chunks of a plan.

    Returns the trials in the order of `tasks`, and the flattened work without that of fitting.
    """
    trials, work = _run_here(plan, _fitted(plan), tasks, lambda done: None)
    return trials, flatten_work(work)


_memo: OrderedDict[str, Estimator] = OrderedDict()  # a worker process's fitted estimators, newest last
_MEMO_SIZE = 4


def _fitted(plan: TrialPlan) -> Estimator:
    key = plan.digest
    if key not in _memo:
        _memo[key] = plan.fitted()
        if len(_memo) > _MEMO_SIZE:
            _memo.popitem(last=False)
    _memo.move_to_end(key)
    return _memo[key]
