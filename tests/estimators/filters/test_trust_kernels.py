"""The inner loops of what is learned from left-out readings, against NumPy by definition."""

import numpy as np
import pytest

from tactsim.estimators.filters.trust_kernels import mostly_held, sums_of_readings


@pytest.mark.parametrize("seed", range(8))
def test_sequences_whose_region_excludes_no_move_are_counted_as_defined(seed):
    rng = np.random.default_rng(seed)
    log_p, shift = rng.normal(scale=9, size=(40, 64)), rng.normal(size=(64, 2))
    log_volume, weight = rng.normal(size=64), 0.4
    shares = []
    for of_sequence in log_p:
        belief = np.exp(weight * of_sequence + log_volume)
        belief /= belief.sum()
        mean = belief @ shift
        nearer = np.linalg.norm(shift - mean, axis=1) < np.linalg.norm(mean)
        shares.append(belief[nearer].sum())
    answers, order, along = [], rng.permutation(40), np.ascontiguousarray(shift.T)
    for share in np.linspace(0.05, 0.95, 19):
        answers.append(np.mean(np.array(shares) < share) > share)
        # In any order, and in the one that the share before has left.
        assert mostly_held(log_p, order, weight, log_volume, along, share) == answers[-1]
        assert mostly_held(log_p, np.arange(40), weight, log_volume, along, share) == answers[-1]
        assert sorted(order) == list(range(40))
    assert 0 < np.mean(answers) < 1


def test_as_many_as_the_share_are_not_more_than_it():
    # One move; with it nowhere near the mean, and at it, nothing or all of the belief is nearer than no move at all.
    held, left_out = np.array([0.0, -100.0]), np.array([-100.0, 0.0])
    shift = np.array([[0.0, 1.0], [0.0, 0.0]])
    for count in range(11):
        log_p = np.array([held] * count + [left_out] * (10 - count))
        assert mostly_held(log_p, np.arange(10), 1.0, np.zeros(2), shift, 0.5) == (count > 5)


def test_what_all_moves_have_in_common_changes_nothing():
    rng = np.random.default_rng(4)
    log_p, shift = rng.normal(scale=200, size=(40, 64)), rng.normal(size=(2, 64))
    for share in np.linspace(0.05, 0.95, 19):
        found = [
            mostly_held(log_p + offset, np.arange(40), 1.0, np.zeros(64), shift, share)
            for offset in (0.0, -1e5)
        ]
        assert found[0] == found[1]


def test_readings_are_summed_and_mirrored_ones_with_every_move_the_other_way():
    rng = np.random.default_rng(5)
    log_p = rng.normal(size=(12, 20))
    drawn = np.array([rng.permutation(12)[:5] for _ in range(30)])
    mirrored = rng.integers(2, size=drawn.shape)
    other_way = np.concatenate([log_p[:, 10:], log_p[:, :10]], axis=1)
    for found, which, turned in zip(sums_of_readings(log_p, drawn, mirrored), drawn, mirrored, strict=True):
        expected = sum((other_way if turned[k] else log_p)[which[k]] for k in range(5))
        assert found == pytest.approx(expected)
