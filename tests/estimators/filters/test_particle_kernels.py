"""The mode of the kernel density, by brute force."""

import numpy as np
import pytest

from tactsim.core import wrap_angle
from tactsim.estimators.filters.particle_kernels import PARZEN_STEP, parzen_mode


def parzen(nodes, states, weights, rho):
    """Eq. 10 and 11 at nodes (n, 3), with every particle at every node."""
    away = states - np.asarray(nodes)[:, None]
    away[..., 2] = wrap_angle(away[..., 2])
    return np.maximum(0, 1 - np.linalg.norm(away, axis=-1) / rho) @ weights


@pytest.mark.parametrize("rho", [1.0, 0.3, 2.5])
@pytest.mark.parametrize("light", [0.0, 1e-7, 0.2])
def test_mode_is_the_highest_node_by_brute_force(rho, light):
    rng = np.random.default_rng(7)
    # Around the place where the angle wraps, so that cones reach across it.
    states = rng.normal([3, -2, 0], [0.8, 0.6, 0.3], size=(30, 3)) + [0, 0, 2 * np.pi]
    weights = rng.random(30)
    weights[10:] *= light
    nodes = [
        (i * PARZEN_STEP[0], j * PARZEN_STEP[1], k * PARZEN_STEP[2])
        for i in range(2, 11)
        for j in range(-8, 1)
        for k in range(50)
    ]
    heights = parzen(nodes, states, weights, rho)
    mode, _ = parzen_mode(np.ascontiguousarray(states.T), weights, rho)
    assert parzen([mode], states, weights, rho) == pytest.approx(heights.max())
    assert np.rint(mode / PARZEN_STEP) * PARZEN_STEP == pytest.approx(mode)


def beliefs(count, most=60):
    """Draw weighted states of all kinds, some with equally high nodes, and a rho."""
    rng = np.random.default_rng(11)
    for trial in range(count):
        states = rng.uniform(-1, 1, (3, int(rng.integers(1, most)))) * [[12.0], [25.0], [7.0]]
        weights = 10.0 ** -rng.uniform(0, 6, states.shape[1])
        if trial % 3 == 0:
            half = states.shape[1] // 2
            states[:, half:] = states[:, : states.shape[1] - half] + [[16.0], [8.0], [0.0]]
            weights[:] = 1.0
        yield states, weights, float(rng.choice([0.3, 1.0, 3.0]))


def test_skipped_columns_change_no_mode():
    skipped = 0
    for states, weights, rho in beliefs(60, most=400):
        mode, left_out = parzen_mode(states, weights, rho)
        whole, none = parzen_mode(states, weights, rho, skip=False)
        assert mode.tolist() == whole.tolist()
        assert none == 0 <= left_out < len(weights)
        skipped += left_out
    assert skipped > 1000


def test_a_node_that_light_particles_alone_reach_can_be_the_highest():
    # The heavy one's cone ends before any node; those of the light ones, at a node, are added up there.
    states = np.concatenate([[[0.25], [0.25], [0.06]], np.zeros((3, 500))], axis=1)
    weights = np.append(1.0, np.full(500, 1e-5))
    states[0, 1:] = 20.0
    assert parzen_mode(states, weights, rho=0.3)[0] == pytest.approx([20.0, 0.0, 0.0])


def test_a_cone_that_reaches_no_node_has_the_node_nearest_to_it():
    mode, _ = parzen_mode(np.array([[1.2, 9.2], [2.2, 9.2], [-0.3, 0.1]]), np.array([1.0, 0.1]), rho=0.05)
    assert mode == pytest.approx([1.0, 2.0, -2 * PARZEN_STEP[2]])
