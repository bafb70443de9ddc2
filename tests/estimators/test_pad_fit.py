"""What is fitted to a pad: nothing depends on the unit, the pitch or the order of taxels, and nothing bad breaks it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic import fitted_anew, make_scan, paper_poses, started

from tactsim import estimators
from tactsim.core import InputError, Scan, compose, invert
from tactsim.estimators.filters.refined import ForceMosaicOptions, RefinedOptions
from tactsim.estimators.options import wants_pad_fit
from tactsim.estimators.pad_fit import (
    class_information,
    climb,
    fit_to_pad,
    mutual_information,
    pressure_information,
    response,
    units_of,
)
from tactsim.estimators.registry import load

SMALL = {
    "histogram": {"bins": 1000}, "particle": {"particles": 500}, "augmented-mcl": {"particles": 500},
    "refined": {"bins": 1000, "cells": 30}, "force-mosaic": {"bins": 1000, "cells": 30},
    "graded": {"bins": 1000, "cells": 30},
}  # fmt: skip


@pytest.fixture(scope="module")
def scan() -> Scan:
    return make_scan("EI", poses=paper_poses(positions=3, angles=4))


def changed(scan: Scan, unit: float = 1.0, length: float = 1.0, order: np.ndarray | None = None) -> Scan:
    """Give the same presses in another unit, on a pad and objects of another size, with taxels in another order."""
    order = np.arange(len(scan.taxel_xy)) if order is None else order
    return replace(
        scan,
        readings=unit * scan.readings[:, order],
        poses=scan.poses * [length, length, 1],
        taxel_xy=length * scan.taxel_xy[order],
    )


def believed(name: str, scan: Scan, length: float = 1.0):
    """Feel five test readings of a hidden letter; the last estimate with its pose in mm of the unchanged scan."""
    estimator = fitted_anew(name, scan, fit="auto", **SMALL[name])
    estimator.reset(np.random.default_rng(3))
    test = scan.where("test", "E")
    chosen = np.random.default_rng(1).permutation(len(test))[:5]
    hidden = np.array([2.0 * length, -1.5 * length, 0.7])
    for reading, pose in zip(test.readings[chosen], test.poses[chosen], strict=True):
        estimator.update(reading, compose(invert(hidden), pose))
    known = estimator.estimate()
    return known, known.robot_in_object / [length, length, 1], estimator


@pytest.mark.long
@pytest.mark.parametrize("name", SMALL)
def test_no_filter_depends_on_unit_size_or_order_of_taxels(scan, name):
    order = np.random.default_rng(0).permutation(len(scan.taxel_xy))
    known, pose, one = believed(name, scan)
    again, there, other = believed(name, changed(scan, 1 / 1000, 2.0, order), 2.0)
    assert again.label == known.label == "E"
    assert again.probabilities == pytest.approx(known.probabilities, abs=1e-6)
    assert there == pytest.approx(pose, abs=1e-4)
    assert other.pad_fit.units.length == pytest.approx(2.0)
    plane = other.belief_over_plane()
    assert plane is None or plane.x.max() > 15  # of 20 mm, as offsets follow the pad's size
    assert other.maps["E"].extent == pytest.approx([2 * end for end in one.maps["E"].extent])
    assert 0 <= other.propose(np.array([[0.0, 0, 0], [4.0, 4.0, 1.0]])) <= 1


@pytest.mark.parametrize("way", ["rising", "falling", "some fall"])
@pytest.mark.parametrize("name", ["histogram", "refined"])
def test_no_filter_depends_on_offsets_and_signs_of_taxels(scan, name, way):
    turned = {"rising": 1.0, "falling": -1.0, "some fall": np.where(np.arange(36) % 3, 1.0, -1.0)}[way]
    offsets = np.random.default_rng(0).uniform(0, 4000, 36)
    known, pose, _ = believed(name, scan)
    again, there, other = believed(name, replace(scan, readings=20 * turned * scan.readings + offsets))
    assert again.label == known.label == "E"
    assert again.probabilities == pytest.approx(known.probabilities, abs=1e-6)
    assert there == pytest.approx(pose, abs=1e-6)
    assert np.array_equal(other.pad_fit.units.idle.sign, np.broadcast_to(turned, 36))


@settings(max_examples=25, deadline=None)
@given(st.floats(1e-4, 1e4), st.floats(0.2, 10), st.sampled_from([0.5, 1.0, 2.0]))
def test_a_scan_in_another_unit_and_size_is_the_same_scan(unit, length, exponent):
    scan = make_scan("I", poses=paper_poses(positions=3, angles=2))
    one, two = scan, changed(scan, unit, length)
    first, second = (units_of(each, exponent).scan(each) for each in (one, two))
    for name in ("readings", "poses", "taxel_xy"):
        assert getattr(second, name) == pytest.approx(getattr(first, name), rel=3e-7, abs=1e-6)


def test_options_that_were_given_are_kept_in_the_units_they_were_given_in(scan):
    twice = changed(scan, unit=10.0, length=2.0)
    given = {"sigma": 3.0, "threshold": 15.0, "reach": 30.0, "motion": "0.5,0.03", "quantiles": 7}
    asked = estimators.create("refined", fit="auto", **given).options
    found = fit_to_pad(twice, asked)
    inner, outer = found.inner(asked), found.outer(asked)
    assert [inner.sigma, inner.reach, *map(float, inner.motion.split(","))] == pytest.approx(
        [1.5, 15, 0.25, 0.03]
    )
    assert inner.quantiles == 7
    assert inner.threshold == pytest.approx(15.0 / found.units.pressure * 36, rel=1e-6)
    assert (outer.sigma, outer.threshold, outer.reach) == (3.0, 15.0, 30.0)
    assert set(found.chosen) <= {"ratio"}


@pytest.mark.parametrize("bent_by", [1.0, 3.0])
def test_the_response_is_the_one_with_which_most_is_said(scan, bent_by):
    readings = np.sign(scan.readings) * 25 * np.abs(scan.readings / 25) ** bent_by
    bent = replace(scan, readings=readings).where("train")
    exponent, straight, most = response(bent, ForceMosaicOptions())

    def said(tried: float) -> float:
        return pressure_information(units_of(bent, tried).scan(bent), ForceMosaicOptions())

    assert (straight, most) == (said(1.0), said(exponent))
    if exponent != 1:
        assert most > straight * 1.002


def test_a_model_of_both_is_fitted_as_pressures_are_with_the_threshold_and_ratio_of_classes(scan):
    bent = replace(scan, readings=np.sign(scan.readings) * np.abs(scan.readings / 25) ** 3)
    both, forces = (fit_to_pad(bent, load(name).options_type()) for name in ("stacked", "force-mosaic"))
    assert both.units == forces.units
    assert both.chosen["sigma"] == forces.chosen["sigma"]
    assert (both.before, both.after) == (forces.before, forces.after)
    options = load("stacked").options_type(sigma=1.0, cell=0.4)
    given = fit_to_pad(bent, options)
    brought = given.units.scan(bent)
    at_first = class_information(brought, replace(given, chosen=forces.chosen).inner(options))
    assert class_information(brought, given.inner(options)) > at_first


def test_only_scans_of_a_real_pad_are_fitted_unless_it_is_asked_for(scan):
    recorded, imported = (replace(scan, meta={"source": word}) for word in ("recorded", "imported"))
    trained = replace(scan, meta={"source": "simulated", "train": {"source": "recorded"}})
    assert [wants_pad_fit(RefinedOptions(), one) for one in (scan, recorded, imported, trained)] == [
        False,
        *[True] * 3,
    ]
    assert wants_pad_fit(RefinedOptions(fit="auto"), scan)
    assert not wants_pad_fit(RefinedOptions(fit="off"), recorded)


BAD = {
    "one press": lambda scan: scan.where("train", "E").chosen(np.arange(len(scan.where("train", "E"))) == 3),
    "all zeros": lambda scan: replace(scan, readings=np.zeros_like(scan.readings)),
    "one position": lambda scan: replace(scan, poses=scan.poses * [0, 0, 1]),
    "all taxels equal": lambda scan: replace(scan, readings=np.full_like(scan.readings, 7.0)),
    "one taxel": lambda scan: replace(scan, readings=scan.readings[:, :1], taxel_xy=scan.taxel_xy[:1]),
}


@pytest.mark.long
@pytest.mark.parametrize("what", BAD)
@pytest.mark.parametrize("name", ["refined", "force-mosaic"])
def test_little_to_learn_from_breaks_nothing(scan, name, what):
    bad = BAD[what](scan)
    estimator = started(name, bad, fit="auto", bins=100, cells=5)
    estimator.update(bad.readings[0], bad.poses[0])
    assert sum(estimator.estimate().probabilities.values()) == pytest.approx(1)


def test_mutual_information_against_closed_forms():
    first, second = (np.repeat([0, 1], 5000), np.tile([0, 1], 5000))
    assert mutual_information(first, first) == pytest.approx(np.log(2), abs=1e-3)
    assert mutual_information(first, second) == pytest.approx(0, abs=1e-3)
    assert mutual_information(first[:0], first[:0]) == 0
    # Of few pairs chance makes more; on average it is taken off.
    few = [mutual_information(*np.random.default_rng(seed).integers(0, 4, (2, 100))) for seed in range(300)]
    assert np.mean(few) == pytest.approx(0, abs=0.005)


def test_a_first_step_says_more_by_a_share_whatever_the_sign():
    """Information is below 0 where few presses are left out."""
    assert climb(lambda value: -0.3499, (1.0, 1.4), 1.0, -0.35, 1.01) == (1.0, -0.35)
    assert climb(lambda value: -0.3, (1.0, 1.4), 1.0, -0.35, 1.01) == (1.4, -0.3)
    assert climb(lambda value: 0.3501, (1.0, 1.4), 1.0, 0.35, 1.01) == (1.0, 0.35)


def test_what_only_test_readings_hold_changes_no_fit(scan):
    stray = scan.readings.copy()
    stray[np.flatnonzero(scan.split == "test")[0], 0] = 9e8
    counts = replace(scan, meta={**scan.meta, "unit": "count"})
    one, other = (
        fitted_anew("refined", of, fit="auto", **SMALL["refined"])
        for of in (counts, replace(counts, readings=stray))
    )
    assert one.pad_fit.facts() == other.pad_fit.facts()


def test_readings_that_never_rise_are_refused_in_words(scan):
    few = scan.with_train_presses(10, np.random.default_rng(0))  # so few do not tell what is read at rest
    with pytest.raises(InputError, match="no training reading is above 0"):
        fitted_anew("refined", replace(few, readings=-1e7 - few.readings), fit="auto")
