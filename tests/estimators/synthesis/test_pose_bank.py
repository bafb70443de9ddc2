"""The bank of readings that the synthesis estimator presses beforehand."""

import numpy as np
import pytest
from synthetic import BarForward, square_pad

from tactsim.core import compose
from tactsim.estimators.synthesis.learned_pad import LearnedPad
from tactsim.estimators.synthesis.pose_bank import PoseBank


class TurnedForward(BarForward):
    """The same pad, which may say that half a turn reverses a reading, and letters that may be symmetric."""

    def __init__(self, shapes, turns, symmetry):
        super().__init__(shapes, square_pad())
        self.turns = turns
        self.symmetry = dict.fromkeys(shapes, symmetry)


POSE = np.array([3.0, -4.0, 0.7])  # sensor_in_robot


@pytest.mark.parametrize(("shape", "turns", "symmetry"), [("L", 1, 1), ("L", 2, 1), ("I", 2, 2), ("I", 1, 2)])
def test_every_place_is_one_at_which_its_prediction_is_felt(shape, turns, symmetry):
    forward = TurnedForward(shape, turns, symmetry)
    bank = PoseBank.pressed(LearnedPad.as_told(forward), shape, 3.0, 6)
    reading = forward.readings(shape, np.array([[2.0, 1.0, 4.0]]))[0]
    places = bank.places(reading, POSE, 8.0)
    assert np.abs(places.state[:, :2]).max() <= 8
    some = np.random.default_rng(0).permutation(len(places.score))[:200]
    poses = compose(places.state[some], POSE)
    found = bank.predicted(places.entry[some], places.turned[some], places.factor[some])
    exact = forward.linearised(shape, poses)
    np.testing.assert_allclose(found.mean, exact.mean, atol=1e-3)
    np.testing.assert_allclose(found.by_pose, exact.by_pose, atol=0.05 * np.abs(exact.by_pose).max())
    # As many places as cells of that size fill the states that are told apart.
    cells = (16 / 3) ** 2 * 12 / symmetry
    assert len(places.score) == pytest.approx(cells, rel=0.2)
    misfit = ((exact.mean - reading) ** 2).sum(axis=1)
    variance = bank.variance[places.entry[some]]
    expected = -misfit / (2 * variance) - 18 * np.log(variance)
    np.testing.assert_allclose(places.score[some], expected, rtol=1e-4)
    np.testing.assert_allclose(bank.log_p_at(reading, poses), expected, rtol=1e-4)


def test_beside_the_letter_there_is_noise_alone():
    forward = TurnedForward("L", 2, 1)
    bank = PoseBank.pressed(LearnedPad.as_told(forward), "L", 3.0, 6)
    reading = np.full(36, 3.0)
    expected = -9 * 36 / (2 * 4) - 18 * np.log(4)
    np.testing.assert_allclose(bank.log_p_at(reading, np.array([[200.0, 0, 0], [9e8, -9e8, 1]])), expected)
