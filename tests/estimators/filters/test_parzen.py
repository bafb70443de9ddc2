"""The mode of the kernel density, by brute force."""

import numpy as np
import pytest

from tactsim.core import wrap_angle
from tactsim.estimators.filters import parzen as module
from tactsim.estimators.filters.parzen import PARZEN_STEP, parzen_mode


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
    mode = parzen_mode(np.ascontiguousarray(states.T), weights, rho)
    assert parzen([mode], states, weights, rho) == pytest.approx(heights.max())
    assert np.rint(mode / PARZEN_STEP) * PARZEN_STEP == pytest.approx(mode)


def test_tiles_find_the_same_mode(monkeypatch):
    rng = np.random.default_rng(11)
    for trial in range(40):
        count = int(rng.integers(1, 60))
        states = rng.uniform(-1, 1, (3, count)) * [[12.0], [25.0], [7.0]]
        weights = 10.0 ** -rng.uniform(0, 6, count)
        if trial % 3 == 0:  # equally high nodes in several tiles: the first counts
            states[:, count // 2 :] = states[:, : count - count // 2] + [[16.0], [8.0], [0.0]]
            weights[:] = 1.0
        rho = float(rng.choice([0.3, 1.0, 3.0]))
        monkeypatch.setattr(module, "_TILE", 1000)
        mode, lead = module._density_mode(states, weights, rho)
        for tile in (8, 16, 33):
            if rho / PARZEN_STEP[0] + 1 <= tile / 2:
                monkeypatch.setattr(module, "_TILE", tile)
                again, lead_again = module._density_mode(states, weights, rho)
                # Of nodes summed in float32.
                assert lead_again == pytest.approx(lead, abs=3e-4 * weights.sum())
                if lead > 1e-9:  # of equally high nodes rounding decides
                    assert again.tolist() == mode.tolist()


def test_particles_of_no_weight_can_still_be_the_only_ones():
    mode = parzen_mode(np.array([[1.0], [2.0], [0.5]]), np.array([1e-300]))
    assert mode == pytest.approx([1.0, 2.0, 0.5], abs=0.26)
