"""The default takes maps where poses are told, and images of whole presses where they are not."""

import re
from dataclasses import replace

import numpy as np
import pytest
from synthetic import BarForward, make_scan, square_pad

from tactsim.core import InputError, Scan
from tactsim.estimators import create

PAD = square_pad(12, 12)
ORIGIN = np.zeros(3)
QUICK = {"bins": 500, "cells": 20, "halvings": 3}


def pressed(rng, spread, count=12):
    """Press I, L and T `count` times each, all stated at one pose, and `spread` mm and rad about it in truth."""
    forward, labels = BarForward("ILT", PAD), np.repeat(list("ILT"), count)
    at = spread * rng.uniform([-1, -1, -1], [1, 1, 1], (len(labels), 3))
    readings = np.concatenate(
        [forward.readings(label, pose[None]) for label, pose in zip(labels, at, strict=True)]
    )
    readings = readings + rng.normal(0, 0.5, readings.shape)
    return Scan(readings, np.zeros_like(at), labels, np.tile(["train", "test"], len(labels) // 2), PAD)


@pytest.fixture(scope="module")
def anywhere():
    return pressed(np.random.default_rng(1), 3.0, 24)


def fitted(scan, **options):
    estimator = create("stacked", **QUICK, **options)
    estimator.fit(scan)
    return estimator


def answer(estimator, *readings, seed=0):
    estimator.reset(np.random.default_rng(seed))
    for reading in readings:
        estimator.update(reading, ORIGIN)
    return estimator.estimate()


def test_presses_that_lie_elsewhere_than_stated_are_named_as_whole_image_names_them(anywhere):
    estimator, baseline = fitted(anywhere), create("whole-image")
    baseline.fit(anywhere)
    test = anywhere.where("test")
    for label in test.letters:
        own = test.where(label=label).readings[:3]
        said = answer(estimator, *own)
        assert said.probabilities == answer(baseline, *own).probabilities
        assert said.label == label
        assert said.samples is None
    assert (
        "by images of whole presses: those of an object are stated at one pose, but" in estimator.describe()
    )
    assert estimator.work["likelihood_evaluations"] > 0
    assert not estimator.maps
    assert estimator.belief_over_plane() is None
    assert not estimator.proposes
    with pytest.raises(InputError, match="knows no poses here, proposes no readings"):
        estimator.propose([ORIGIN])
    with pytest.raises(InputError, match="by their images here, and holds no states"):
        estimator.weighted_states()
    assert estimator.budget is None  # no bins are asked


def test_an_object_may_have_a_pose_of_its_own_and_any_unit(anywhere):
    poses = np.array([[30.0 * "ILT".index(label), 5.0, 1.0] for label in anywhere.labels])
    moved = replace(anywhere, poses=poses, meta={"source": "imported", "unit": "count"})
    estimator = fitted(moved)
    assert estimator.image is not None
    assert not estimator.fits_pad(moved)
    assert not create("stacked").fits_pad(moved)
    reading = anywhere.where("test").readings[0]
    assert answer(estimator, reading).probabilities == answer(fitted(anywhere), reading).probabilities


def test_a_scan_may_say_that_no_pose_is_known():
    scan = pressed(np.random.default_rng(3), 0.2)
    assert fitted(scan).image is None
    estimator = fitted(replace(scan, meta={"poses": "unknown"}))
    assert "nobody knows their poses" in estimator.describe()
    trained = replace(scan, meta={"train": {"poses": "unknown"}})  # tested on presses whose poses are known
    assert "nobody knows their poses" in fitted(trained).describe()
    with pytest.raises(InputError, match="maps need poses, but nobody knows their poses; leave unknown out"):
        fitted(replace(scan, meta={"poses": "unknown"}), unknown=0.5)
    scan = make_scan("ILT")
    assert (
        fitted(replace(scan, meta={"poses": "unknown"})).image is None
    )  # presses that were aligned have poses


def test_images_name_presses_of_one_pose_where_maps_name_fewer():
    """Bins as wide as an object cannot tell the three apart."""
    scan = pressed(np.random.default_rng(2), 0.2, 24)
    estimator = create("stacked", split="1x1x2", cells=1, halvings=0)
    estimator.fit(scan)
    assert re.fullmatch(
        r"by images.*: of \d+ left-out readings they name 9 rightly, maps [0-6]", estimator.describe()
    )
    assert fitted(scan).image is None


def test_what_was_left_out_is_not_named(anywhere):
    estimator = fitted(anywhere)
    rest = estimator.without("L", anywhere)
    reading = anywhere.where("test", "L").readings[0]
    assert set(answer(rest, reading).probabilities) == {"I", "T"}
    assert answer(estimator, reading).label == "L"
    assert answer(rest.without("T", anywhere.untrained(["L"])), reading).label == "I"


@pytest.mark.parametrize(
    "why",
    [
        "repeated",
        "of a real pad",
        "at any load",
        "at two loads",
        "told",
        "none of these",
        "one press each",
        "one object",
    ],
)
def test_maps_stay_where_poses_are_told_or_only_they_answer(why):
    rng = np.random.default_rng(2)
    scan, options = pressed(rng, 0.2), {}
    if why == "told":
        scan = make_scan("ILT")
    elif why == "of a real pad":
        scan = replace(scan, meta={"source": "imported", "unit": "count"})
    elif why == "at any load":
        scan = replace(scan, readings=scan.readings * np.exp(0.5 * rng.standard_normal((len(scan), 1))))
    elif why == "at two loads":  # of each press
        both = scan.joined(replace(scan, readings=scan.readings / 10), {})
        scan = replace(both, presses=np.tile(np.arange(len(scan)), 2))
    elif why == "one object":
        scan = pressed(rng, 3.0).where(label="T")
    elif why == "none of these":
        options = {"unknown": 0.5}
    elif why == "one press each":
        scan = pressed(rng, 3.0, 2)
    estimator = fitted(scan, **options)
    assert estimator.image is None
    assert (estimator.pad_fit is not None) == estimator.fits_pad(scan) == (why == "of a real pad")
    assert set(estimator.maps) == set(scan.letters)
    assert answer(estimator, scan.where("test").readings[0]).samples is not None


def test_a_new_fit_takes_maps_again(anywhere):
    scan = make_scan("ILT")
    estimator, new = fitted(anywhere), fitted(scan)
    estimator.fit(scan)
    reading = scan.where("test").readings[0]
    assert answer(estimator, reading).probabilities == answer(new, reading).probabilities
    assert estimator.describe() == new.describe()
    assert estimator.budget == new.budget == "bins"
