"""Several measurement models together: what they say is added up, with and without what is left out."""

import numpy as np
import pytest
from synthetic import make_scan, paper_poses

from tactsim.estimators.field.table_field import TableField
from tactsim.estimators.likelihoods.force import ForceLikelihood
from tactsim.estimators.likelihoods.graded import GradedLikelihood
from tactsim.estimators.likelihoods.occupancy import learn_maps
from tactsim.estimators.likelihoods.stacked import StackedLikelihood
from tactsim.estimators.options import LikelihoodOptions

OPTIONS = LikelihoodOptions(cell=0.8)


@pytest.fixture(scope="module")
def scan():
    return make_scan("EL", poses=paper_poses(4, 12))


@pytest.fixture(scope="module")
def models(scan):
    maps = learn_maps(scan, cell=0.8)
    fitted = [kind(OPTIONS) for kind in (StackedLikelihood, GradedLikelihood, ForceLikelihood)]
    for model in fitted:
        model.fit(scan, maps)
    return fitted


def said(model, scan, taxels=slice(None)):
    """Say what a model holds of two touches at 40 states of both letters."""
    field = TableField(model, ("E", "L"), scan.taxel_xy, (0.8, 0.8), 0.8)
    states = np.random.default_rng(0).uniform(-4, 4, (3, 40))
    train = scan.where("train")
    for touch in (3, 70):
        field.add(model.evidence(train.readings[touch]), np.array(train.poses[touch]))
    return np.concatenate([field.log_p(letter, states) for letter in (0, 1)])


def test_it_says_the_sum_of_what_its_models_say(models, scan):
    together, *alone = (said(model, scan) for model in models)
    assert together == pytest.approx(sum(alone), abs=0.02)  # tables are rounded to steps of their own


@pytest.mark.parametrize("whole_positions", [False, True])
def test_what_is_left_out_is_left_out_of_all_its_models(models, scan, whole_positions):
    train = scan.where("train")
    gone = np.random.default_rng(1).random(len(train)) < 0.3
    together, *alone = (
        said(model.without(train, gone, ("E", "L"), whole_positions), scan) for model in models
    )
    assert together == pytest.approx(sum(alone), abs=0.02)
    assert np.abs(together - said(models[0], scan)).max() > 1


def test_it_cannot_leave_out_what_one_of_its_models_cannot(models, scan, monkeypatch):
    train = scan.where("train")
    monkeypatch.setattr(ForceLikelihood, "without", lambda *arguments: None)
    assert models[0].without(train, np.zeros(len(train), bool), ("E", "L"), False) is None
