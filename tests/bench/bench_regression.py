"""Times as ratios to a NumPy reference, and errors, of pressing, mapping, every update and a whole run.

`make bench-check` holds them against `results/baseline.json`.
"""

from time import process_time

import numpy as np
import pytest

from tactsim.bench import score
from tactsim.bench.config import run_config
from tactsim.bench.fitting import fit
from tactsim.bench.placement_error import properties
from tactsim.bench.runner import perform
from tactsim.bench.trials import Task, run_trial
from tactsim.estimators import create
from tactsim.estimators.registry import BUILT_IN
from tactsim.press import ScanOptions, forward_model, scan_letters

pytestmark = pytest.mark.benchmark
READINGS = 30


@pytest.fixture(scope="session")
def scan():
    return scan_letters(ScanOptions(), cache=False)[0]


class Reference:
    """A fixed piece of NumPy work: gather 36 taxels of 10,000 states from a map and sum their logs."""

    def __init__(self):
        rng = np.random.default_rng(0)
        self.map = rng.random((80, 80)) + 0.1
        self.places = rng.integers(80 * 80, size=(10_000, 36))

    def __call__(self):
        return np.log(self.map.ravel()[self.places]).sum(axis=1)


@pytest.fixture
def against_reference(benchmark):
    """Measure a function in rounds; each round measures the reference too, and the ratio is kept."""
    reference = Reference()

    def measure(work, rounds=15):
        start = process_time()
        result = work()  # the warm-up
        lasts = process_time() - start
        start = process_time()
        reference()
        # As long as the work itself, within reason, so that both meet the same disturbances.
        repeats = max(1, min(100, round(lasts / (process_time() - start))))
        seconds = []

        def before():
            start = process_time()
            for _ in range(repeats):
                reference()
            seconds.append((process_time() - start) / repeats)

        result = benchmark.pedantic(work, setup=before, rounds=rounds, warmup_rounds=0)
        ratios = np.array(benchmark.stats.stats.data) / seconds
        benchmark.extra_info["ratio"] = float(np.quantile(ratios, 0.25))
        return result

    return measure


def test_press(benchmark, against_reference):
    scan, _ = against_reference(lambda: scan_letters(ScanOptions(letters=("A",)), cache=False))
    benchmark.extra_info["mean_kpa"] = float(scan.readings.mean())


def test_map(benchmark, against_reference, scan):
    estimator = create("histogram")
    against_reference(lambda: estimator.fit(scan))
    maps = estimator.maps.values()
    benchmark.extra_info["mean_log_odds"] = float(np.mean([np.abs(m.log_odds).mean() for m in maps]))


@pytest.mark.parametrize("name", BUILT_IN)
def test_trial(benchmark, against_reference, scan, name):
    estimator = create(name)
    fit(estimator, scan, forward_model)
    test, objects = scan.where("test", "A"), properties(scan)
    trial = against_reference(
        lambda: run_trial(
            estimator,
            test,
            Task("A", 0),
            letters=estimator.labels,
            readings=READINGS,
            seed=0,
            of=objects["A"],
        )
    )
    errors = score.errors(trial, objects)[0]
    benchmark.extra_info["error_mm"] = float(errors[-1])
    benchmark.extra_info["mean_p_truth"] = float(trial.p_truth.mean())


def test_run(benchmark, against_reference):
    config = run_config(estimator="histogram", bins=1000, trials=2, readings=READINGS)
    run = against_reference(lambda: perform(config, cache=False), rounds=7)
    benchmark.extra_info["error_all_mm"] = run.summary["error_all_mm"][-1]
    benchmark.extra_info["accuracy"] = float(np.mean(run.summary["accuracy"]))
