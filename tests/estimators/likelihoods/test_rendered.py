"""Virtual readings: at what poses, with what pressure, slopes and noise, and that they are like what is pressed."""

import numpy as np
import pytest
from synthetic import paper_poses, pressures, square_pad

from tactsim.core import Scan, transform
from tactsim.estimators.likelihoods.force import ForceLikelihood
from tactsim.estimators.likelihoods.occupancy import learn_maps
from tactsim.estimators.likelihoods.rendered import learn_rendering
from tactsim.estimators.options import LikelihoodOptions

PAD = square_pad()
GRID = paper_poses(positions=5, angles=8)


def pressed(noise=0.5, slope=0.0, load=None, seed=0):
    """A scan of L and T: each press leans at random, and has a given load if there is one."""
    rng = np.random.default_rng(seed)
    readings = []
    for shape in "LT":
        cover = pressures(shape, transform(GRID, PAD))
        pressure = 30.0 if load is None else load / np.maximum(cover.sum(axis=1, keepdims=True), 1)
        leaning = 1 + rng.normal(0, slope, (len(GRID), 2)) @ PAD.T
        readings.append(pressure * cover * leaning + noise * rng.standard_normal(cover.shape))
    return Scan(
        np.concatenate(readings), np.tile(GRID, (2, 1)), np.repeat(list("LT"), len(GRID)),
        np.full(2 * len(GRID), "train"), PAD,
    )  # fmt: skip


def rendering(scan):
    model = ForceLikelihood(LikelihoodOptions(likelihood="force"))
    model.fit(scan, learn_maps(scan))
    return learn_rendering(model, scan)


def test_presses_as_deep_have_one_pressure_and_those_of_a_load_have_less_the_more_they_cover():
    deep, loaded = rendering(pressed()), rendering(pressed(load=400.0))
    assert deep.falls < 0.15
    assert deep.pressure == pytest.approx(30, rel=0.25)
    assert loaded.falls > 0.85
    assert loaded.pressure == pytest.approx(400, rel=0.25)


@pytest.mark.long
def test_slopes_and_noise_are_those_of_the_presses():
    level, leaning = rendering(pressed()), rendering(pressed(slope=0.06))
    assert np.abs(np.median(np.abs(leaning.slopes)) / 0.6745) == pytest.approx(0.06, rel=0.35)
    assert np.median(np.abs(level.slopes)) < 0.3 * np.median(np.abs(leaning.slopes))
    noisy = rendering(pressed(noise=4.0))
    assert noisy.noise == pytest.approx(4.0, rel=0.25)


def test_virtual_readings_are_like_those_that_are_pressed_there():
    """Without noise and slopes, at the poses that the generator draws, against the shape itself."""
    found = rendering(pressed(noise=0.0))
    rng, again = np.random.default_rng(7), np.random.default_rng(7)
    readings, letter = found.draw(200, rng)
    assert found.noise < 2
    mine = readings[letter == 0]
    near = found.positions[0][again.integers(len(found.positions[0]), size=200)]
    place = near + again.uniform(-found.gap / 2, found.gap / 2, (200, 2))
    poses = np.column_stack([place, again.uniform(-np.pi, np.pi, 200)])
    truth = 30 * pressures("L", transform(poses, PAD))
    assert np.corrcoef(mine.ravel(), truth.ravel())[0, 1] > 0.95
