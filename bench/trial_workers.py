"""Do the trials of a plan, here and in worker processes that fit an estimator once and keep it."""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import groupby
from typing import Any, TypeAlias

from tactsim.bench.in_chunks import begun
from tactsim.bench.placement_error import properties
from tactsim.bench.trial_plan import TrialPlan
from tactsim.bench.trials import OneTrial, Progress, Trials, run_trial
from tactsim.bench.work_counts import flatten_work, unflatten_work
from tactsim.estimators import Estimator
from tactsim.estimators.estimator import no_exit

FinishTrials: TypeAlias = Callable[[Estimator, Progress], tuple[Trials, dict[str, Any]]]


@contextmanager
def begun_trials(plan: TrialPlan, tasks: list[OneTrial], *, jobs: int) -> Iterator[FinishTrials]:
    """Begin with trials in `jobs` - 1 worker processes, which fit their own estimators while one is fitted here.

    Gives a function that takes the estimator, fitted, and `progress`, and does all that is left. It returns the trials
    in the order of `tasks` and the estimators' work, summed. The results do not depend on `jobs`.
    """

    def finish(estimator: Estimator, progress: Progress) -> tuple[Trials, dict[str, Any]]:
        parts, work = others.finish(partial(_run_here, plan, estimator), progress)
        return Trials.joined(parts), unflatten_work(work)

    # Where each letter is held out, its trials share an estimator that was fitted without it.
    group = (lambda task: task.truth) if plan.each_held_out else None
    there = partial(run_chunk, plan.portable() if jobs > 1 else plan)
    with begun(there, tasks, jobs=jobs, group=group) as others:
        yield finish


def run_trials(
    plan: TrialPlan, estimator: Estimator, tasks: list[OneTrial], *, progress: Progress
) -> tuple[Trials, dict[str, Any]]:
    """Do all trials here with a fitted estimator; returns them in the order of `tasks`, and the estimator's work."""
    progress("trials", 0, len(tasks))
    trials, work = _run_here(plan, estimator, tasks, lambda done: progress("trials", done, len(tasks)))
    return trials, unflatten_work(work)


def _run_here(
    plan: TrialPlan, estimator: Estimator, tasks: list[OneTrial], report: Callable[[int], None]
) -> tuple[Trials, dict[str, int]]:
    """Do some trials here; returns them, and the work without that of fitting, flattened."""
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
    return Trials.joined(parts), dict(work)


def run_chunk(plan: TrialPlan, tasks: list[OneTrial]) -> tuple[Trials, dict[str, int]]:
    """Do some trials in a worker process; an estimator is fitted once for all chunks of a plan.

    Returns the trials in the order of `tasks`, and the flattened work without that of fitting.
    """
    return _run_here(plan, _fitted(plan), tasks, lambda done: None)


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
