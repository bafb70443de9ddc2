"""What the regression gate times: pressing, mapping, a trial of every estimator and a whole run.

`make bench-check` runs this file with the code of the baseline's commit and with the code as it is now, in
turns. `BENCHMARKS` holds what prepares a benchmark: it returns the work, and what gives the figures of the
work's result, which are the same for the same seed. A benchmark whose work changes gets a new name.
"""

from functools import cache, partial

import numpy as np

from tactsim.bench import score
from tactsim.bench.config import run_config
from tactsim.bench.experiment import perform
from tactsim.bench.placement import properties
from tactsim.bench.trials import OneTrial, fit, run_trial
from tactsim.estimators import create
from tactsim.estimators.registry import BUILT_IN, load
from tactsim.press import ScanOptions, forward_model, scan_letters

READINGS = 20
LETTERS = ("A", "O")  # so that one check takes half a minute of processor time


@cache
def scan():
    return scan_letters(ScanOptions(letters=LETTERS), cache=False)[0]


def press():
    work = partial(scan_letters, ScanOptions(letters=("A",)), cache=False)
    return work, lambda result: {"mean_kpa": result[0].readings.mean()}


def occupancy_maps():
    estimator = create("histogram")

    def figures(_):
        return {"mean_log_odds": np.mean([np.abs(m.log_odds).mean() for m in estimator.maps.values()])}

    return partial(estimator.fit, scan()), figures


def trial(name):
    estimator = create(name)
    fit(estimator, scan(), forward_model)
    objects = properties(scan())
    task = {"letters": estimator.labels, "readings": READINGS, "seed": 0, "of": objects["A"]}

    def figures(trial):
        error = score.errors(trial, objects)[0][-1]
        return {"error_mm": error, "mean_p_truth": trial.p_truth.mean()}

    return partial(run_trial, estimator, scan().where("test", "A"), OneTrial("A", 0), **task), figures


def whole_run():
    config = run_config(estimator="histogram", bins=1000, letters=("A",), trials=2, readings=READINGS)

    def figures(run):
        return {
            "error_all_mm": run.summary["error_all_mm"][-1],
            "accuracy": np.mean(run.summary["accuracy"]),
        }

    return partial(perform, config, cache=False), figures


BENCHMARKS = {
    "press": press,
    "occupancy maps": occupancy_maps,
    **{f"trial of {name}": partial(trial, name) for name in BUILT_IN if not load(name).in_space},
    "whole run": whole_run,
}
