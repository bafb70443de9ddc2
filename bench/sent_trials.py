"""Trials in other processes: each fits an estimator of its own from a `TrialPlan`, and the results are the same."""

from __future__ import annotations

import hashlib
import json
import pickle
import threading
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import Executor, Future
from dataclasses import replace
from itertools import groupby
from typing import Any, TypeAlias

from tactsim.bench.trials import OneTrial, Progress, TrialPlan, Trials, compile_for, fit, run_trials, silent
from tactsim.core.errors import InputError
from tactsim.core.workers import batches, wait_for
from tactsim.estimators import Estimator, create
from tactsim.estimators.estimator import about_estimator, flatten_work, unflatten_work
from tactsim.estimators.registry import load

# Trials, the work that they took, and what `about_estimator` says of the fitted estimator.
Done: TypeAlias = tuple[Trials, dict[str, Any], dict[str, Any]]
TrialsDone: TypeAlias = "Future[Done]"

# What a worker fitted last. A worker of Dask may have several threads, each with its own.
_last = threading.local()


def send_trials(
    executor: Executor, plan: TrialPlan, tasks: Sequence[OneTrial], parts: int
) -> list[tuple[int, TrialsDone]]:
    """Let worker processes begin with trials; they fit estimators of their own, and the results are the same.

    parts: how many at most. Where each letter is held out, its trials are sent together, since they share an estimator
    that was fitted without it. Returns for each part how many trials it has, and what will be its result. Raises
    InputError for an estimator that cannot be sent.
    """
    plan = _portable(plan)
    if plan.given is None:
        compile_for(load(plan.estimator))  # once, not in each of them
    if plan.rules.each_held_out:
        divided = [list(alike) for _, alike in groupby(tasks, key=lambda task: task.truth)]
    else:
        divided = batches(tasks, parts)
    return [(len(part), executor.submit(run_part, plan, part)) for part in divided]


def received_trials(sent: Sequence[tuple[int, TrialsDone]], progress: Progress) -> Done:
    """Wait for trials that were sent; returns them in their order, the estimators' work, summed, and what one says.

    Raises what a trial raised, as soon as it did, and concurrent.futures.BrokenExecutor if a worker died.
    """
    results = wait_for(sent, lambda done, total: progress("trials", done, total))
    work: Counter[str] = Counter()
    for _, of_part, _ in results:
        work.update(flatten_work(of_part))
    return Trials.joined(trials for trials, *_ in results), unflatten_work(work), results[0][2]


def run_part(plan: TrialPlan, tasks: Sequence[OneTrial]) -> Done:
    """Do some trials in a worker; the estimator that it fitted last does the parts of one plan that follow."""
    options = json.dumps(plan.options, sort_keys=True, default=str)
    given = hashlib.sha256(plan.given).hexdigest() if isinstance(plan.given, bytes) else ""
    digest = f"{plan.estimator} {options} {plan.scan.digest} {given}"
    if getattr(_last, "digest", None) != digest:
        _last.estimator, _last.digest = fit_plan(plan), digest
        _last.about = about_estimator(_last.estimator)
    return (*run_trials(plan, _last.estimator, tasks, progress=silent), _last.about)


def fit_plan(plan: TrialPlan) -> Estimator:
    """Make the estimator of a plan and fit it.

    Raises InputError as `fit` does, and if it does not exist, or was given and cannot be made in another process.
    """
    if isinstance(plan.given, bytes):
        try:
            estimator: Estimator = pickle.loads(plan.given)
        except Exception as error:  # a user's class may raise anything when it is unpickled
            raise _not_portable(plan.estimator, error) from error
    else:
        estimator = create(plan.estimator, **plan.options) if plan.given is None else plan.given
    fit(estimator, plan.scan, plan.forward)
    return estimator


def _portable(plan: TrialPlan) -> TrialPlan:
    """Return a plan that can be sent to worker processes. Raises InputError if the estimator cannot be."""
    if plan.given is None or isinstance(plan.given, bytes):
        return plan
    try:
        return replace(plan, given=pickle.dumps(plan.given))
    except Exception as error:  # a user's class may raise anything when it is pickled
        raise _not_portable(plan.estimator, error) from error


def _not_portable(name: str, error: Exception) -> InputError:
    return InputError(
        f"a worker process cannot make the estimator {name} ({type(error).__name__}: {error}); "
        "define its class in a module that can be imported, or use jobs=1"
    )
