"""Mosaics of cover and planes of pressure: against brute force, and what they must not depend on."""

import numpy as np
import pytest
from synthetic import paper_poses, pressures, square_pad

from tactsim.core import Scan, compose, invert, transform
from tactsim.estimators.likelihoods.mosaic import Grid, learn_mosaic, learn_with_spread
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


GRID = Grid(origin=np.array([-3.0, -2.0]), cell=0.4, shape=(16, 21), sigma=1.0)


def scattered(count, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform([-3, -2], [5, 4], (count, 2)), rng


def test_it_converges_to_a_plane_that_is_felt():
    def felt(xy):
        return 0.3 + 0.11 * xy[..., 0] - 0.07 * xy[..., 1]

    inside = np.random.default_rng(1).uniform([-1, 0], [3, 2], (50, 2))
    worst = []
    for count in (3_000, 300_000):  # what is left is the prior, whose part falls as taxels come
        xy, _ = scattered(count)
        value, slope = learn_mosaic(xy, felt(xy), np.ones(count), GRID)(inside)
        worst.append(np.abs(value - felt(inside)).max())
    assert worst[0] < 5e-3
    assert worst[1] < worst[0] / 20
    assert slope == pytest.approx(0.11**2 + 0.07**2, rel=1e-3)


def test_every_node_is_a_weighted_least_squares_fit():
    xy, rng = scattered(300)
    values, weight = rng.normal(size=300), rng.uniform(0, 2, 300)
    mosaic = learn_mosaic(xy, values, weight, GRID)
    for row, column in [(0, 0), (7, 10), (15, 20), (3, 18)]:
        offset = (xy - GRID.origin) / 0.4 - (column, row)
        k = weight * np.exp(-2 * (offset**2).sum(axis=1) * 0.4**2) * (np.abs(offset) <= 2.0 / 0.4).all(axis=1)
        rows = np.column_stack([np.ones(300), offset]) * np.sqrt(k)[:, None]
        prior = np.sqrt(0.01) * np.diag([1, 1 / 0.4, 1 / 0.4])
        wanted, *_ = np.linalg.lstsq(
            np.vstack([rows, prior]), np.append(values * np.sqrt(k), np.zeros(3)), rcond=None
        )
        assert mosaic.plane[row, column] == pytest.approx(wanted, abs=1e-9)


def test_leaving_an_taxel_out_is_learning_without_it():
    xy, rng = scattered(200)
    values, weight = rng.normal(size=200), rng.uniform(0.1, 2, 200)
    got = learn_with_spread(xy, values, weight, GRID).without(xy, values, weight)
    for i in range(0, 200, 13):
        rest = np.arange(200) != i
        wanted, _ = learn_mosaic(xy[rest], values[rest], weight[rest], GRID)(xy[i])
        assert got[i] == pytest.approx(wanted, abs=1e-9)
