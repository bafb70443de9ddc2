import numpy as np
import pytest
from manifold3d import Manifold

from tactsim import models
from tactsim.core import InputError, Pad
from tactsim.press.scan_poses import PAPER, grid_poses, random_poses, stage_for


def scaled_pad(k):
    """Give the paper's pad, every length times k."""
    pad = Pad()
    names = ("pitch_x", "pitch_y", "taxel_width", "taxel_height", "seam")
    return pad.model_copy(update={name: k * getattr(pad, name) for name in names})


def box(width, height, name="box"):
    return models.relief(name, Manifold.cube((width, height, 4.0), True))


def test_the_grid_is_the_paper_s():
    expected = [
        [x, y, k * np.pi / 6]
        for x in (-10.2, -3.4, 3.4, 10.2)
        for y in (-10.2, -3.4, 3.4, 10.2)
        for k in range(12)
    ]
    assert PAPER.poses == 192
    assert grid_poses() == pytest.approx(np.array(expected))


def test_random_poses_are_uniform_over_12_mm_and_all_angles():
    poses = random_poses(np.random.default_rng(0), 4000)
    assert random_poses(np.random.default_rng(0)).shape == (192, 3)
    for values, low, high in zip(poses.T, (-12.0, -12.0, 0), (12.0, 12.0, 2 * np.pi), strict=True):
        share, _ = np.histogram(values, 8, (low, high))
        assert share.sum() == 4000
        assert share / 4000 == pytest.approx(1 / 8, abs=5 * np.sqrt(1 / 8 * 7 / 8 / 4000))


@pytest.mark.parametrize("k", [0.2, 3.7])
@pytest.mark.parametrize("size", [(4, 6), (60, 10)])
def test_what_is_scaled_together_is_pressed_alike(k, size):
    at_one = stage_for(Pad(), box(*size))
    scaled = stage_for(scaled_pad(k), box(k * size[0], k * size[1]))
    assert np.array(scaled.positions) / k == pytest.approx(np.array(at_one.positions))
    assert scaled.reach / k == pytest.approx(at_one.reach)


@pytest.mark.parametrize(("width", "height"), [(24, 20), (80, 80)])
@pytest.mark.parametrize("k", [0.7, 2.5])
def test_the_pad_reaches_the_rim_and_no_gap_is_wider_than_the_paper_s(width, height, k):
    stage = stage_for(scaled_pad(k), box(width, height))
    rim = max(width, height) / 2
    assert stage.positions[-1] + 5.8 * k >= rim - 1e-9 or stage.positions[-1] >= 0.56 * (rim + 5.8 * k) - 1e-9
    assert np.diff(stage.positions).max() <= 6.8 * k + 1e-9
    assert len(stage.positions) >= 4
    assert stage.reach > stage.positions[-1]


def test_a_shape_too_large_for_the_pad_is_refused():
    with pytest.raises(
        InputError, match=r"'plate' reaches 100 mm from its middle; with this pad a scan covers 70.4 mm"
    ):
        stage_for(Pad(), box(200, 50, "plate"))
    assert len(stage_for(scaled_pad(3), box(200, 50)).positions) < 20
