"""A measurement model of one's own, which couples taxels: what `bench new likelihood` makes, in every filter."""

import sys
from importlib import import_module
from importlib.metadata import EntryPoint

import numpy as np
import pytest
from synthetic import draw_trial, follow, make_scan, paper_poses

from tactsim.bench.new import make
from tactsim.core import plug_ins
from tactsim.estimators import create
from tactsim.estimators.filters.trust import learn_trust
from tactsim.estimators.likelihoods import likelihood
from tactsim.estimators.likelihoods.calibrated import CalibratedLikelihood
from tactsim.estimators.likelihoods.likelihood import Likelihood
from tactsim.estimators.likelihoods.occupancy import learn_maps_by

FILTERS = {
    "histogram": {"bins": 2000},
    "refined": {"bins": 1000, "cells": 40},
    "particle": {"particles": 2000},
}


@pytest.fixture(scope="module", autouse=True)
def installed(tmp_path_factory):
    """Stand in for the installed package: its entry point, as pyproject.toml names it."""
    folder = make("likelihood", "cosine", tmp_path_factory.mktemp("made") / "cosine")
    assert 'cosine = "cosine:Cosine"' in (folder / "pyproject.toml").read_text()
    point = EntryPoint("cosine", "cosine:Cosine", likelihood.GROUP)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder / "src"))
        patch.setattr(plug_ins, "plug_ins", lambda group: (point,) if group == likelihood.GROUP else ())
        yield import_module("cosine")
    sys.modules.pop("cosine", None)


@pytest.mark.parametrize("name", FILTERS)
def test_every_filter_takes_it_with_its_option(name):
    scan = make_scan("EIL", poses=paper_poses(4, 8))
    right = 0
    estimator = create(name, likelihood="cosine", k=20.0, **FILTERS[name])
    estimator.fit(scan)
    for seed, letter in enumerate("EIL"):
        readings, poses, _ = draw_trial(scan, letter, 8, np.random.default_rng(seed))
        last = follow(estimator, readings, poses)[-1]
        right += last.label == letter
        assert sum(last.probabilities.values()) == pytest.approx(1)
    assert right >= 2
    assert estimator.work["ignored_readings"] == 0
    assert estimator.work["likelihood_evaluations"] > 0
    assert estimator.options.k == 20.0


class Plain(Likelihood):
    """The calibrated model as a function that nobody knows to be a sum over taxels."""

    options_type = CalibratedLikelihood.options_type

    def fit(self, scan, maps):
        super().fit(scan, maps)
        self.of = CalibratedLikelihood(self.options)
        self.of.fit(scan, maps)

    def log_p(self, reading, pose, label, states):
        return self.of.log_p(reading, pose, label, states)


class Forgetting(Plain):
    def without(self, train, gone, labels, whole_positions):
        rest = type(self)(self.options)
        rest.of = self.of.without(train, gone, labels, whole_positions)
        return rest


def trust_of(kind, scan):
    model = kind(CalibratedLikelihood.options_type())
    model.fit(scan, learn_maps_by(model.options, scan))
    return learn_trust(model, scan)


@pytest.mark.long
def test_a_model_of_ones_own_is_trusted_as_far_as_left_out_readings_tell():
    scan = make_scan("EL", poses=paper_poses(5, 8))
    known, plain, forgetting = (trust_of(kind, scan) for kind in (CalibratedLikelihood, Plain, Forgetting))
    assert (plain(1), plain(20)) == (1, 1)  # it learns more than maps, and does not say how to forget
    for count in (3, 20):  # fewer moves are tried, and taxels that lie where none was felt count too
        assert forgetting(count) == pytest.approx(known(count), rel=0.5)
        assert forgetting(count) != 1


def test_the_maps_of_a_model_that_learns_nothing_else_are_learned_again_without_readings(installed):
    scan = make_scan("EL", poses=paper_poses(5, 8))
    train = scan.where("train")
    gone = np.arange(len(train)) % 4 == 0
    model = installed.Cosine(installed.Cosine.options_type())
    model.fit(scan, learn_maps_by(model.options, scan))
    rest = model.without(train, gone, ["L"], True)
    again = learn_maps_by(model.options, train.chosen(~gone))["L"]
    assert np.array_equal(rest.maps["L"].log_odds, again.log_odds)
    assert not np.array_equal(model.maps["L"].log_odds, again.log_odds)
