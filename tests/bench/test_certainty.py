"""How sure an estimator is of the place: regions and coverage where the answer is known exactly."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactsim.bench.placement import (
    Properties,
    certainty,
    normalised_error,
    placement_error,
    radius,
)
from tactsim.core import compose, invert
from tactsim.core.poses import exp, log
from tactsim.estimators.estimator import Estimate, PoseSamples

DISC = Properties(symmetry=0, centre=(0.4, -0.3), inertia_over_mass=60.0)
BAR = Properties(symmetry=2, centre=(0.4, -0.3), inertia_over_mass=60.0)
SHARES = st.lists(st.floats(0.01, 1), min_size=1, max_size=30)


def estimate_of(placements, weights, at):
    """Make an estimate whose belief are placements T_O^R (n, 3) of the object, and whose pose is placement `at`."""
    weights = np.asarray(weights, dtype=float)
    samples = PoseSamples(invert(np.asarray(placements, dtype=float)), weights / weights.sum())
    return Estimate("A", {"A": 1.0}, invert(np.asarray(at, dtype=float)), samples)


def gaussian_grid(sigma, turn=0.0, points=401):
    """Tabulate a Gaussian about the placement (2, 1, turn): (n, 3) placements and their weights."""
    steps = np.linspace(-5, 5, points) * sigma
    x, y = (part.ravel() for part in np.meshgrid(steps, steps))
    placed = np.column_stack([2 + x, 1 + y, np.full(len(x), turn)])
    return placed, np.exp(-(x**2 + y**2) / (2 * sigma**2))


@pytest.mark.parametrize("sigma", [0.05, 3.0])
def test_the_regions_of_a_gaussian_are_those_of_the_rayleigh_distribution(sigma):
    placed, weights = gaussian_grid(sigma)
    estimate = estimate_of(placed, weights, [2, 1, 0])
    for away in (0.3, 1.0, 2.0):
        found = certainty(estimate, invert(np.array([2 + away * sigma, 1, 0.0])), DISC)
        assert found.credibility == pytest.approx(1 - math.exp(-(away**2) / 2), abs=0.01)
        assert found.radius == pytest.approx(sigma * math.sqrt(-2 * math.log(0.1)), rel=0.01)


def test_truths_drawn_from_the_belief_are_held_as_often_as_the_region_says():
    placed, weights = gaussian_grid(0.5, points=101)
    estimate, rng = estimate_of(placed, weights, [2, 1, 0]), np.random.default_rng(0)
    truths = invert(placed[rng.choice(len(placed), size=400, p=weights / weights.sum())])
    credibility = np.array([certainty(estimate, truth, BAR).credibility for truth in truths])
    for share in (0.5, 0.9):
        assert np.mean(credibility < share) == pytest.approx(
            share, abs=3 * math.sqrt(share * (1 - share) / 400)
        )


@given(st.integers(0, 2**32 - 1), SHARES)
def test_the_truth_is_within_the_radius_if_and_only_if_its_credibility_is_below_the_share(seed, weights):
    rng = np.random.default_rng(seed)
    estimate = estimate_of(rng.normal(size=(len(weights), 3)), weights, rng.normal(size=3))
    truth = rng.normal(size=3)
    found = certainty(estimate, truth, BAR)
    error = placement_error(estimate.robot_in_object, truth, BAR)
    assert (found.credibility < 0.9) == (error <= found.radius)


@given(st.integers(0, 2**32 - 1), st.integers(0, 1), st.integers(0, 1))
def test_a_half_turn_of_a_symmetric_letter_changes_no_region(seed, of_samples, of_truth):
    rng = np.random.default_rng(seed)
    # A half turn about the centre
    about = compose([*BAR.centre, math.pi], [-BAR.centre[0], -BAR.centre[1], 0])
    placed, truth = rng.normal(size=(20, 3)), rng.normal(size=3)
    turned = np.array([compose(one, about) if of_samples and k % 2 else one for k, one in enumerate(placed)])
    plain = estimate_of(placed, np.ones(20), placed[0])
    half = estimate_of(turned, np.ones(20), placed[0])
    other = compose(truth, about) if of_truth else truth
    first, second = certainty(plain, invert(truth), BAR), certainty(half, invert(other), BAR)
    assert second.credibility == pytest.approx(first.credibility)
    assert second.radius == pytest.approx(first.radius, abs=1e-6)


def test_a_discs_angle_is_free():
    placed, weights = gaussian_grid(0.2)
    rng = np.random.default_rng(1)
    few = placed[rng.choice(len(placed), size=50, p=weights / weights.sum())]
    turns = rng.uniform(-3, 3, 50)
    about = [compose([*DISC.centre, turn], [-DISC.centre[0], -DISC.centre[1], 0]) for turn in turns]
    turned = np.array([compose(one, turn) for one, turn in zip(few, about, strict=True)])
    straight, any_angle = (estimate_of(one, np.ones(50), [2, 1, 0]) for one in (few, turned))
    truth = invert(np.array([2.2, 1.0, 0.0]))
    first, second = (certainty(one, truth, DISC) for one in (straight, any_angle))
    assert second.radius == pytest.approx(first.radius, abs=1e-6)
    assert second.credibility == pytest.approx(first.credibility)


def screws(rng, spread, count, about):
    """Draw poses T_R^O (count, 3) as exp(deviation) about a pose."""
    return compose(exp(rng.normal(size=(count, 3)) * spread), np.asarray(about, dtype=float))


def test_mean_and_covariance_are_those_that_deviations_were_drawn_with():
    rng, spread, about = np.random.default_rng(5), np.array([0.5, 0.2, 0.03]), [4.0, -30.0, 2.0]
    found = Estimate("A", {"A": 1.0}, np.array([4.3, -30.2, 1.9]),
                     PoseSamples(screws(rng, spread, 20_000, about), np.ones(20_000)))  # fmt: skip
    assert log(compose(found.mean, invert(np.array(about)))) == pytest.approx(np.zeros(3), abs=0.02)
    assert found.covariance / np.outer(spread, spread) == pytest.approx(np.eye(3), abs=0.04)
    shifted = found.moved(lambda poses: compose(poses, [7.0, 5.0, 1.0]))  # the robot stands elsewhere
    assert shifted.covariance == pytest.approx(found.covariance, abs=1e-9)
    assert Estimate("A", {"A": 1.0}, np.zeros(3)).covariance is None


@pytest.mark.parametrize(("of", "spread"), [(BAR, (0.3, 2.0, 0.4)), (DISC, (0.4, 0.1, 3.0))])
def test_the_normalised_error_of_truths_drawn_from_a_belief_of_any_shape_is_1(of, spread):
    rng = np.random.default_rng(6)
    poses = screws(rng, np.array(spread), 400, [1.0, 2.0, 0.4])
    poses[:100] = screws(rng, np.array(spread) / 3, 100, [3.0, 2.0, 0.6])
    weights = rng.random(400)
    samples, near = PoseSamples(poses, weights / weights.sum()), poses[0]
    errors = np.array([normalised_error(samples, near, pose, of) for pose in poses])
    assert weights @ errors / weights.sum() == pytest.approx(1, abs=1e-6)
    half = compose(
        compose(compose([*BAR.centre, 0.0], [0, 0, math.pi]), [-BAR.centre[0], -BAR.centre[1], 0]), poses
    )
    again = [normalised_error(samples, near, pose, of) for pose in half[:20]]
    assert again == pytest.approx(errors[:20])  # the object looks the same
    assert math.isnan(normalised_error(PoseSamples(poses[:1], np.ones(1)), near, near, of))
    for width, widest in (
        (1e-15, math.nan),
        (1e-8, 1e9),
    ):  # rounding is no width; a run's table holds no more
        wrong = PoseSamples(near + width * rng.normal(size=(50, len(near))), np.ones(50))
        assert normalised_error(wrong, near, poses[0] + [9.0, 9.0, 0.1], of) == pytest.approx(
            widest, nan_ok=True
        )


def test_an_estimator_that_does_not_say_has_no_region():
    found = certainty(Estimate("A", {"A": 1.0}, np.zeros(3)), np.zeros(3), BAR)
    assert math.isnan(found.credibility)
    assert math.isnan(found.radius)


def test_a_belief_in_one_point_is_sure_and_wrong():
    found = certainty(estimate_of([[0, 0, 0.0]], [1], [0, 0, 0]), [0.1, 0, 0], BAR)
    assert found.credibility == 1
    assert found.radius == 0


def test_a_share_takes_the_least_distance_that_holds_it():
    away, weights = np.array([3.0, 1.0, 2.0]), np.array([0.2, 0.5, 0.3])
    assert [radius(away, weights, share) for share in (0.4, 0.5, 0.6, 0.8, 0.9, 1.0)] == [1, 1, 2, 2, 3, 3]
