"""Each correction of the paper's equations, and that the printed form fails."""

import misprints
import numpy as np
import pytest
import reference
from synthetic import draw_trial, make_scan, paper_poses

from tactsim import estimators
from tactsim.estimators.filters import map_filter
from tactsim.estimators.likelihoods.classifier import CONTACT, NO_CONTACT, UNKNOWN, classify
from tactsim.estimators.likelihoods.occupancy import learn_maps

TRIALS = 16


def accuracy(scan, maps=None, readings=14, **options):
    """Share of trials whose letter is right, with the filter's own maps or with others."""
    filter = estimators.create("histogram", bins=10_000, **options)
    with pytest.MonkeyPatch.context() as patch:
        if maps is not None:
            patch.setattr(map_filter, "learn_maps_by", lambda *_, **__: maps)
        filter.fit(scan)
    right = 0
    for seed in range(TRIALS):
        rng = np.random.default_rng(seed)
        label = scan.letters[seed % len(scan.letters)]
        filter.reset(rng)
        for reading, pose in zip(*draw_trial(scan, label, readings, rng)[:2], strict=True):
            filter.update(reading, pose)
        right += filter.estimate().label == label
    return right / TRIALS


@pytest.fixture(scope="module")
def shapes():
    return make_scan("EILT", poses=paper_poses(positions=4, angles=4))


def test_corrected_equations_recognise_every_shape(shapes):
    assert accuracy(shapes) >= 0.9
    assert accuracy(shapes, misprints.maps(shapes)) >= 0.9


def test_maps_are_the_corrected_equations_cell_by_cell(shapes):
    ours = learn_maps(shapes, cell=1.0)
    for label, slow in misprints.maps(shapes).items():
        rows, columns = np.meshgrid(np.arange(-18, 18.5), np.arange(-18, 18.5), indexing="ij")
        xy = np.stack([columns, rows], axis=-1)
        assert ours[label].log_odds_at(xy) == pytest.approx(slow.log_odds_at(xy), abs=1e-6)


def test_equation_4_as_printed_gives_no_map(shapes):
    # Its G' is 1.128 / sigma at the centre: above 1 it is no probability, and the map holds NaN.
    with pytest.raises(ValueError, match="not finite"):
        misprints.maps(shapes, sigma=1.0, spread="printed")


@pytest.mark.parametrize("printed", ["unknown", "last"])
def test_equations_5_and_6_as_printed_recognise_nothing(shapes, printed):
    maps = misprints.maps(shapes, **{printed: "printed"})
    assert accuracy(shapes, maps) <= 0.5  # chance is 0.25


def test_equation_3_as_printed_learns_nothing_from_emptiness():
    def as_printed(taxels, threshold=2.0):
        largest = max(taxels)
        return [
            CONTACT if e > threshold and e > 0.3 * largest
            else NO_CONTACT if e < threshold and e < 0.3 * largest
            else UNKNOWN
            for e in taxels
        ]  # fmt: skip

    assert set(as_printed([0.0] * 36)) == {UNKNOWN}
    assert set(classify(np.zeros(36)).tolist()) == {NO_CONTACT}
    assert as_printed([2.0, 20.0])[0] == UNKNOWN  # e == T, though it is far below 0.3 of the largest
    assert classify([2.0, 20.0])[0] == NO_CONTACT


def test_an_empty_reading_moves_the_belief_away_from_the_object(shapes):
    filter = estimators.create("histogram", split="9x9x8")
    filter.fit(shapes)
    filter.reset(np.random.default_rng(0))
    filter.update(np.zeros(36), [0.0, 0.0, 0.0])
    plane = filter.belief_over_plane().probability.sum(axis=0)
    assert plane[4, 4] < 0.1 * plane.max()  # with the pad on the object it could not be empty


@pytest.mark.parametrize("failure", ["printed", "complement"])
def test_either_form_of_equation_7_recognises_every_shape(shapes, failure):
    assert accuracy(shapes, failure=failure) >= 0.9


def test_only_the_complement_makes_equation_7_a_distribution(shapes):
    sums = {}
    for failure in ("printed", "complement"):
        filter = estimators.create("histogram", bins=100, failure=failure)
        filter.fit(shapes)
        sums[failure] = np.exp(filter.likelihood.log_tables("E", [[0.0, 0.0], [8.0, 3.0]])).sum(axis=0)
    assert sums["complement"] == pytest.approx([1, 1])
    assert sums["printed"] == pytest.approx([0.94, 0.94])  # gamma (2 p(m) - 1) short of one


def test_classes_agree_with_equation_3_taxel_by_taxel():
    rng = np.random.default_rng(0)
    names = {CONTACT: reference.CONTACT, NO_CONTACT: reference.NO_CONTACT, UNKNOWN: reference.UNKNOWN}
    for scale in (0.5, 3.0, 30.0):
        for reading in np.round(rng.normal(0, scale, size=(50, 36)) / 0.7) * 0.7:
            assert [names[k] for k in classify(reading)] == reference.classify(reading)
    # Below zero after a tare, at the threshold, and several readings at once.
    below = np.array([[-3.0, -1.0, -0.2], [2.0, 2.0, 1.0], [6.67, 2.0, 2.1]])
    assert [[names[k] for k in row] for row in classify(below)] == [reference.classify(r) for r in below]
