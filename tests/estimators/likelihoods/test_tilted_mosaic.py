"""Mosaics of cover and planes of pressure: against brute force, and what they must not depend on."""

import numpy as np
import pytest
from synthetic import paper_poses, pressures, square_pad

from tactsim.core import Scan, compose, invert, transform
from tactsim.estimators.likelihoods.occupancy import learn_maps
from tactsim.estimators.likelihoods.tilted_mosaic import TiltedMosaics
from tactsim.estimators.options import LikelihoodOptions

POSES = paper_poses(positions=4, angles=8)
NOISE = 1.0


def tilted_readings(shape, poses, rng, pad):
    """Press a shape with a load and a tilt of its own at every pose, exactly as the module's equation says."""
    plane = rng.uniform((30, -15, -15), (60, 15, 15), (len(poses), 3))
    uv = pad / np.abs(pad).max()
    pressure = plane[:, :1] + plane[:, 1:] @ uv.T
    felt = pressures(shape, transform(poses, pad)) * pressure
    return felt + NOISE * rng.standard_normal(felt.shape)


@pytest.fixture(scope="module")
def scan():
    rng, pad = np.random.default_rng(4), square_pad()
    return Scan(
        np.concatenate([tilted_readings(shape, POSES, rng, pad) for shape in "EL"]),
        np.tile(POSES, (2, 1)), np.repeat(["E", "L"], len(POSES)), np.repeat("train", 2 * len(POSES)), pad,
    )  # fmt: skip


@pytest.fixture(scope="module")
def mosaics(scan):
    mosaics = TiltedMosaics(LikelihoodOptions())
    mosaics.fit(scan, learn_maps(scan))
    return mosaics


def test_a_misfit_is_half_of_chi_squared_with_the_planes_integrated_out(mosaics, scan):
    # The quadratic form of N(0, V + X prior X'), where X holds the planes under the cover.
    readings, poses = scan.readings[5:9], scan.poses[5:9]
    found = mosaics.misfits("E", np.zeros(3), readings, poses)
    cover, slope = mosaics.mosaics["E"](transform(poses, scan.taxel_xy))
    fit = mosaics._planes(readings, cover, slope)
    assert (fit.pressure > 0).all()
    uv = scan.taxel_xy / np.abs(scan.taxel_xy).max()
    for i in range(4):
        design = (mosaics.gain * cover[i])[:, None] * np.column_stack([np.ones(36), uv])
        whole = np.diag(fit.variance[i]) + design @ np.diag(mosaics.prior**2) @ design.T
        assert found[i] == pytest.approx(readings[i] @ np.linalg.solve(whole, readings[i]) / 2, rel=1e-9)


def test_errors_are_as_large_as_learned(mosaics, scan):
    rng = np.random.default_rng(5)
    poses = np.column_stack([rng.uniform(-10, 10, (200, 2)), rng.uniform(-np.pi, np.pi, 200)])
    for label, other in ("EL", "LE"):
        fresh = tilted_readings(label, poses, rng, scan.taxel_xy)
        near, far, elsewhere = (part.mean() for part in mosaics.left_out(label))
        own = mosaics.misfits(label, np.zeros(3), fresh, poses).mean()
        assert 0.9 * near < own < 1.1 * far
        assert 18 / 2 < own < 18 * 2  # half of chi^2 of 36 taxels
        assert mosaics.misfits(other, np.zeros(3), fresh, poses).mean() > 3 * own
        assert elsewhere > 3 * own


@pytest.mark.parametrize(
    ("load", "lean_x", "lean_y"), [(0.7, 0, 0), (1.3, 0, 0), (1, 0.3, -0.3), (0.8, -0.3, 0)]
)
def test_load_and_tilt_of_a_press_tell_nothing(mosaics, scan, load, lean_x, lean_y):
    uv = scan.taxel_xy / np.abs(scan.taxel_xy).max()
    poses = scan.poses[:20]
    felt = pressures("E", transform(poses, scan.taxel_xy)) * 45.0
    level = mosaics.misfits("E", np.zeros(3), felt, poses).mean()
    tilted = mosaics.misfits("E", np.zeros(3), felt * (load + uv @ [lean_x, lean_y]), poses).mean()
    assert tilted < level + 4


def test_the_search_for_a_pose_ends_where_readings_fit(mosaics, scan):
    rng = np.random.default_rng(6)
    truth = np.array([2.0, -1.0, 0.5])
    poses = np.column_stack([rng.uniform(-10, 10, (12, 2)), rng.uniform(-np.pi, np.pi, 12)])
    readings = tilted_readings("E", poses, rng, scan.taxel_xy)
    sensor_in_robot = compose(invert(truth), poses)
    for off in ([0.6, -0.5, 0.05], [-0.4, 0.8, -0.06], [0, 0, 0]):
        found = mosaics.fitting_pose("E", truth + off, readings, sensor_in_robot)
        assert np.abs(found - truth)[:2].max() < 0.15
        assert abs(found - truth)[2] < 0.02
