"""A made-up bundle."""

from dataclasses import replace

from made_up import make_run

from tactsim.bench.leaderboard.bundle import DONE, Bundle, kept
from tactsim.core.checking import checked


def make_bundle(seeds=(0, 1), **changes):
    runs = []
    for seed in seeds:
        run = make_run(seed=seed)
        runs.append(replace(run, config=run.config | {"seed": seed}))
    said = {
        "task": "letters-offgrid-v1", "task_data": "a" * 64, "method": "Histogram, 10,000 bins",
        "estimator": "histogram", "options": {"bins": 10_000}, "reproducible": True, "status": DONE,
        "versions": {"python": "3"},
        "source_hash": "b" * 64, "machine": {"processor": "made up", "cores": 1, "system": "none"}, "commit": None,
        "made": "2026-01-01T00:00:00+00:00",
    }  # fmt: skip
    return checked(Bundle, {"package": None} | said | changes | {"runs": kept(runs)}, "bundle")


def changed(bundle, **words):
    return checked(Bundle, dict(bundle) | words, "bundle")
