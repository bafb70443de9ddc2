"""Active touch: what a reading would say, against brute force and closed forms; proposing changes no estimate."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic import CHEAPER, draw_trial, fitted, model_of, quick_first

from tactsim.core import compose, transform
from tactsim.estimators.filters.active_touch import Planner, foresee
from tactsim.estimators.filters.map_filter import MapFilter
from tactsim.estimators.likelihoods.calibrated import CalibratedLikelihood
from tactsim.estimators.registry import BUILT_IN, load

FILTERS = [name for name in BUILT_IN if issubclass(load(name), MapFilter)]


@pytest.mark.parametrize("name", quick_first(FILTERS))
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


@pytest.fixture(scope="module")
def model(scan):
    return model_of("calibrated", scan)


@pytest.fixture(scope="module")
def planner(model, scan):
    return Planner(model, scan.taxel_xy)


@pytest.fixture(scope="module")
def fine(model, scan):
    """The same model in tables so fine that their interpolation does not matter."""
    finer = CalibratedLikelihood(model.options.model_copy(update={"cell": 0.05}))
    finer.maps, finer.calibration = model.maps, model.calibration
    return Planner(finer, scan.taxel_xy)


def some_states(rng, count):
    return rng.integers(3, size=count), rng.uniform(-1, 1, (3, count)) * [[10], [10], [np.pi]]


def test_a_reading_is_foreseen_as_the_model_says(model, fine, scan):
    rng = np.random.default_rng(1)
    pose = np.array([2.0, -3.0, 0.7])
    letter = rng.integers(3, size=6)
    drawn = np.array([0, 3])
    state = np.stack([rng.uniform(-5, 5, 6), rng.uniform(-5, 5, 6), rng.uniform(-3, 3, 6)])
    chance = rng.gumbel(size=(2, 36, 3)).astype(np.float32)
    log_p = np.empty((2, 6), dtype=np.float32)
    foresee(log_p, pose, drawn, letter, state, fine._taxel_xy, fine._nodes, fine._lattice, chance)

    tables = np.stack(
        [
            model.log_tables(model_label, transform(compose(one, pose), scan.taxel_xy))
            for model_label, one in zip(np.array(list(model.maps))[letter], state.T, strict=True)
        ]
    )  # (states, classes, taxels)
    for row, s in enumerate(drawn):
        felt = (tables[s] + chance[row].T).argmax(axis=0)
        expected = tables[:, felt, np.arange(36)].sum(axis=1)
        assert log_p[row] == pytest.approx(expected, rel=2e-2, abs=0.3)


def test_two_places_that_a_reading_tells_apart_are_worth_log_2(planner):
    letter = np.zeros(64, dtype=np.int64)
    # The sensor is on the middle of E's stem, or far off the letter.
    state = np.array([[0.0] * 32 + [200.0] * 32, [0.0] * 64, [0.0] * 64])
    seen, unseen = [-6.5, 0.0, 0.0], [0.0, 500.0, 0.0]
    found = planner.information(np.array([seen, unseen]), letter, state, np.random.default_rng(0))
    assert found == pytest.approx([math.log(2), 0], abs=1e-3)
    assert planner.choose(np.array([unseen, seen, unseen]), letter, state, np.random.default_rng(0)) == 1


@given(st.integers(0, 2**32), st.integers(1, 40), st.floats(0, 30))
@settings(max_examples=25, deadline=None)
def test_information_is_between_nothing_and_the_whole_state(planner, seed, states, spread):
    rng = np.random.default_rng(seed)
    letter, state = some_states(rng, states)
    candidates = rng.uniform(-1, 1, (5, 3)) * [spread, spread, 4]
    found = planner.information(candidates, letter, state, rng)
    assert (found <= math.log(states) + 1e-4).all()
    # One reading is drawn for each state: the estimate is off by what the draw is.
    assert (found >= -1e-4 if states == 1 else found > -2).all()
