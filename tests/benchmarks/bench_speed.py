"""What `make bench` times: a press, maps, the readings of every estimator and a whole run, with the errors they give.

The same seed gives the same figures, which `extra_info` holds beside the machine and the commit. A benchmark whose
work changes gets a new name. `make bench-check` compares an earlier commit with the working tree (check.py).
"""

import os
import time
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest

import tactsim
from tactsim.bench import score
from tactsim.bench.config import run_config
from tactsim.bench.experiment import perform
from tactsim.bench.placement import properties
from tactsim.bench.trials import OneTrial, fit, run_trial
from tactsim.estimators import create
from tactsim.estimators.registry import BUILT_IN, load
from tactsim.press import ScanOptions, forward_model, scan_letters

# Processor time, since another program on the machine lengthens the time on the clock.
pytestmark = [pytest.mark.benchmark(timer=time.process_time)]
READINGS = 20
ROUNDS = int(os.environ.get("BENCH_ROUNDS", "10"))
PLANE = [name for name in BUILT_IN if load(name).KIND == "plane"]

# Whoever times an earlier commit must not time this one.
assert Path(tactsim.__file__).resolve().is_relative_to(Path(__file__).resolve().parents[2])


@cache
def scan():
    return scan_letters(ScanOptions(letters=("A", "O")), cache=False)[0]


def measure(benchmark, work):
    """Time the work after one call that warms up; gives its result."""
    return benchmark.pedantic(work, rounds=ROUNDS, warmup_rounds=1)


def test_press(benchmark):
    pressed, _ = measure(benchmark, partial(scan_letters, ScanOptions(letters=("A",)), cache=False))
    benchmark.extra_info["mean_kpa"] = float(pressed.readings.mean())


def test_occupancy_maps(benchmark):
    estimator = create("histogram")
    measure(benchmark, partial(estimator.fit, scan()))
    odds = [np.abs(chart.log_odds).mean() for chart in estimator.maps.values()]
    benchmark.extra_info["mean_log_odds"] = float(np.mean(odds))


@pytest.mark.parametrize("name", PLANE)
def test_twenty_readings(benchmark, name):
    estimator = create(name)
    fit(estimator, scan(), forward_model)
    objects, test = properties(scan()), scan().where("test", "A")
    task = {"letters": estimator.labels, "readings": READINGS, "seed": 0, "of": objects["A"]}
    trial = measure(benchmark, partial(run_trial, estimator, test, OneTrial("A", 0), **task))
    benchmark.extra_info["error_mm"] = float(score.errors(trial, objects)[0][-1])
    benchmark.extra_info["mean_p_truth"] = float(trial.p_truth.mean())


def test_whole_run(benchmark):
    config = run_config(estimator="histogram", bins=1000, letters=("A",), trials=2, readings=READINGS)
    summary = measure(benchmark, partial(perform, config, cache=False)).summary
    benchmark.extra_info["error_all_mm"] = summary["error_all_mm"][-1]
    benchmark.extra_info["accuracy"] = float(np.mean(summary["accuracy"]))
