"""Touches whose load nobody knows: loads are told apart, and each touch may be of any of them."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import make_scan, model_of, paper_poses

from tactsim.core import Scan
from tactsim.estimators.field.table_field import TableField
from tactsim.estimators.likelihoods.folds import loads_of
from tactsim.estimators.likelihoods.load_mixture import LoadMixture
from tactsim.estimators.likelihoods.occupancy import learn_maps
from tactsim.estimators.options import LikelihoodOptions

SHARES = [0.5, 1.0]


def with_lighter_images(scan, stated=True):
    """Give each training press a second image: the left half of the pad alone is touched, half as hard."""
    rows = np.concatenate(
        [np.repeat(np.flatnonzero(scan.split == "train"), 2), np.flatnonzero(scan.split == "test")]
    )
    trained = 2 * np.count_nonzero(scan.split == "train")
    share = np.ones(len(rows))
    share[:trained:2] = 0.5
    readings = scan.readings[rows].copy()
    light = np.flatnonzero(share < 1)
    readings[light] = lighter(readings[light], scan.taxel_xy)
    return Scan(
        readings, scan.poses[rows], scan.labels[rows], scan.split[rows], scan.taxel_xy, dict(scan.meta),
        presses=rows if stated else None, moments=share if stated else None,
    )  # fmt: skip


def lighter(readings, taxel_xy):
    return 0.5 * readings * (taxel_xy[:, 0] < 0)


@pytest.fixture(scope="module")
def scan():
    return make_scan("EIL", poses=paper_poses(3, 4))


@pytest.fixture(scope="module")
def both(scan):
    return with_lighter_images(scan)


def test_loads_are_told_by_the_stated_shares(scan, both):
    train = both.where("train")
    assert np.array_equal(loads_of(train), np.tile([0, 1], len(train) // 2))
    assert not loads_of(scan.where("train")).any()
    whole = replace(train, moments=np.full(len(train), 0.25))
    assert not loads_of(whole).any()  # one load, whichever


def test_without_stated_shares_loads_are_told_by_what_was_felt_at_each_pose():
    poses, shares = np.repeat([[0.0, 0, 0], [5.0, 0, 1]], 8, axis=0), np.tile(SHARES, 8)
    felt = np.repeat([10.0, 300.0], 8) * shares  # at one pose the object is hardly touched
    readings = np.outer(felt, np.ones(36))
    train = Scan.from_arrays(readings, poses, ["A"] * 16)
    assert loads_of(train).tolist() == [0, 1] * 8
    assert not loads_of(train.chosen(shares == 0.5)).any()


def test_windows_of_one_image_tell_its_load_together():
    rng = np.random.default_rng(0)
    press, share, window = np.meshgrid(np.arange(8), SHARES, np.arange(3), indexing="ij")
    felt = (share * np.array([40.0, 300.0, 0.0])[window]).ravel()
    felt += rng.uniform(0, 30, len(felt))  # which is all there is in the third window
    poses = np.column_stack([5.0 * window.ravel(), np.zeros((len(felt), 2))])
    train = Scan.from_arrays(np.outer(felt, np.ones(36)), poses, ["A"] * len(felt))
    train = replace(train, presses=press.ravel())
    expected = (share == 1).ravel()
    assert np.array_equal(loads_of(train, of_images=True), expected)
    assert not np.array_equal(loads_of(train), expected)
    one = train.chosen(expected)
    assert not loads_of(one, of_images=True).any()
    assert loads_of(one).any()
    apart = replace(train, presses=None)
    assert np.array_equal(loads_of(apart, of_images=True), loads_of(apart))


@pytest.mark.parametrize("name", ["calibrated", pytest.param("force", marks=pytest.mark.long)])
def test_log_p_is_the_log_of_the_mean_over_the_loads(both, name):
    options = LikelihoodOptions(likelihood=name)
    train = both.where("train")
    mixture = LoadMixture(options, loads_of(train))
    mixture.fit(both, learn_maps(both))
    rng = np.random.default_rng(0)
    touches = [(both.readings[k], rng.uniform(-5, 5, 3)) for k in rng.integers(len(both), size=3)]
    states = np.array([rng.uniform(-8, 8, 200), rng.uniform(-8, 8, 200), rng.uniform(-3, 3, 200)])
    cell = options.cell
    letter = 1
    expected = np.zeros(200)
    together = TableField(mixture, both.letters, both.taxel_xy, (cell, cell), cell)
    for reading, pose in touches:
        of_loads = []
        for number in range(2):
            own = train.chosen(loads_of(train) == number)
            alone = model_of(name, own)
            field = TableField(alone, both.letters, both.taxel_xy, (cell, cell), cell)
            field.add(alone.evidence(reading), pose)
            of_loads.append(field.log_p(letter, states))
        expected += np.logaddexp(*of_loads) - np.log(2)
        together.add(mixture.evidence(reading), pose)
    # The lattices of tables begin elsewhere where maps differ in size.
    assert together.log_p(letter, states) == pytest.approx(expected, rel=0.02, abs=0.5)
    parts = [together.log_p(letter, states, k, k + 1) for k in range(3)]
    assert together.log_p(letter, states) == pytest.approx(sum(parts), abs=1e-9)
    upper = together.terms.upper
    assert (together.log_p(letter, states) <= upper[3]).all()


def test_an_object_without_readings_at_a_load_has_all_of_them_there(both):
    train = both.where("train")
    kept = ~((train.labels == "E") & (train.moments < 1))
    mixture = LoadMixture(LikelihoodOptions(likelihood="calibrated"), loads_of(train.chosen(kept)))
    some = train.chosen(kept)
    mixture.fit(some, learn_maps(some))
    assert [sorted(model.maps) for model in mixture.of_load] == [["E", "I", "L"]] * 2
    tables = mixture.log_tables("E", np.zeros((1, 2)))
    assert np.isfinite(tables).all()
