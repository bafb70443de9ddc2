"""Analysis by synthesis, on readings whose forward model is known."""

import numpy as np
import pytest
from synthetic import BarForward, follow, make_scan, placement_error, pressures, square_pad

from tactsim import estimators
from tactsim.core import InputError, Scan, compose, invert, transform
from tactsim.core.forward import Linearised


class Forward(BarForward):
    """Every label is the shape of its first letter; presses are misplaced by `placement` mm and rad."""

    placement = np.zeros(3)

    def __init__(self, labels, placement=0.0):
        super().__init__("".join(dict.fromkeys(label[0] for label in labels)), square_pad())
        self.letters = tuple(labels)
        self.reach = dict.fromkeys(labels, 27.0)
        self.symmetry = dict.fromkeys(labels, 1)
        self.placement = np.array([placement, placement, placement / 10])
        self.turns = 2

    def readings(self, letter, sensor_in_object):
        return super().readings(letter[0], sensor_in_object)

    def linearised(self, letter, sensor_in_object, off=None):
        at = sensor_in_object if off is None else compose(sensor_in_object, off * self.placement)
        found = super().linearised(letter[0], at)
        return Linearised(found.mean, found.by_pose, found.by_pose * self.placement[:, None])


class Handheld(Forward):
    """Loads are log-normal, by about a third, and a taxel feels the square of its load."""

    def linearised(self, letter, sensor_in_object, off=None):
        found = super().linearised(letter, sensor_in_object)
        share = np.exp(0.6 * (0 if off is None else off[:, 0]) * np.ones(len(found.mean)))[:, None]
        mean, by_pose = share * found.mean, share[..., None] * found.by_pose
        return Linearised(mean, by_pose, 0.6 * mean[:, None])


def fitted(labels, placement=0.0, forward=Forward, **options):
    """Fit to one press of each label, which is as the forward model says."""
    model, count = forward(labels, placement), len(labels)
    scan = Scan(
        np.concatenate([model.readings(label, np.zeros((1, 3))) for label in labels]),
        np.zeros((count, 3)),
        np.array(labels),
        np.array(["train"] * count),
        square_pad(),
    )
    estimator = estimators.create("synthesis", **{"spacing": 1.5, "angles": 12, "modes": 200} | options)
    estimator.bring(model)
    estimator.fit(scan)
    return estimator


@pytest.fixture(scope="module")
def letters():
    return fitted(["E", "I", "L", "T"], placement=0.1)


def hidden(shape, count, rng, placement=0.0, within=9.0):
    """Press a hidden shape at random poses: readings, sensor_in_robot, true robot_in_object."""
    truth = rng.uniform([-9, -9, -np.pi], [9, 9, np.pi])
    stated = rng.uniform([-within, -within, -np.pi], [within, within, np.pi], (count, 3))
    true = compose(stated, placement * rng.standard_normal((count, 3)) * [1, 1, 0.1])
    readings = 30 * pressures(shape, transform(true, square_pad()))
    return readings + 2 * rng.standard_normal(readings.shape), compose(invert(truth), stated), truth


@pytest.mark.long
def test_it_reaches_the_bound_and_says_how_sure_it_is(letters):
    """The Cramer-Rao bound of x and y (van Trees): placement marginalised, averaged over trials."""
    rng = np.random.default_rng(0)
    squares, bounds, held, right = [], [], [], []
    for trial in range(26):
        shape = "ELT"[trial % 3]
        readings, poses, truth = hidden(shape, 8, rng, placement=0.1)
        estimate = follow(letters, readings, poses)[-1]
        right.append(estimate.label == shape)
        at = np.concatenate(
            [letters.forward.linearised(shape, compose(truth, pose)[None]).by_pose for pose in poses]
        )
        information = np.zeros((3, 3))
        for by_pose, pose in zip(at, poses, strict=True):
            nuisance = by_pose * np.array([[0.1], [0.1], [0.01]])
            inverse = np.linalg.inv(4 * np.eye(36) + nuisance.T @ nuisance)
            step = 1e-6
            own = [
                compose(invert(compose(truth, pose)), compose(truth + step * axis, pose)) / step
                for axis in np.eye(3)
            ]
            motion = np.array(own).T
            information += motion.T @ by_pose @ inverse @ by_pose.T @ motion
        cov = np.linalg.inv(information)
        away = estimate.robot_in_object - truth
        away[2] = (away[2] + np.pi) % (2 * np.pi) - np.pi
        squares.append(away @ information @ away / 3)
        bounds.append(np.sqrt(np.trace(cov[:2, :2])))
        samples = estimate.samples
        assert samples.weights.sum() == pytest.approx(1)
        centred = samples.poses - samples.weights @ samples.poses
        own_cov = (centred * samples.weights[:, None]).T @ centred
        held.append(away @ np.linalg.solve(own_cov, away) < 6.251)  # 90 % of chi^2 with 3 degrees
    assert np.mean(right) > 0.95
    assert max(bounds) < 0.5
    assert np.median(squares) < 1.3  # 0.79 for a Gaussian at the bound
    assert np.mean(np.minimum(squares, 9)) < 1.5
    assert np.mean(held) >= 0.75


@pytest.mark.long
def test_loads_that_vary_too_much_for_a_slope_are_searched_for():
    estimator, rng, far = fitted(["E", "I", "L", "T"], forward=Handheld), np.random.default_rng(6), []
    right = 0
    for trial in range(12):
        readings, poses, truth = hidden("ELT"[trial % 3], 5, rng)
        readings *= np.exp(0.6 * rng.standard_normal((5, 1)))
        estimate = follow(estimator, readings, poses)[-1]
        right += estimate.label == "ELT"[trial % 3]
        far.append(placement_error(estimate.robot_in_object, truth, 1, 64.0))
    assert right >= 11
    assert np.median(far) < 0.4


def test_a_first_reading_that_misleads_is_overcome(letters):
    rng = np.random.default_rng(3)
    readings, poses, truth = hidden("E", 6, rng)
    other = compose(invert(truth), np.array([8.0, 3.0, 1.0]))
    wrong = 30 * pressures("T", transform(np.array([0.0, 8.0, 2.0]), square_pad()))
    estimate = follow(letters, np.concatenate([wrong[None], readings]), np.concatenate([other[None], poses]))[
        -1
    ]
    assert estimate.label == "E"
    assert placement_error(estimate.robot_in_object, truth, 1, 64.0) < 0.5


def test_without_a_forward_model_it_says_what_to_do():
    with pytest.raises(InputError, match=r"bring\(tactsim.press.forward_model\(scan\)\)"):
        estimators.create("synthesis").fit(make_scan("L"))
