"""A made-up run, for tests that need one but not a pressed letter."""

import numpy as np

from tactsim.bench.config import RunConfig
from tactsim.bench.placement import Properties
from tactsim.bench.results import Run
from tactsim.bench.trials import Trials


def make_run(n=3, r=4, seed=0):
    rng = np.random.default_rng(seed)
    trials = Trials(
        truth=np.resize(["A", "E"], n), known=np.ones(n, dtype=bool), trial=np.arange(n) // 2,
        true_pose=np.repeat(rng.normal(size=(n, 1, 3)), r, axis=1), touch_index=rng.integers(192, size=(n, r)),
        label=rng.choice(["A", "E"], size=(n, r)), p_truth=rng.random((n, r)), p_label=rng.random((n, r)),
        pose=rng.normal(size=(n, r, 3)), credibility=rng.random((n, r)),
        radius_90=rng.random((n, r)), evaluations=rng.integers(10**9, size=(n, r)),
        update_s=rng.random((n, r)), estimate_s=rng.random((n, r)), propose_s=rng.random((n, r)),
        nees=rng.random((n, r)),
    )  # fmt: skip
    objects = {"A": Properties(1, (0.0, 0.0), 60.0), "E": Properties(0, (0.1, 0.2), 55.0)}
    return Run(
        config=RunConfig(estimator="histogram", trials=2, readings=r).model_dump(mode="json"), objects=objects,
        about={
            "letters": ["A", "E"], "protocol": "test poses same, random order", "description": "made up",
            "options": {"bins": 10_000}, "settings": {}, "budget": {"option": "bins", "value": 10_000},
            "classifier_agreement": None, "scan": {}, "source": "0" * 64, "commit": None, "versions": {"python": "3"},
            "machine": {"processor": "made up", "cores": 1, "system": "none"},
        },
        work={"presses": 3, "skipped": {"cached": 1}}, trials=trials,
        times={"seconds": {"total": 1.5}, "peak_memory_mb": 300.0},
    )  # fmt: skip
