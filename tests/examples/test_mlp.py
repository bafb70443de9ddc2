"""The example of a learned method: its contract, what single readings are fused by, its temperature, its readings."""

import sys
from pathlib import Path

import numpy as np
import pytest
from synthetic import draw_trial, follow, make_scan, paper_poses, pressures, square_pad

import tactsim
from tactsim.core import Scan, transform
from tactsim.estimators import create
from tactsim.estimators.contract import CHECKS, Case
from tactsim.estimators.likelihoods.force import ForceLikelihood
from tactsim.estimators.likelihoods.occupancy import learn_maps
from tactsim.estimators.options import LikelihoodOptions

pytest.importorskip("sklearn", reason="needs scikit-learn")
sys.path.insert(0, str(Path(tactsim.__file__).parents[1] / "examples" / "mlp"))
import tactsim_mlp

LETTERS = "EIL"
OPTIONS = {"rounds": 3, "hidden": 32}


def made(scan=None):
    estimator = tactsim_mlp.Mlp(tactsim_mlp.MlpOptions(**OPTIONS))
    if scan is not None:
        estimator.fit(scan)
    return estimator


def test_its_name_leads_to_the_example():
    with pytest.raises(tactsim.InputError, match=r"^estimator mlp is no longer built in: .*examples/mlp"):
        create("mlp")


@pytest.mark.long
@pytest.mark.parametrize("check", CHECKS)
def test_it_keeps_the_contract_of_estimators(check):
    check(Case(made))


@pytest.fixture(scope="module")
def scan():
    return make_scan(LETTERS, poses=paper_poses(positions=4, angles=12))


@pytest.fixture(scope="module")
def learned(scan):
    return made(scan)


def named(estimator, readings):
    """The networks' own log p(letter | reading), (n, letters)."""
    return estimator._log_p(estimator._net, readings)


@pytest.mark.long
def test_a_sequence_is_the_product_of_its_readings_at_the_temperature(learned, scan):
    readings, poses, _ = draw_trial(scan, "L", 5, np.random.default_rng(1))
    said = follow(learned, readings, poses)[-1]
    product = np.exp(named(learned, readings) / learned.temperature).prod(axis=0)
    assert list(said.probabilities.values()) == pytest.approx(product / product.sum())
    assert said.robot_in_object.tolist() == [0, 0, 0]


def test_the_temperature_is_what_foretells_left_out_letters_best(learned, scan, monkeypatch):
    """Of a network that is as sure as can be and right by halves, and of one that hedges as it should."""
    train = scan.where("train")
    truth = np.array([LETTERS.index(label) for label in train.labels])

    def found(sure):
        def log_p(self, net, readings):
            of_reading = [np.flatnonzero((train.readings == one).all(axis=1))[0] for one in readings]
            rng = np.random.default_rng(0)
            said = np.where(rng.random(len(readings)) < 0.6, truth[of_reading], (truth[of_reading] + 1) % 3)
            return np.log(np.where(np.arange(3) == said[:, None], sure, (1 - sure) / 2))

        monkeypatch.setattr(tactsim_mlp.Mlp, "_log_p", log_p)
        monkeypatch.setattr(tactsim_mlp.Mlp, "_trained", lambda self, rendered: None)
        return learned._learn_temperature(tactsim_mlp.learn_rendering(learned._model, train), train)

    assert found(0.999) > 3
    assert found(0.6) == pytest.approx(1, abs=0.25)


def test_a_reading_beyond_all_that_was_trained_excludes_no_letter(learned):
    learned.reset(np.random.default_rng(0))
    for _ in range(3):
        learned.update(np.full(36, 1e8), [0, 0, 0])
    # Three readings that excluded a letter as far as one reading can.
    assert min(learned.estimate().probabilities.values()) > 0.5 * (0.01 / 3) ** (3 / learned.temperature)


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
    return tactsim_mlp.learn_rendering(model, scan)


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
