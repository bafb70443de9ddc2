"""The network on single readings: what it is fused by, its temperature, and what is said without its extra."""

from importlib.util import find_spec

import numpy as np
import pytest
from synthetic import draw_trial, fitted_anew, follow, make_scan, paper_poses

from tactsim import estimators
from tactsim.core import InputError
from tactsim.estimators.filters import mlp

pytestmark = pytest.mark.skipif(find_spec("sklearn") is None, reason="needs scikit-learn")
LETTERS = "EIL"
OPTIONS = {"rounds": 3, "hidden": 16}


@pytest.fixture(scope="module")
def scan():
    return make_scan(LETTERS, poses=paper_poses(positions=4, angles=12))


@pytest.fixture(scope="module")
def learned(scan):
    return fitted_anew("mlp", scan, **OPTIONS)


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

        monkeypatch.setattr(mlp.Mlp, "_log_p", log_p)
        monkeypatch.setattr(mlp.Mlp, "_trained", lambda self, rendered: None)
        return learned._learn_temperature(mlp.learn_rendering(learned._model, train), train)

    assert found(0.999) > 3
    assert found(0.6) == pytest.approx(1, abs=0.25)


def test_a_reading_beyond_all_that_was_trained_excludes_no_letter(learned):
    learned.reset(np.random.default_rng(0))
    for _ in range(3):
        learned.update(np.full(36, 1e8), [0, 0, 0])
    # Three readings that excluded a letter as far as one reading can.
    assert min(learned.estimate().probabilities.values()) > 0.5 * (0.01 / 3) ** (3 / learned.temperature)


def test_without_its_extra_there_is_one_line_and_the_list_is_whole(monkeypatch):
    monkeypatch.setattr(mlp, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"^estimator mlp needs .*pip install 'tactsim\[learned\]'$"):
        estimators.create("mlp")
    assert "mlp" in estimators.names()
