"""The network on single readings: what it is fused by, its temperature, and what is said without its extra."""

import numpy as np
import pytest
from synthetic import draw_trial, make_scan, paper_poses

from tactsim import estimators
from tactsim.core import InputError, Scan
from tactsim.estimators.filters import mlp

pytest.importorskip("sklearn", reason="needs scikit-learn")
LETTERS = "EIL"
OPTIONS = {"rounds": 12, "hidden": 48}


@pytest.fixture(scope="module")
def scan():
    return make_scan(LETTERS, poses=paper_poses(positions=4, angles=12))


@pytest.fixture(scope="module")
def learned(scan):
    estimator = estimators.create("mlp", **OPTIONS)
    estimator.fit(scan)
    return estimator


def named(estimator, readings):
    """The networks' own log p(letter | reading), (n, letters)."""
    return estimator._log_p(estimator._net, readings)


@pytest.mark.long
def test_a_sequence_is_the_product_of_its_readings_at_the_temperature(learned, scan):
    learned.reset(np.random.default_rng(0))
    readings, poses, _ = draw_trial(scan, "L", 5, np.random.default_rng(1))
    for reading, pose in zip(readings, poses, strict=True):
        learned.update(reading, pose)
    product = np.exp(named(learned, readings) / learned.temperature).prod(axis=0)
    said = learned.estimate()
    assert list(said.probabilities.values()) == pytest.approx(product / product.sum())
    assert said.robot_in_object.tolist() == [0, 0, 0]


@pytest.mark.long
def test_it_names_readings_at_poses_that_were_never_pressed(learned):
    rng = np.random.default_rng(4)
    poses = np.column_stack([rng.uniform(-8, 8, (100, 2)), rng.uniform(-np.pi, np.pi, 100)])
    elsewhere = make_scan(LETTERS, poses=poses, seed=5).where("test")
    truth = np.array([LETTERS.index(label) for label in elsewhere.labels])
    right = (named(learned, elsewhere.readings).argmax(axis=1) == truth).mean()
    assert right > 1 / 3 + 3 * np.sqrt(2 / 9 / len(truth))  # three standard errors better than guessing


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


@pytest.mark.long
def test_the_seed_is_what_networks_differ_by_and_not_the_order_of_the_letters(scan):
    scan = scan.of_letters("EI")
    reversed_order = np.argsort(scan.labels == "E", kind="stable")
    turned = Scan(
        scan.readings[reversed_order], scan.poses[reversed_order], scan.labels[reversed_order],
        scan.split[reversed_order], scan.taxel_xy,
    )  # fmt: skip
    reading = scan.where("test").readings[[5]]
    answers = []
    for seed, known in ((0, scan), (0, turned), (1, scan)):
        estimator = estimators.create("mlp", rounds=1, hidden=8, seed=seed)
        estimator.fit(known)
        answers.append(named(estimator, reading).tolist())
    assert answers[0] == answers[1] != answers[2]


def test_a_reading_beyond_all_that_was_trained_excludes_no_letter(learned):
    learned.reset(np.random.default_rng(0))
    for _ in range(3):
        learned.update(np.full(36, 1e8), [0, 0, 0])
    # Three readings that excluded a letter as far as one reading can.
    assert min(learned.estimate().probabilities.values()) > 0.5 * (0.01 / 3) ** (3 / learned.temperature)


def test_letters_with_equal_readings_are_one_class(scan):
    both = scan.of_letters("EI")
    one = both.where("train", "E")
    doubled = Scan(
        np.concatenate([both.readings, one.readings]), np.concatenate([both.poses, one.poses]),
        np.concatenate([both.labels, np.full(len(one), "F")]), np.concatenate([both.split, one.split]), both.taxel_xy,
    )  # fmt: skip
    estimators_of = [estimators.create("mlp", rounds=1, hidden=8) for _ in range(2)]
    said = []
    for estimator, known in zip(estimators_of, (both, doubled), strict=True):
        estimator.fit(known)
        estimator.reset(np.random.default_rng(0))
        estimator.update(both.where("test", "E").readings[3], [0, 0, 0])
        said.append(estimator.estimate().probabilities)
    assert said[1]["E"] == said[1]["F"]
    assert said[1]["E"] / said[1]["I"] == pytest.approx(said[0]["E"] / said[0]["I"])


def test_without_its_extra_there_is_one_line_and_the_list_is_whole(monkeypatch):
    monkeypatch.setattr(mlp, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"^estimator mlp needs .*pip install 'tactsim\[learned\]'$"):
        estimators.create("mlp")
    assert "mlp" in estimators.names()
