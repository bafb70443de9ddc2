"""What synthesis learns of a pad beside what it is told."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import BarForward, square_pad

from tactsim.core import InputError, Scan, compose, transform
from tactsim.estimators.synthesis.learned_pad import LearnedPad, Response
from tactsim.estimators.synthesis.modes import expand_all
from tactsim.estimators.synthesis.pose_bank import PoseBank

PAD = square_pad()


def presses(forward, rng, gain=1.0, failing=0.0, count=150):
    """Press I and L anywhere near, with the forward model's noise, gains and taxels that read anything."""
    readings, poses, labels = [], [], []
    for letter in "IL":
        at = np.column_stack([rng.uniform(-8, 8, (count, 2)), rng.uniform(-np.pi, np.pi, count)])
        felt = forward.readings(letter, at) * gain
        felt += forward.noise * rng.standard_normal(felt.shape)
        broken = rng.random(felt.shape) < failing
        felt[broken] = (0.6 * felt.max(axis=1, keepdims=True) * rng.random(felt.shape))[broken]
        readings.append(felt)
        poses.append(at)
        labels += [letter] * count
    split = ["train"] * len(labels)
    return Scan(np.concatenate(readings), np.concatenate(poses), np.array(labels), np.array(split), PAD)


@pytest.fixture
def forward():
    return BarForward("IL", PAD)


@pytest.mark.parametrize("seed", range(3))
def test_an_even_pad_is_as_it_was_told(forward, seed):
    pad = LearnedPad.learned(forward, presses(forward, np.random.default_rng(seed)))
    assert (pad.gain == 1).all()
    assert pad.turns == forward.turns
    assert not pad.uneven
    assert pad.failing == 0
    assert pad.noise == pytest.approx(forward.noise, rel=0.05)


@pytest.mark.parametrize("failing", [0.0, 0.1, 0.2])
def test_gains_dead_taxels_and_the_share_that_fails_are_found(forward, failing):
    rng = np.random.default_rng(5)
    gain = 1 + 0.3 * rng.standard_normal(36)
    gain[[0, 17]] = 0
    pad = LearnedPad.learned(forward, presses(forward, rng, gain, failing))
    # A factor that all gains have in common is one of the touches.
    np.testing.assert_allclose(pad.gain / pad.gain.mean(), gain / gain.mean(), atol=0.08)
    assert pad.gain[[0, 17]] == pytest.approx(0, abs=0.05)
    assert pad.failing == pytest.approx(failing, abs=0.06)
    assert pad.turns == 1


def test_the_last_nuisance_is_the_factor_of_the_touch(forward):
    pad, pose = LearnedPad(forward, np.full(36, 0.9), forward.noise), np.array([[2.0, 1.0, 0.4]])
    found = pad.linearised("L", pose)
    q = found.nuisance.shape[1]
    step = np.zeros((1, q))
    step[0, -1] = 1e-5
    slope = (pad.linearised("L", pose, step).mean - pad.linearised("L", pose, -step).mean) / 2e-5
    np.testing.assert_allclose(found.nuisance[:, -1], slope, rtol=1e-6)
    np.testing.assert_allclose(found.mean, 0.9 * forward.linearised("L", pose).mean)


def test_half_the_force_is_felt_at_the_same_place(forward):
    bank = PoseBank.pressed(LearnedPad(forward, np.ones(36), forward.noise), "L", 3.0, 6)
    reading, robot = forward.readings("L", np.array([[3.0, 0.0, 0.0]]))[0], np.zeros(3)
    whole, half = (bank.places(force * reading, robot, 8.0) for force in (1.0, 0.5))
    best = whole.score.argmax()
    assert half.factor[best] == pytest.approx(0.5 * whole.factor[best], rel=1e-3)
    assert half.score[best] > half.score.max() - 5


def test_a_taxel_that_reads_anything_moves_nothing():
    rng = np.random.default_rng(2)
    mean, by_pose = rng.uniform(10, 40, (1, 36)), 4 * rng.standard_normal((1, 3, 36))
    nuisance, which = (
        np.concatenate([rng.standard_normal((1, 2, 36)), 0.5 * mean[:, None]], axis=1),
        np.zeros(1, int),
    )
    mean[0, 7] = 40
    felt = mean + rng.standard_normal((1, 36))
    others = np.delete(np.arange(36), 7)
    broken = felt.copy()
    broken[0, 7] = felt[0, others].min()  # within the range of the others, by which anything is meant
    clean = expand_all(felt, which, mean, by_pose, nuisance, 1.0, 0.1)
    _, gradient, information = expand_all(broken, which, mean, by_pose, nuisance, 1.0, 0.1)
    left_out = expand_all(
        felt[:, others], which, mean[:, others], np.ascontiguousarray(by_pose[..., others]),
        np.ascontiguousarray(nuisance[..., others]), 1.0, 0.1,
    )  # fmt: skip
    np.testing.assert_allclose(gradient, left_out[1], rtol=1e-9)
    np.testing.assert_allclose(information, left_out[2], rtol=1e-9)
    assert np.linalg.det(information) < np.linalg.det(clean[2])


@pytest.mark.parametrize(("scatter", "expected"), [(0.5, 1), (1, 1), (2, 4)])
def test_squared_errors_of_poses_grow_as_what_the_model_is_not_told(forward, scatter, expected):
    """Of noise that is k times what was told, the score's variance is k^2 times its slope; never less than 1."""
    scan = presses(forward, np.random.default_rng(4), count=400)
    exact = np.concatenate([forward.readings(one, scan.poses[scan.labels == one]) for one in "IL"])
    felt = exact + scatter * (scan.readings - exact)
    scan = Scan(felt, scan.poses, scan.labels, scan.split, PAD)
    assert LearnedPad.as_told(forward).compared(
        [(LearnedPad.as_told(forward), scan)]
    ).too_sure == pytest.approx(expected, rel=0.15)


def test_training_presses_say_how_probable_a_reading_is(forward):
    """Of normal noise alone log p has the mean and variance of chi^2 with as many degrees as there are taxels."""
    forward.noise = 1.5
    scan = presses(forward, np.random.default_rng(3), count=400)
    mean, spread = LearnedPad.as_told(forward).compared([(LearnedPad.as_told(forward), scan)]).usual
    assert mean == pytest.approx(-18 * np.log(2 * np.pi * 1.5**2) - 18, abs=0.8)
    assert spread == pytest.approx(np.sqrt(18), rel=0.15)


def test_presses_that_tell_nothing_of_poses_leave_the_belief_as_wide_as_it_is(forward):
    away = np.tile([500.0, 0.0, 0.0], (3, 1))
    scan = Scan(np.zeros((3, 36)), away, np.array(["I"] * 3), np.array(["train"] * 3), PAD)
    assert LearnedPad.as_told(forward).compared([(LearnedPad.as_told(forward), scan)]).too_sure == 1


def counted(scan, readings):
    return replace(scan, readings=readings, meta={"unit": "count"})


@pytest.mark.parametrize(("scale", "power"), [(3.5, 1), (200, 0.5), (0.01, 2.5)])
def test_what_a_pad_reads_of_a_pressure_is_learned(forward, scale, power):
    forward.noise = 0.0
    scan = presses(forward, np.random.default_rng(1))
    forward.noise = 2.0
    pad = LearnedPad.learned(forward, counted(scan, scale * scan.readings**power))
    assert pad.response.power == pytest.approx(power, rel=1e-3)
    assert pad.response.scale == pytest.approx(scale, rel=1e-2)
    assert (pad.gain == 1).all()
    assert LearnedPad.learned(forward, scan).response == Response()


def test_readings_that_fall_under_load_are_refused(forward):
    scan = presses(forward, np.random.default_rng(1))
    with pytest.raises(InputError, match="do not rise"):
        LearnedPad.learned(forward, counted(scan, -scan.readings))


def test_places_of_an_object_that_press_more_are_learned_and_move_with_the_pad(forward):
    rng = np.random.default_rng(2)
    scan = presses(forward, rng, count=400)
    xy = transform(scan.poses, PAD)
    more = 12 * np.sin(xy[..., 0] / 3) * np.cos(xy[..., 1] / 3)
    pad = LearnedPad.learned(forward, replace(scan, readings=scan.readings + more))
    assert set(pad.uneven) == {"I", "L"}
    assert pad.turns == 1
    assert forward.noise <= pad.noise < 2 * forward.noise  # rms of `more` is three times the noise
    pose = np.array([[2.0, 1.0, 0.4]])
    found = pad.linearised("L", pose)
    np.testing.assert_allclose(found.mean, pad.readings("L", pose))
    exact = pad.gain * (
        forward.readings("L", pose)
        + 12 * np.sin(transform(pose, PAD)[..., 0] / 3) * np.cos(transform(pose, PAD)[..., 1] / 3)
    )
    assert np.sqrt(((found.mean - exact) ** 2).mean()) < 2.5
    step = 1e-6
    by = [(pad.linearised("L", compose(pose, step * axis)).mean - found.mean)[0] / step for axis in np.eye(3)]
    np.testing.assert_allclose(found.by_pose[0], by, rtol=1e-3, atol=1e-3)
