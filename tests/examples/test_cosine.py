"""The example of a measurement model that couples taxels: any function of reading and state, in every filter."""

import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from synthetic import draw_trial, follow, make_scan, paper_poses

import tactsim
from tactsim.core import plug_ins
from tactsim.estimators import create
from tactsim.estimators.contract import LIKELIHOOD_CHECKS, LikelihoodCase
from tactsim.estimators.likelihoods import likelihood

FOLDER = Path(tactsim.__file__).parents[1] / "examples" / "cosine"
sys.path.insert(0, str(FOLDER))
tactsim_cosine = import_module("tactsim_cosine")

FILTERS = {
    "histogram": {"bins": 2000},
    "refined": {"bins": 1000, "cells": 40},
    "particle": {"particles": 2000},
}


@pytest.fixture(scope="module", autouse=True)
def installed():
    """Stand in for the installed package: its entry point, as pyproject.toml names it."""
    from importlib.metadata import EntryPoint

    point = EntryPoint("cosine", "tactsim_cosine:CosineLikelihood", likelihood.GROUP)
    assert 'cosine = "tactsim_cosine:CosineLikelihood"' in (FOLDER / "pyproject.toml").read_text()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plug_ins, "plug_ins", lambda group: (point,) if group == likelihood.GROUP else ())
        yield


def test_it_is_one_file_of_at_most_forty_lines():
    assert len((FOLDER / "tactsim_cosine.py").read_text().splitlines()) <= 40


@pytest.mark.parametrize("check", LIKELIHOOD_CHECKS)
def test_it_keeps_the_contract_of_likelihoods(check):
    check(LikelihoodCase(lambda: tactsim_cosine.CosineLikelihood(tactsim_cosine.CosineOptions())))


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
