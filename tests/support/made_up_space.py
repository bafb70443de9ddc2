"""A made-up run with objects in space, for tests that need one but no touch."""

import numpy as np

from tactsim.bench.report.recognition import Again
from tactsim.bench.results import Run
from tactsim.bench.trials import OneTrial, Touch
from tactsim.core import rigid
from tactsim.estimators.estimator import Estimate, PoseSamples
from tactsim.solids.kind import SpaceConfig
from tactsim.solids.score import SpaceTrials, Surface

OBJECTS = ("wedge", "block")
CORNERS = np.array([[0.0, 0, 0], [20, 0, 0], [0, 20, 0], [0, 0, 20]]) - 5
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def poses(rng, *shape):
    place = rng.normal(scale=5, size=(*shape, 3))
    rotation = rigid.random_rotations(int(np.prod(shape)), rng).reshape(*shape, 4)
    return np.concatenate([place, rotation], axis=-1)


def make_shape(scale=1.0):
    inside = np.random.default_rng(0).dirichlet(np.ones(3), size=48)
    points = np.concatenate([inside @ CORNERS[face] for face in FACES[:, [0, 1, 2]]])
    return Surface(scale * points, np.array([[1.0, 0, 0, 0]]), None, scale * CORNERS, FACES)


def make_space_trials(n=5, r=4, seed=0):
    rng = np.random.default_rng(seed)
    true = poses(rng, n)
    near = np.concatenate(
        [rng.normal(scale=0.5, size=(n, r, 3)), rigid.from_vector(rng.normal(scale=0.05, size=(n, r, 3)))],
        axis=-1,
    )
    return SpaceTrials(
        truth=np.resize(OBJECTS, n), known=np.full(n, True), trial=np.arange(n),
        true_pose=np.repeat(true[:, None], r, axis=1), start=poses(rng, n, r),
        touch_index=rng.integers(24, size=(n, r)),
        met=rng.integers(0, 2, size=(n, r)), label=rng.choice(OBJECTS, size=(n, r)), p_truth=rng.random((n, r)),
        p_label=rng.random((n, r)), pose=rigid.compose(near, true[:, None]),
        credibility=np.where(rng.random((n, r)) < 0.3, np.nan, rng.random((n, r))), radius_90=rng.random((n, r)),
        evaluations=rng.integers(10**9, size=(n, r)), update_s=rng.random((n, r)), estimate_s=rng.random((n, r)),
        propose_s=rng.random((n, r)), nees=rng.random((n, r)),
    )  # fmt: skip


def make_space_run(n=5, r=4, seed=0):
    taxel = np.stack(np.meshgrid(np.arange(6.0), np.arange(6.0)), axis=-1).reshape(-1, 2) * 2 - 5
    return Run(
        config=SpaceConfig(estimator="space-refined", trials=n, touches=r).model_dump(mode="json"),
        about={
            "letters": list(OBJECTS), "source": "0" * 64, "protocol": "objects in space, made up",
            "description": "made up", "options": {}, "settings": {}, "budget": None, "scan": {},
            "readings_digest": "0" * 64,
            "taxel_points": np.column_stack([taxel, np.zeros(36)]).tolist(), "versions": {"python": "3"},
            "commit": None, "machine": {"processor": "made up", "cores": 1, "system": "none"},
        },
        objects={"wedge": make_shape(), "block": make_shape(0.8)}, work={"presses": 3, "skipped": {"cached": 1}},
        trials=make_space_trials(n, r, seed),
        times={
            "seconds": dict.fromkeys(("scan", "fit", "trials", "total"), 1.0),
            "peak_memory_mb": 100.0,
        },
    )  # fmt: skip


def make_replayed(run, at=0, pads=2, kind="typical"):
    rng = np.random.default_rng(at)
    one = {name: values[at : at + 1] for name, values in vars(run.trials).items()}
    near = np.concatenate(
        [rng.normal(scale=1, size=(40, 3)), rigid.from_vector(rng.normal(scale=0.1, size=(40, 3)))], axis=-1
    )
    estimates = [
        Estimate(
            label, dict(zip(OBJECTS, p, strict=True)), pose,
            PoseSamples(rigid.compose(pose, near), np.full(40, 1 / 40)),
        )
        for label, p, pose in zip(
            one["label"][0], rng.dirichlet(np.ones(2), size=run.readings), run.trials.pose[at], strict=True
        )
    ]  # fmt: skip
    touches = [Touch(k, rng.uniform(0, 30, size=(pads, 36)), poses(rng, pads)) for k in range(run.readings)]
    trials = SpaceTrials(**one)
    task = OneTrial(str(trials.truth[0]), int(trials.trial[0]))
    return Again(task, kind, trials, estimates, touches, None)
