import numpy as np
import pytest

from tactsim.press.scan_poses import POSES, grid_poses, random_poses


def test_the_grid_is_the_paper_s():
    expected = [
        [x, y, k * np.pi / 6]
        for x in (-10.2, -3.4, 3.4, 10.2)
        for y in (-10.2, -3.4, 3.4, 10.2)
        for k in range(12)
    ]
    assert POSES == 192
    assert grid_poses() == pytest.approx(np.array(expected))


def test_random_poses_are_uniform_over_12_mm_and_all_angles():
    poses = random_poses(np.random.default_rng(0), 4000)
    assert random_poses(np.random.default_rng(0)).shape == (192, 3)
    for values, low, high in zip(poses.T, (-12.0, -12.0, 0), (12.0, 12.0, 2 * np.pi), strict=True):
        share, _ = np.histogram(values, 8, (low, high))
        assert share.sum() == 4000
        assert share / 4000 == pytest.approx(1 / 8, abs=5 * np.sqrt(1 / 8 * 7 / 8 / 4000))
