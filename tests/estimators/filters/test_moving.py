"""Objects that move: the belief that moves, against exact answers."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal
from synthetic import fitted, fitted_anew, follow, make_scan, paper_poses

from tactsim.bench.config import Slip
from tactsim.core import InputError, compose, invert
from tactsim.estimators import create
from tactsim.estimators.estimator import PoseSamples
from tactsim.estimators.filters.clouds import Cloud, add_densities, advance
from tactsim.estimators.filters.motion import _FELT, Motion, parse_motion
from tactsim.estimators.filters.states import Weights

MAP_FILTERS = {
    "histogram": {"bins": 1000, "cell": 0.8},
    "particle": {"particles": 4000, "cell": 0.8},
    "augmented-mcl": {"particles": 4000, "cell": 0.8},
    "refined": {"bins": 1000, "cell": 0.8},
}


@pytest.fixture(scope="module")
def small():
    return make_scan(poses=paper_poses(4, 12))


@pytest.fixture(scope="module")
def two():
    return make_scan("EL", poses=paper_poses(4, 12))


def sequence(scan, letter, count, slip=None, seed=0):
    """Draw readings and sensor poses of an object, with its pose at each touch."""
    test = scan.where("test", letter)
    order = np.random.default_rng(seed).permutation(len(test))[:count]
    first = np.array([2.0, -3.0, 1.0])
    true = (slip or Slip()).poses(first, count, np.random.default_rng(seed + 1))
    return test.readings[order], compose(invert(true), test.poses[order]), true


@pytest.mark.parametrize("name", MAP_FILTERS)
def test_zero_motion_is_the_static_filter_to_the_bit(two, name):
    readings, poses, _ = sequence(two, "E", 4)
    pair = []
    for motion in ("off", "0,0"):
        estimator = fitted(name, two, **MAP_FILTERS[name], motion=motion)
        pair.append(follow(estimator, readings, poses))
    for off, zero in zip(*pair, strict=True):
        assert off.probabilities == zero.probabilities
        assert off.robot_in_object.tobytes() == zero.robot_in_object.tobytes()


def test_the_views_of_an_object_count_together(small):
    """The label is the likeliest object, of which no single view need be the likeliest."""
    seen = replace(small, views=np.arange(len(small)) % 3 * (small.labels == "E"))
    estimator = create("refined", bins=500, cell=0.8, motion="auto")
    estimator.fit(seen)
    rng = np.random.default_rng(3)
    for _ in range(12):  # of nothing in particular, so that several objects stay likely
        reading, poses = 6 * rng.random((4, 36)), rng.uniform([-6, -6, -3], [6, 6, 3], (4, 3))
        for said in follow(estimator, reading, poses):
            assert said.label == max(said.probabilities, key=said.probabilities.__getitem__)


@pytest.mark.parametrize("name", MAP_FILTERS)
def test_every_filter_follows_an_object_that_walks_away(two, name):
    slip = Slip(drift_mm=0.8)
    readings, poses, true = sequence(two, "E", 14, slip)
    off = []
    for motion in ("off", "0.8,0.01", "auto"):
        estimator = fitted_anew(name, two, **MAP_FILTERS[name], likelihood="calibrated", motion=motion)
        last = follow(estimator, readings, poses)[-1]
        assert last.label == "E"
        assert sum(last.probabilities.values()) == pytest.approx(1)
        if last.samples is not None:
            assert last.samples.weights.sum() == pytest.approx(1)
        off.append(np.hypot(*(invert(last.robot_in_object) - invert(true[-1]))[:2]))
    assert off[1] < 2.5
    assert off[2] < 2.5
    if name == "refined":
        assert off[0] > 2 * max(off[1:])


@pytest.mark.parametrize("options", [{}, pytest.param({"likelihood": "force"}, marks=pytest.mark.long)])
def test_an_object_at_rest_is_placed_as_without_motion(two, options):
    """A sequence counts for less than single readings do; at rest is not given up for that."""
    readings, poses, _ = sequence(two, "E", 9)
    pair = []
    for motion in ("off", "auto"):
        estimator = fitted("refined", two, bins=1000, motion=motion, **options)
        pair.append(follow(estimator, readings, poses))
    for off, auto in zip(*pair, strict=True):
        assert off.label == auto.label
        assert off.robot_in_object.tobytes() == auto.robot_in_object.tobytes()


def test_models_are_weighed_by_how_well_they_foretold_each_reading(two, monkeypatch):
    """The growth of the evidence of an object at rest, against a sum over the belief, written out."""
    monkeypatch.setattr("tactsim.estimators.filters.moving._MISPLACED", 1e-200)
    readings, poses, _ = sequence(two, "E", 5)
    estimator = fitted("refined", two, bins=1000, motion="auto")
    follow(estimator, readings[:4], poses[:4])
    moving = estimator.moving
    belief, before = estimator.own_states(), moving._rest
    estimator.update(readings[4], poses[4])
    likelihood = np.empty(len(belief.letter))
    for k in range(len(belief.letter)):
        log_p = estimator.field.log_p(int(belief.letter[k]), belief.state[:, k : k + 1].copy(), 4)
        likelihood[k] = np.exp(estimator.trust(3) * log_p[0])
    foretold = np.log(belief.weights.normalised @ likelihood)
    assert moving._rest - before == pytest.approx(np.log(1 - moving._motion.begins) + foretold, rel=1e-6)


def test_one_misplaced_touch_makes_no_object_at_rest_seem_to_move(two):
    """Whatever a touch says, the odds of a move grow by a factor of a hundred at most."""
    readings, poses, _ = sequence(two, "E", 9)
    poses[6, :2] += 3.0
    estimator = fitted("refined", two, bins=1000, motion="auto")
    estimator.reset(np.random.default_rng(0))
    odds = []
    for reading, pose in zip(readings, poses, strict=True):
        estimator.update(reading, pose)
        odds.append(estimator.moving._followed - estimator.moving._rest)
    assert odds[6] - odds[5] > 4  # without a bound it would be 9
    assert np.diff(odds).max() < np.log(100) + 0.1


def test_a_broad_belief_is_followed_to_a_place_between_its_centres():
    """After a vague reading a sharp one: the evidence of both, and the place, of a Kalman filter."""
    motion = Motion(0.06, np.array([0.1**2]), np.ones(1), 0.0, 0.0, 1.0, None)
    errors = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        cloud = Cloud(
            3 * rng.normal(size=(1200, 3)), np.full(1200, 0.1), np.full((1200, 1), -np.log(1200)), 0.0
        )
        mean, variance, evidence = np.zeros(3), 9.1, 0.0
        for deviation, drawn in ((1.5, 3000), (0.1, 600)):
            variance += 0.1**2
            seen = mean + np.sqrt(variance) * rng.normal(size=3) / 2

            def log_p(place, seen=seen, deviation=deviation):
                return -0.5 * ((place - seen) ** 2).sum(axis=1) / deviation**2

            cloud, states = advance(cloud, motion, log_p, drawn, rng)
            both = variance + deviation**2
            evidence += 1.5 * np.log(deviation**2 / both) - 0.5 * ((seen - mean) ** 2).sum() / both
            mean, variance = mean + variance / both * (seen - mean), variance * deviation**2 / both
        place = Weights(states.log_weight).normalised @ motion.placed(states.state)
        errors.append([cloud.log_evidence - evidence, np.linalg.norm(place - mean)])
    evidence_off, place_off = np.sqrt(np.mean(np.square(errors), axis=0))
    assert evidence_off < 1.0
    assert place_off < 0.05


@pytest.mark.long
def test_a_jump_is_found_again(small):
    _, _, true = sequence(small, "L", 12)
    moved = Slip(jump_mm=5).poses(true[0], 12, np.random.default_rng(4))
    test = small.where("test", "L")
    order = np.random.default_rng(0).permutation(len(test))[:12]
    readings, poses = test.readings[order], compose(invert(moved), test.poses[order])
    estimator = fitted_anew("refined", small, motion="auto")
    last = follow(estimator, readings, poses)[-1]
    assert np.hypot(*(invert(last.robot_in_object) - invert(moved[-1]))[:2]) < 1


@pytest.mark.long
def test_a_moving_object_is_not_taken_for_an_unknown_one(small):
    slip, said = Slip(walk_mm=0.7, walk_rad=0.03), []
    for motion in ("off", "0.7,0.03"):
        estimator = fitted_anew("refined", small, bins=1000, cell=0.8, unknown=0.3, motion=motion)
        unknown = []
        for letter, seed in product("ELT", range(2)):
            readings, poses, _ = sequence(small, letter, 10, slip, seed)
            unknown.append(follow(estimator, readings, poses)[-1].probabilities["none"])
        assert 0 <= estimator.propose(poses) < len(poses)
        assert estimator.belief_over_plane().probability.sum() == pytest.approx(1)
        said.append(np.mean(unknown))
    assert said[0] > 0.8
    assert said[1] < 0.5


def test_the_path_of_an_object_is_where_it_was_at_each_touch(two):
    readings, poses, true = sequence(two, "E", 12, Slip(walk_mm=0.7, walk_rad=0.03), seed=2)
    estimator = fitted("refined", two, **MAP_FILTERS["refined"], motion="0.7,0.03")
    last = follow(estimator, readings, poses)[-1]
    path = estimator.path(last)
    assert path.shape == (12, 3)
    away = np.hypot(*(invert(path) - invert(true))[:, :2].T)
    assert np.median(away) < 1
    assert np.median(np.hypot(*(invert(last.robot_in_object) - invert(true))[:, :2].T)) > np.median(away)


@given(st.integers(1, 8), st.integers(1, 8), st.integers(0, 2**32 - 1))
def test_a_mixture_is_the_sum_of_its_normal_densities(places, parts, seed):
    rng = np.random.default_rng(seed)
    around = 6.0
    place, centre = (rng.uniform(-3, 3, (n, 3)) for n in (places, parts))
    weight, variance, mixture = rng.random(parts), rng.uniform(0.2, 3, parts), rng.integers(2, size=parts)
    found = np.zeros((places, 2))
    add_densities(found, place, centre, weight, variance, mixture, around)
    expected = np.zeros((places, 2))
    for j in range(places):
        for i in range(parts):
            step = place[j] - centre[i]
            step[2] -= around * np.rint(step[2] / around)
            height = weight[i] / (2 * np.pi * variance[i]) ** 1.5
            expected[j, mixture[i]] += height * np.exp(-0.5 * (step @ step) / variance[i])
    assert np.allclose(found, expected, rtol=1e-6, atol=1e-5)


def test_the_option_says_what_moves():
    assert parse_motion("off") is None
    assert parse_motion("0,0") is None
    given_one = parse_motion("0.5,0.03")
    assert isinstance(given_one, Motion)
    assert (given_one.variance.tolist(), given_one.ratio, given_one.jump) == ([0.25], 0.06, 0)
    learned = parse_motion("auto")
    assert learned.still is not None
    assert 0 < learned.begins < 1 - learned.still
    assert learned.prior.sum() == pytest.approx(1)


@pytest.mark.parametrize("text", ["on", "1,2,3", "-1,0", "nan,0", "1000,0"])
def test_a_wrong_motion_is_refused(text):
    with pytest.raises(InputError, match="motion"):
        create("refined", motion=text)


def test_a_motion_that_is_seen_is_followed_as_if_it_had_been_from_the_first_touch(two):
    """Until it is seen the answers are those of an object at rest, then those of a motion that is learned."""
    readings, poses, _ = sequence(two, "E", 14, Slip(drift_mm=0.8))
    off, seen, auto = (
        fitted_anew("refined", two, bins=1000, cell=0.8, likelihood="calibrated", motion=motion)
        for motion in ("off", "seen", "auto")
    )
    for estimator in (off, seen, auto):
        estimator.reset(np.random.default_rng(0))
    followed, planes = [], []
    for reading, pose in zip(readings, poses, strict=True):
        for estimator in (off, seen, auto):
            estimator.update(reading, pose)
        followed.append(seen.moving is not None)
        planes.append(seen.belief_over_plane())
        if not followed[-1]:
            assert seen.estimate().robot_in_object.tobytes() == off.estimate().robot_in_object.tobytes()
    assert not followed[0]
    assert followed[-1]
    for plane in planes:  # a page shows all touches in the same cells
        np.testing.assert_array_equal([plane.x, plane.y], [planes[0].x, planes[0].y])
    places = [invert(estimator.estimate().robot_in_object) for estimator in (seen, auto, off)]
    assert np.hypot(*(places[0] - places[1])[:2]) < 0.5 < np.hypot(*(places[2] - places[1])[:2])
    seen.reset(np.random.default_rng(0))  # the next sequence begins at rest
    assert seen.moving is None


def test_an_object_at_rest_is_seldom_seen_to_move(small):
    readings, poses, _ = sequence(small, "L", 14)
    seen = fitted("refined", small, bins=1000, cell=0.8, motion="seen")
    follow(seen, readings, poses)
    assert seen.moving is None


def test_an_object_that_lies_still_after_all_is_followed_no_further(small):
    """A touch that is 6 mm off has a motion looked for, and those after it tell that it was none."""
    readings, poses, _ = sequence(small, "E", 12)
    poses[4, :2] += 6
    off, seen = (fitted("refined", small, bins=1000, cell=0.8, motion=motion) for motion in ("off", "seen"))
    for estimator in (off, seen):
        estimator.reset(np.random.default_rng(0))
    followed = []
    for reading, pose in zip(readings, poses, strict=True):
        for estimator in (off, seen):
            estimator.update(reading, pose)
        followed.append(seen.moving is not None)
        if not followed[-1]:
            assert seen.estimate().robot_in_object.tobytes() == off.estimate().robot_in_object.tobytes()
    assert any(followed)
    assert not followed[-1]


def test_rest_and_walks_are_weighed_by_the_density_of_the_places_that_readings_say():
    """Against the normal density of how far a reading's place is from the one before, by steps and errors."""
    motion, rng, count, error = parse_motion("auto"), np.random.default_rng(0), 5, 0.4
    read = rng.standard_normal((count, 3)).cumsum(axis=0) / 2
    apart = np.linalg.qr(rng.standard_normal((200, 3)))[0] * error * np.sqrt(200 / count)
    placement = read.mean(axis=0) + np.concatenate([apart, -apart])  # the belief at rest
    log_p = -((placement - read[:, None]) ** 2).sum(axis=2) / 2 / error**2
    of_errors = error**2 * (2 * np.eye(count - 1) - np.eye(count - 1, k=1) - np.eye(count - 1, k=-1))
    expected = np.array(
        [
            multivariate_normal(cov=of_errors + step * np.eye(count - 1))
            .logpdf(np.diff(read, axis=0).T)
            .sum()
            for step in (0.0, *motion.variance)
        ]
    )
    for counted in (1.0, 4.0):  # a log-likelihood that says half as much and counts as much again
        shares = motion.shares(count, placement * [1, 1, motion.ratio], log_p / np.sqrt(counted), counted)
        odds = np.log(shares / _FELT)
        np.testing.assert_allclose(odds - odds[0], expected - expected[0])


def test_a_belief_of_rest_widens_to_hold_the_last_place_of_a_walk():
    motion, count, error = parse_motion("auto"), 6, 0.3
    rng = np.random.default_rng(0)
    for k, variance in enumerate(motion.variance, 1):
        place = np.cumsum(rng.standard_normal((4000, count, 3)) * np.sqrt(variance), axis=1)
        mean = (place + rng.standard_normal(place.shape) * error).mean(axis=1)
        away = (place[:, -1] - mean).var()
        samples = PoseSamples(
            motion.state(rng.standard_normal((900, 3)) * error / np.sqrt(count)).T, np.full(900, 1 / 900)
        )
        wide = motion.walked(samples, np.eye(4)[k], count)
        said = np.cov(motion.placed(wide.poses.T).T, aweights=wide.weights).trace() / 3
        assert said == pytest.approx(away, rel=0.1)
        assert wide.weights.sum() == pytest.approx(1)


def test_where_an_object_is_that_may_have_moved_is_less_sure_and_stated_as_before(two):
    readings, poses, _ = sequence(two, "E", 4)
    off, seen = (fitted("refined", two, bins=1000, cell=0.8, motion=motion) for motion in ("off", "seen"))
    for one, other in zip(*(follow(estimator, readings, poses) for estimator in (off, seen)), strict=True):
        assert one.robot_in_object.tobytes() == other.robot_in_object.tobytes()
        assert one.probabilities == other.probabilities
        assert np.trace(other.covariance) >= np.trace(one.covariance)
    assert np.trace(other.covariance) > np.trace(one.covariance)
    assert seen.estimate().samples.poses.tobytes() == other.samples.poses.tobytes()


def test_two_readings_that_disagree_are_too_few_to_tell_of_a_move(two):
    readings, poses, _ = sequence(two, "E", 5)
    estimator = fitted("refined", two, bins=1000, cell=0.8, motion="seen")
    estimator.reset(np.random.default_rng(0))
    said = []
    for count, (reading, pose) in enumerate(zip(readings, poses, strict=True), 1):
        estimator.update(reading, pose)
        estimator._shares = np.eye(4)[2] if count > 1 else np.ones(1)  # as if surely it walked
        said.append(estimator._stirred())
    assert said == [False] * 2 + [True] * 3


def test_readings_that_nothing_explains_are_no_motion(small):
    """A pad that is mirrored since it was trained disagrees about the place from touch to touch."""
    readings, poses, _ = sequence(small, "L", 14)
    seen = fitted("refined", small, bins=1000, cell=0.8, motion="seen")
    follow(seen, readings[:, ::-1], poses)
    assert seen._stirred()
    assert seen.moving is None
