"""Active touch around a filter: what it proposes, and that proposing changes nothing."""

import numpy as np
import pytest
from synthetic import CHEAPER, draw_trial, fitted, make_scan, paper_poses

from tactsim import estimators
from tactsim.core import InputError
from tactsim.estimators.filters import active_touch
from tactsim.estimators.filters.map_filter import MapFilter
from tactsim.estimators.likelihoods.calibrated import CalibratedLikelihood
from tactsim.estimators.registry import BUILT_IN, load

FILTERS = [name for name in BUILT_IN if issubclass(load(name), MapFilter)]


@pytest.fixture(scope="module")
def scan():
    return make_scan("EIL", poses=paper_poses(positions=4, angles=6))


@pytest.mark.parametrize("name", FILTERS)
def test_proposing_changes_no_estimate_and_depends_on_the_seed_alone(name, scan):
    estimator = fitted(name, scan, **CHEAPER.get(name, {}))
    readings, poses = draw_trial(scan, "L", 3, np.random.default_rng(6))[:2]

    def sequence(propose):
        estimator.reset(np.random.default_rng(7))
        chosen, said = [], []
        for reading, pose in zip(readings, poses, strict=True):
            if propose:
                chosen.append(estimator.propose(poses))
            estimator.update(reading, pose)
            estimate = estimator.estimate()
            said.append((estimate.label, dict(estimate.probabilities), estimate.robot_in_object.tolist()))
        return chosen, said

    proposed, said = sequence(True)
    assert (proposed, said) == sequence(True)
    assert said == sequence(False)[1]


@pytest.mark.parametrize(
    "candidates", [[], np.empty((0, 3)), [1.0, 2.0, 3.0], [[0.0, 0.0]], [[0.0, np.nan, 0.0]]]
)
def test_candidates_that_are_no_poses_are_refused(scan, candidates):
    estimator = estimators.create("histogram", bins=100)
    estimator.fit(scan)
    estimator.reset(np.random.default_rng(0))
    with pytest.raises(InputError, match="candidates"):
        estimator.propose(candidates)


@pytest.mark.parametrize("unknown", [{}, {"unknown": 0.2}])
@pytest.mark.parametrize("likelihood", ["paper", "calibrated", "force"])
def test_the_calibrated_model_is_learned_at_most_once_and_readings_are_let_go(
    scan, likelihood, unknown, monkeypatch
):
    learned, planned = [], []
    fit, planner = CalibratedLikelihood.fit, active_touch.Planner
    monkeypatch.setattr(CalibratedLikelihood, "fit", lambda *args: (learned.append(args[0]), fit(*args)))
    monkeypatch.setattr(active_touch, "Planner", lambda *args: (planned.append(args[0]), planner(*args))[1])
    estimator = estimators.create("refined", bins=100, cell=0.8, likelihood=likelihood, **unknown)
    estimator.fit(scan.untrained("I"))
    for seed in range(2):
        estimator.reset(np.random.default_rng(seed))
        estimator.propose(scan.poses[:3])
    assert len(learned) == 1
    assert planned == learned
    assert estimator.filter._train is None  # of what proposes, within what fits to the pad
