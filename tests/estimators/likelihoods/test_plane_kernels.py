"""Planes of pressure fitted to readings: against matrices, one after another, and finite differences."""

import numpy as np
import pytest
from synthetic import square_pad

from tactsim.core import compose, transform
from tactsim.estimators.likelihoods.plane_kernels import Nodes, Planes, PressureModel, expand, fit_planes

PAD = square_pad()
PLANE = np.column_stack([np.ones(36), PAD / np.abs(PAD).max()])
GAIN = np.linspace(0.7, 1.3, 36)
CELL, ORIGIN = 0.8, np.array([-16.0, -14.0])
PARTS, PRIOR = np.array([4.0, 0.01, 0.5]), np.array([50.0, 20.0, 20.0])


def fitted(readings, cover, slope, parts, prior):
    """Call the kernel: coefficients, pressure, variance, error, misfit."""
    planes = Planes(np.empty((len(readings), 3)), *np.empty((3, *readings.shape)), np.empty(len(readings)))
    fit_planes(readings, cover, slope, PressureModel(GAIN, PLANE, parts, prior), planes)
    return planes


def by_matrices(reading, cover, slope, parts, prior):
    """Fit one reading with whole covariances; also returns them, the last."""
    pressure, variance = np.ones(36), np.full(36, parts[0])
    for number in range(3):
        if number:
            variance = (
                parts[0]
                + parts[1] * (GAIN * cover * pressure) ** 2
                + parts[2] * (GAIN * pressure) ** 2 * slope
            )
        design = (GAIN * cover * (pressure > 0))[:, None] * PLANE
        whole = np.diag(variance) + design @ np.diag(prior**2) @ design.T
        found = np.diag(prior**2) @ design.T @ np.linalg.solve(whole, reading)
        pressure = np.maximum(PLANE @ found, 0)
    misfit = reading @ np.linalg.solve(whole, reading) / 2
    return found, pressure, variance, reading - design @ found, misfit, whole


def drawn(seed, lean):
    rng = np.random.default_rng(seed)
    cover, slope = rng.uniform(-0.1, 1.1, (7, 36)), rng.uniform(0, 0.3, (7, 36))
    under = 40 + lean * rng.uniform(-1, 1, (7, 2)) @ PLANE[:, 1:].T
    readings = GAIN * cover * np.maximum(under, 0) + rng.normal(0, 2, (7, 36))
    return readings, cover, slope, PARTS, PRIOR


@pytest.mark.parametrize("lean", [10, 60])
def test_a_plane_is_what_whole_matrices_give(lean):
    case = drawn(3, lean)
    kernel = fitted(*case)
    assert (kernel[1] == 0).any() == (lean == 60)  # a pad that leans far has left the object on one side
    for n in range(7):
        found, pressure, variance, error, misfit, _ = by_matrices(*(part[n] for part in case[:3]), *case[3:])
        for mine, theirs in zip(
            (one[n] for one in kernel), (found, pressure, variance, error, misfit), strict=True
        ):
            assert mine == pytest.approx(theirs, rel=1e-9, abs=1e-9)


def mosaic(seed=None):
    """Make cover and its slopes per cell at the nodes: of one plane, or, with a seed, anything."""
    rows, columns = 34, 40
    if seed is not None:
        return np.random.default_rng(seed).uniform(-0.2, 1, (rows, columns, 3))
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    return np.stack([0.5 + 0.01 * x - 0.004 * y, np.full(x.shape, 0.01), np.full(x.shape, -0.004)], axis=-1)


def looked_up(nodes, xy):
    """Interpolate nodes bilinearly at one point, at the rim beyond them."""
    last = np.array(nodes.shape[1::-1]) - 1
    place = np.clip((xy - ORIGIN) / CELL, 0, last)
    column, row = np.minimum(place.astype(int), last - 1)
    u, v = place - (column, row)
    low = (1 - u) * nodes[row, column] + u * nodes[row, column + 1]
    high = (1 - u) * nodes[row + 1, column] + u * nodes[row + 1, column + 1]
    return (1 - v) * low + v * high


def expanded(pose, readings, poses, nodes, parts, prior):
    slope, curvature = np.empty(3), np.empty((3, 3))
    model = PressureModel(GAIN, PLANE, parts, prior)
    total = expand(pose, readings, poses, PAD, Nodes(nodes, ORIGIN, CELL), model, slope, curvature)
    return total, slope, curvature


def touches(seed=5):
    rng = np.random.default_rng(seed)
    poses = np.column_stack([rng.uniform(-9, 9, (6, 2)), rng.uniform(-3, 3, 6)])
    return rng.uniform(0, 60, (6, 36)), poses


@pytest.mark.parametrize("pose", [(0.4, -0.7, 0.3), (6.0, 5.0, -2.0), (400.0, -300.0, 1.0)])
def test_an_expansion_is_the_sum_of_what_whole_matrices_give(pose):
    pose, nodes = np.array(pose), mosaic(2)
    readings, poses = touches()
    total, slope, curvature = 0.0, np.zeros(3), np.zeros((3, 3))
    for reading, xy in zip(readings, transform(compose(pose, poses), PAD), strict=True):
        felt = np.array([looked_up(nodes, place) for place in xy])
        gradient, away = felt[:, 1:] / CELL, xy - pose[:2]
        _, pressure, variance, error, misfit, whole = by_matrices(
            reading, felt[:, 0], (gradient**2).sum(axis=1), PARTS, PRIOR
        )
        turn = gradient[:, 1] * away[:, 0] - gradient[:, 0] * away[:, 1]
        moved = (GAIN * pressure)[:, None] * np.column_stack([gradient, turn])
        total += misfit + np.log(variance).sum() / 2
        slope += moved.T @ (error / variance)
        curvature += moved.T @ np.linalg.solve(whole, moved)
    mine = expanded(pose, readings, poses, nodes, PARTS, PRIOR)
    assert mine[0] == pytest.approx(total, rel=1e-9)
    assert mine[1] == pytest.approx(slope, rel=1e-8, abs=1e-8 * np.abs(slope).max())
    assert mine[2] == pytest.approx(curvature, rel=1e-8, abs=1e-8 * np.abs(curvature).max())


def test_a_pose_that_is_no_number_reads_nothing_beyond_the_nodes():
    readings, poses = touches()
    case = readings, poses, mosaic(2), PARTS, PRIOR
    at_the_rim = expanded(np.array([-1e4, -1e4, 0.0]), *case)[0]
    assert expanded(np.array([np.nan, np.nan, 0.0]), *case)[0] == at_the_rim
