"""What holds for every measurement model that is listed in `BUILT_IN`."""

import numpy as np
import pytest
from synthetic import make_scan, model_of, paper_poses

from tactsim.core import transform
from tactsim.estimators.likelihoods.likelihood import BUILT_IN

every_model = pytest.mark.parametrize("name", BUILT_IN)


@pytest.fixture(scope="module")
def scan():
    return make_scan("EIL", poses=paper_poses(4, 6))


@every_model
def test_tables_are_finite_and_constant_beyond_the_extent(name, scan):
    model = model_of(name, scan)
    low, high = model.extent
    xy = np.random.default_rng(0).uniform(low - 5, high + 5, (200, 2))
    for label in scan.letters:
        tables = model.log_tables(label, xy)
        assert tables.shape[1] == 200
        assert np.isfinite(tables).all()
        beyond = model.log_tables(label, np.array([high + 10, low - 10, high + 1e6]))
        assert np.allclose(beyond, beyond[:, :1])


@every_model
def test_evidence_names_tables_and_taxels_that_exist(name, scan):
    model = model_of(name, scan)
    tables = len(model.log_tables("E", np.zeros(2)))
    for reading in (*scan.readings[:20], np.zeros(36), np.full(36, 1e4), -np.ones(36)):
        model.evidence(reading).check(tables, 36)


@every_model
def test_the_true_place_says_more_than_others(name, scan):
    model, test = model_of(name, scan), scan.where("test", "E")
    shifts = np.array([[0, 0, 0], [5, 0, 0], [0, 5, 0], [-5, 0, 0], [0, -5, 0]])
    ahead = []
    for reading, pose in zip(test.readings[:30], test.poses[:30], strict=True):
        terms = model.evidence(reading)
        log_p = []
        for xy in transform(pose + shifts, scan.taxel_xy):
            tables = model.log_tables("E", xy[terms.taxel])
            log_p.append(terms.weight @ tables[terms.table, np.arange(len(terms.table))])
        ahead.append(log_p[0] > np.mean(log_p[1:]))
    assert np.mean(ahead) > 0.8
