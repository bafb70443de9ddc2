"""What is checked of every estimate and every candidate, whoever made it."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from synthetic import draw_trial, fitted_anew, follow, make_scan, paper_poses

import tactsim
from tactsim import estimators
from tactsim.core import InputError
from tactsim.estimators import NONE, BatchEstimator, Estimate, Options, create
from tactsim.estimators.contract import CHECKS, Case
from tactsim.estimators.estimator import check_candidates, check_estimate, no_exit
from tactsim.estimators.likelihoods.occupancy import learn_maps
from tactsim.estimators.registry import load

LETTERS = ("E", "I")
POSE = np.array([1.0, -2.0, 0.3])


@pytest.mark.parametrize(
    "p", [{"E": 0.75, "I": 0.25}, {"E": 1.0}, {"E": 1.0, "I": 0.0}, {"I": 0.5, "E": 0.5}]
)
def test_an_estimate_is_let_through(p):
    check_estimate(Estimate("E", p, POSE), None, LETTERS)


def test_none_may_be_said_though_a_letter_is_more_probable():
    check_estimate(Estimate(NONE, {"E": 0.75, NONE: 0.25}, POSE), None, (*LETTERS, NONE))


@pytest.mark.parametrize(
    ("estimate", "said"),
    [(None, "no Estimate"), (Estimate("E", [0.5, 0.5], POSE), "table of probabilities"),
     (Estimate("O", {"O": 1.0}, POSE), "no letter"), (Estimate("E", {"I": 1.0}, POSE), "no probability"),
     (Estimate("E", {"E": 1.5, "I": -0.5}, POSE), "negative or do not sum to 1"),
     (Estimate("E", {"E": 0.5, "I": 0.4}, POSE), "negative or do not sum to 1"),
     (Estimate("E", {"E": np.nan}, POSE), "negative or do not sum to 1"),
     (Estimate("E", {"E": "much"}, POSE), "no number"),
     (Estimate("E", {"E": 0.25, "I": 0.75}, POSE), "I is more probable"),
     (Estimate("E", {"E": 1.0}, None), "has no pose"), (Estimate("E", {"E": 1.0}, POSE[:2]), "no finite"),
     (Estimate("E", {"E": 1.0}, [0.0, np.nan, 0.0]), "no finite")],
)  # fmt: skip
def test_what_is_no_estimate_is_refused_with_the_estimators_name(estimate, said):
    with pytest.raises(InputError, match=rf"NoneType is broken.*{said}"):
        check_estimate(estimate, None, LETTERS)


def test_candidates_are_poses():
    assert check_candidates([POSE, POSE]).shape == (2, 3)
    for wrong in ([], [[]], POSE, [POSE[:2]], np.zeros((2, 2, 3)), [[0.0, np.inf, 0.0]]):
        with pytest.raises(InputError, match="candidates"):
            check_candidates(wrong)


def test_an_interrupt_within_a_compiled_function_is_an_interrupt():
    """Numba makes a result all the same, and Python makes a SystemError of both."""
    inner = SystemError("returned a result with an exception set")
    inner.__cause__ = KeyboardInterrupt()
    for cause in (KeyboardInterrupt(), inner):
        with pytest.raises(KeyboardInterrupt), no_exit("refined"):
            raise SystemError("returned a result with an exception set") from cause
    with pytest.raises(SystemError, match="another"), no_exit("refined"):
        raise SystemError("another fault") from ValueError()


@pytest.mark.parametrize(
    "option",
    [
        {"gamma": 1e-320}, {"prior": 1.0}, {"peak": 0.0}, {"threshold": 1e300}, {"sigma": 10.0, "cell": 0.3},
        {"reach": float("nan")}, {"gamma": float("inf")},
    ],
)  # fmt: skip
def test_options_without_a_finite_answer_are_refused(option):
    with pytest.raises(InputError, match="estimator histogram") as caught:
        estimators.create("histogram", **option)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("far", [1e4, 1e9])
def test_poses_that_would_need_an_enormous_map_are_refused(far):
    scan = make_scan("EI", poses=paper_poses(positions=2, angles=2))
    poses = scan.poses.copy()
    poses[0, :2] = far
    tracemalloc.start()
    with pytest.raises(InputError, match=r"training poses span .* more than 50,000,000 cells"):
        learn_maps(replace(scan, poses=poses))
    assert tracemalloc.get_traced_memory()[1] < 10e6
    tracemalloc.stop()


def test_maps_of_many_readings_are_learned_in_pieces_that_fit_memory():
    scan = make_scan("I", poses=paper_poses(4, 3))
    once = learn_maps(scan, sigma=5.0)["I"].log_odds
    times = 4  # an array with all that 6912 taxels stamp would take 500 MB
    many = scan.chosen(np.tile(np.arange(len(scan)), times))
    start = np.log(0.2 / 0.8)
    tracemalloc.start()
    again = learn_maps(many, sigma=5.0)["I"].log_odds
    assert tracemalloc.get_traced_memory()[1] < 100e6
    tracemalloc.stop()
    assert np.allclose(again - start, times * (once - start), rtol=1e-10, atol=1e-9)


class MeanReading(BatchEstimator):
    """Name the letter whose mean training reading is most like the mean of what was felt."""

    def learn(self, train):
        self.means = np.array([train.where(label=label).readings.mean(axis=0) for label in self.labels])

    def answer(self, readings, sensor_in_robot):
        count = np.arange(1, readings.shape[1] + 1)[:, None]
        felt = readings.cumsum(axis=1) / count
        off = ((felt[:, :, None] - self.means) ** 2).mean(axis=-1)
        # As networks answer, not normalised
        p = np.exp(off.min(axis=-1, keepdims=True) - off).astype(np.float32)
        return p, np.zeros((*p.shape[:2], 3))


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_two_functions_keep_the_contract_of_every_estimator(check):
    check(Case(lambda: MeanReading(Options())))


def test_a_run_asks_for_many_trials_at_once():
    scan = tactsim.scan(letters="IO")
    run = tactsim.run(scan, estimator=MeanReading(Options()), trials=10, readings=10)
    assert run.accuracy[-1] > 0.6


SMALL = {"bins": 500, "cells": 20, "cell": 0.8}


@pytest.fixture(scope="module")
def scan():
    return make_scan("EIL", poses=paper_poses(positions=3, angles=4))


def test_a_fit_to_the_pad_is_a_transformation_of_what_goes_in_and_comes_out(scan):
    """A filter of the fitted options on readings that were brought to the paper's pad, its answers brought back."""
    ours = replace(
        scan, readings=scan.readings / 1000, poses=scan.poses * [2, 2, 1], taxel_xy=2 * scan.taxel_xy
    )
    fitted = fitted_anew("refined", ours, fit="auto", unknown=0.2, **SMALL)
    units = fitted.pad_fit.units
    back = [units.length, units.length, 1]
    assert back == pytest.approx([2, 2, 1])
    plain = create("refined", **(fitted.fitted_options.model_dump(exclude_defaults=True) | {"fit": "off"}))
    plain.fit(units.scan(ours))
    assert plain.pad_fit is None
    readings, poses, _ = draw_trial(ours, "L", 4, np.random.default_rng(1))
    brought = units.readings(readings), units.poses(poses)
    expected = follow(plain, *brought)
    for known, other in zip(follow(fitted, readings, poses), expected, strict=True):
        assert known.probabilities == other.probabilities
        assert known.robot_in_object.tobytes() == (other.robot_in_object * back).tobytes()
        assert known.samples.poses.tobytes() == (other.samples.poses * back).tobytes()
    plane, other = fitted.belief_over_plane(), plain.belief_over_plane()
    assert plane.x.tolist() == (units.length * other.x).tolist()
    assert plane.probability.tobytes() == other.probability.tobytes()
    for label, chart in fitted.maps.items():
        assert chart.extent == pytest.approx([2 * end for end in plain.maps[label].extent])
    assert fitted.propose(poses) == plain.propose(units.poses(poses))


@pytest.mark.parametrize("name", ["histogram", "particle", "augmented-mcl", "refined"])
def test_a_filter_without_a_letter_leaves_the_sequence_of_the_whole_alone(scan, name):
    """A sequence of the whole filter with one of the copy in between, against one that nothing came between."""
    budget = {"particles": 300} if load(name).budget == "particles" else {"bins": 500}
    whole = fitted_anew(name, scan, cell=0.8, **budget)
    drawn = [draw_trial(scan, label, 6, np.random.default_rng(4)) for label in "EL"]
    # Readings that contradict the first ones: random particles are injected then.
    readings, poses = (np.concatenate([trial[k][:4] for trial in drawn]) for k in (0, 1))
    expected = follow(whole, readings, poses)[-1]
    follow(whole, readings[:5], poses[:5])
    follow(whole.without("I", scan), readings[::-1], poses[::-1], seed=1)
    for reading, pose in zip(readings[5:], poses[5:], strict=True):
        whole.update(reading, pose)
    assert whole.estimate().probabilities == expected.probabilities
    assert whole.estimate().robot_in_object.tobytes() == expected.robot_in_object.tobytes()
