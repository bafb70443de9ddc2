"""Made-up bundles that have the trials of a real task, as good or as bad as one likes."""

from dataclasses import replace

import numpy as np
from made_up import make_run

from tactsim.bench.config import RunConfig
from tactsim.bench.leaderboard.bundle import DONE, Bundle, Record, bundle_hash, kept, write_record
from tactsim.bench.placement import Properties
from tactsim.bench.results import Run
from tactsim.bench.tasks import task
from tactsim.bench.trials import OneTrial, Trials, draw_true_pose, generator
from tactsim.core.checking import checked
from tactsim.core.poses import compose
from tactsim.estimators import NONE


def record_of(bundle, *, verified=True, said="all the same"):
    """Record beside the file of a bundle what came of doing 20 of its trials again."""
    record = Record(
        bundle=bundle_hash(bundle), verified=verified, said=said, again=20, trials=250, seed=7, commit="e" * 40,
        made="2026-01-02",
    )  # fmt: skip
    return write_record(record, bundle)


def entered(
    method, name="letters-offgrid-v1", *, skill=2.0, mm=1.0, seconds=1e-3, seed=0, bounds=False, **changes
):
    """Enter a method: letters right with logistic(skill * log2(readings) - 1), errors about `mm` in each direction.

    seed: of the luck that methods do not share; half of the luck of a trial is shared by all.
    """
    asked = task(name)
    status = changes.get("status", DONE)
    runs = (
        [_run(asked, of, method, skill, mm, seconds, seed, bounds) for of in asked.seeds]
        if status == DONE
        else []
    )
    said = {
        "task": name, "task_data": asked.data or "a" * 64, "method": method, "estimator": "histogram",
        "options": {"bins": 100}, "reproducible": True, "status": status, "versions": {"python": "3", "tactsim": "0.1"},
        "source_hash": "b" * 64, "machine": {"processor": "made up", "cores": 1, "system": "none"},
        "commit": "c" * 40, "made": "2026-01-01T00:00:00+00:00",
    }  # fmt: skip
    return checked(Bundle, {"package": None} | said | changes | {"runs": kept(runs)}, "bundle")


def _run(asked, of, method, skill, mm, seconds, seed, bounds):
    letters, r = asked.letters, asked.readings
    truth = np.repeat(letters, asked.trials)
    number = np.tile(np.arange(asked.trials), len(letters))
    n = len(truth)
    shared, own = np.random.default_rng(of), np.random.default_rng([of, seed, *method.encode()])
    luck = shared.logistic(size=(n, 1)) + own.logistic(size=(n, 1))
    right = luck < 2 * (skill * np.log2(1 + np.arange(r)) - 1)
    poses = [
        draw_true_pose(generator(of, OneTrial(str(letter), int(k)), 0))
        for letter, k in zip(truth, number, strict=True)
    ]
    true_pose = np.repeat(np.array(poses)[:, None], r, axis=1)
    spread = mm * (shared.normal(size=(n, 1, 2)) + own.normal(size=(n, r, 2)))
    step = np.concatenate([spread, 0.01 * own.normal(size=(n, r, 1))], axis=2)
    known = ~np.isin(truth, list(asked.words.get("hold_out", "")))
    answer = np.where(known, truth, NONE)
    other = np.roll(letters, 1)[np.searchsorted(letters, truth, sorter=np.argsort(letters))]
    trials = Trials(
        truth=truth, known=known, trial=number, true_pose=true_pose,
        touch_index=own.integers(192, size=(n, r)), label=np.where(right, answer[:, None], other[:, None]),
        p_truth=own.random((n, r)), p_label=own.random((n, r)), pose=compose(true_pose, step),
        credibility=own.random((n, r)), radius_90=own.random((n, r)), evaluations=own.integers(100, size=(n, r)),
        update_s=seconds * (1 + own.random((n, r))), estimate_s=np.zeros((n, r)), propose_s=np.zeros((n, r)),
        nees=own.random((n, r)),
    )  # fmt: skip
    words = {"hold_out": asked.words.get("hold_out", ()), "trials": asked.trials, "readings": r, "seed": of}
    config = RunConfig(estimator="histogram", **words).model_dump(mode="json")
    about = make_run().about | {"letters": list(letters), "description": "made up"}
    objects = {str(letter): Properties(1, (0.0, 0.0), 60.0) for letter in letters}
    bound = np.full((n, r), 0.3 * mm) if bounds else None
    return Run(
        config=config, about=about, objects=objects, work={}, trials=trials,
        times={"seconds": {"total": 1.0}, "peak_memory_mb": 300.0}, bounds=bound,
    )  # fmt: skip


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
