"""Analysis by synthesis, on readings whose forward model is known."""

import numpy as np
import pytest
from synthetic import BarForward, follow, make_scan, placement_error, pressures, square_pad

from tactsim import estimators
from tactsim.core import InputError, Scan, compose, invert, transform
from tactsim.core.forward import Linearised
from tactsim.estimators.synthesis.learned_pad import LearnedPad
from tactsim.estimators.synthesis.modes import expand, likeliest_press
from tactsim.estimators.synthesis.pose_bank import PoseBank


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

    def linearised(self, letter, sensor_in_object, off=None, load=None):
        at = sensor_in_object if off is None else compose(sensor_in_object, off * self.placement)
        found = super().linearised(letter[0], at, load=load)
        nuisance = np.concatenate([found.by_pose * self.placement[:, None], found.nuisance], axis=1)
        return Linearised(found.mean, found.by_pose, nuisance)


class Handheld(Forward):
    """Loads are log-normal, by about a third, and a taxel feels the square of its load."""

    def linearised(self, letter, sensor_in_object, off=None, load=None):
        given = np.ones(len(sensor_in_object)) if load is None else load
        share = given**2 * np.exp(0.6 * (0 if off is None else off[:, 0]))
        found = super().linearised(letter, sensor_in_object, load=share)
        rows = found.mean[:, None] * np.array([0.6, 2.0][: 1 if load is None else 2])[:, None]
        return Linearised(found.mean, found.by_pose, rows)


def fitted(labels, placement=0.0, forward=Forward, **options):
    """Fit to one press of each label, which is as the forward model says."""
    model, count = forward(labels, placement), len(labels)
    scan = Scan(
        np.concatenate([model.readings(label, np.zeros((1, 3))) for label in labels]), np.zeros((count, 3)),
        np.array(labels), np.array(["train"] * count), square_pad(),
    )  # fmt: skip
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


def test_the_likeliest_press_is_the_ridge_regression():
    rng = np.random.default_rng(7)
    found = Linearised(rng.normal(size=(3, 8)), np.zeros((3, 3, 8)), rng.normal(size=(3, 2, 8)))
    readings = rng.normal(size=(3, 8))
    likely = likeliest_press(readings, found.mean, found.nuisance, 0.5, 0.0)
    for reading, mean, slopes, off in zip(readings, found.mean, found.nuisance, likely, strict=True):
        rows = np.vstack([slopes.T / 0.5, np.eye(2)])
        target = np.concatenate([(reading - mean) / 0.5, np.zeros(2)])
        np.testing.assert_allclose(off, np.linalg.lstsq(rows, target)[0], rtol=1e-9)


def test_an_expansion_is_that_of_the_log_likelihood():
    rng = np.random.default_rng(3)
    by_pose, nuisance = rng.normal(size=(3, 8)), rng.normal(size=(2, 8))
    readings, number, letter = rng.normal(size=(2, 8)), np.array([1, 0, 1]), np.array([0, 1, 0])
    poses, origin = rng.normal(size=(3, 3)), np.array([1.0, -2.0, 0.4])
    turn = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])

    def expanded(state):
        """Readings are linear in the sensor's motion along its own axes at `origin`, and each letter's differ."""
        off = compose(state, poses) - origin
        own = np.column_stack([off[:, :2] @ turn, off[:, 2]])

        def predict(one, which):
            shape = (len(which), 1, 1)
            return Linearised(
                3.0 * one + own[which] @ by_pose, np.tile(by_pose, shape), np.tile(nuisance, shape)
            )

        return expand(letter, state, poses, readings, number, predict, 0.5)

    state = np.array([compose(origin, invert(pose)) for pose in poses])
    log_p, gradient, information = expanded(state)
    cov = 0.25 * np.eye(8) + nuisance.T @ nuisance
    rest = readings[number] - 3.0 * letter[:, None]
    np.testing.assert_allclose(
        log_p,
        [-0.5 * (z @ np.linalg.solve(cov, z) + np.linalg.slogdet(2 * np.pi * cov)[1]) for z in rest],
        rtol=1e-9,
    )
    for axis, step in enumerate(1e-5 * np.eye(3)):
        up, down = expanded(state + step), expanded(state - step)
        np.testing.assert_allclose(gradient[:, axis], (up[0] - down[0]) / 2e-5, rtol=1e-4)
    # A motion of the object is one of the sensor, turned and shifted: its determinant is 1.
    np.testing.assert_allclose(
        np.linalg.det(information), np.linalg.det(by_pose @ np.linalg.solve(cov, by_pose.T)), rtol=1e-9
    )


def test_poses_are_drawn_as_wide_as_presses_at_known_poses_ask_for(letters, monkeypatch):
    readings, poses, _ = hidden("L", 6, np.random.default_rng(8))
    told = follow(letters, readings, poses)[-1]
    monkeypatch.setattr(letters.pad, "too_sure", 4.0 * letters.pad.too_sure)
    wider = follow(letters, readings, poses)[-1]
    assert wider.probabilities == told.probabilities
    assert (wider.robot_in_object == told.robot_in_object).all()
    away = [one.samples.poses - told.robot_in_object for one in (told, wider)]
    for one in away:  # a search that began anew may have found the place a whole turn on
        one[:, 2] = (one[:, 2] + np.pi) % (2 * np.pi) - np.pi
    # A mode beside the heaviest counts a little more.
    np.testing.assert_allclose(np.cov(away[1].T), 4 * np.cov(away[0].T), rtol=0.05)
