"""Counts of work, nested and flat."""

from tactsim.estimators.estimator import flatten_work, unflatten_work


def test_work_survives_flattening():
    work = {"likelihood_evaluations": 3, "skipped": {"cached": 2, "far": 0}}
    assert flatten_work(work) == {"likelihood_evaluations": 3, "skipped.cached": 2, "skipped.far": 0}
    assert unflatten_work(flatten_work(work)) == work
