"""Occupancy in space against the paper's equations for one taxel, and against the solids it was learned from."""

import numpy as np
import pytest
import toy_solids as toy

from tactsim.core import InputError, rigid
from tactsim.core.space_scan import SpaceScan
from tactsim.estimators.likelihoods.occupancy import log_odds
from tactsim.estimators.space.space_occupancy import learn_occupancy

PEAK, PRIOR, STIFFNESS = 0.9, 0.2, 50.0


def touch_of(pressure, pose=rigid.IDENTITY):
    """Make a scan of one touch by one taxel."""
    return SpaceScan(
        readings=np.array([[pressure]]), poses=pose[None], labels=np.array(["thing"]), split=np.array(["train"]),
        taxel_points=np.zeros((1, 3)), taxel_normals=np.array([[0.0, 0.0, 1.0]]), touch=np.zeros(1),
        meta={"stroke": 30.0},
    )  # fmt: skip


def test_a_taxel_in_contact_occupies_where_it_met_the_surface_and_frees_its_way():
    pose = np.concatenate([[3.0, -2.0, 5.0], rigid.from_vector([0.3, 1.0, -0.4])])
    chart = learn_occupancy(touch_of(50.0, pose), stiffness=STIFFNESS, cell=0.25)["thing"]
    at = lambda x, z: chart.log_odds_at(rigid.transform(pose, np.array([[x, 0.0, z]])))[0]  # noqa: E731
    peak = np.log((PRIOR + (1 - PRIOR) * PEAK) / (PRIOR * (1 - PEAK)))
    free = np.log((1 - PRIOR) * (1 - PEAK) / (1 - PRIOR + PRIOR * PEAK))
    assert at(0, -1.0) == pytest.approx(log_odds(PRIOR) + peak, abs=0.4)  # 50 kPa: 1 mm into the layer
    g = PEAK * np.exp(-2 * 0.5**2)
    there = np.log((PRIOR + (1 - PRIOR) * g) / (PRIOR * (1 - g)))
    assert at(0.5, -1.0) == pytest.approx(log_odds(PRIOR) + there, abs=0.2)
    assert at(0, -6.0) == pytest.approx(log_odds(PRIOR) + free, abs=0.4)
    assert at(0, 4.0) == pytest.approx(log_odds(PRIOR), abs=1e-3)
    assert at(4.0, -6.0) == pytest.approx(log_odds(PRIOR), abs=1e-3)


def test_a_taxel_without_contact_frees_its_way_up_to_the_pad():
    chart = learn_occupancy(touch_of(0.0), stiffness=STIFFNESS, cell=0.25)["thing"]
    free = np.log((1 - PRIOR) * (1 - PEAK) / (1 - PRIOR + PRIOR * PEAK))
    along = chart.log_odds_at(np.column_stack([np.zeros((3, 2)), [-4.0, 0.0, 3.0]]))
    np.testing.assert_allclose(along, log_odds(PRIOR) + np.array([free, free, 0.0]), atol=0.4)


def test_what_is_occupied_is_the_solids_surface():
    scan = toy.toy_scan(150, 3, ("ball",))
    chart = learn_occupancy(scan, stiffness=toy.STIFFNESS)["ball"]
    away = toy.SOLIDS["ball"].distance(chart.occupied())
    assert len(away) > 1000
    assert np.abs(away).max() < 3.0
    outside = chart.log_odds_at(toy.SOLIDS["ball"].surface(200, np.random.default_rng(0))[0] * (17.0 / 13.0))
    assert (outside < log_odds(PRIOR)).mean() > 0.9


def test_a_scan_without_training_touches_is_refused():
    scan = toy.toy_scan(20, 3, ("ball",)).where("test")
    with pytest.raises(InputError, match="no touches with split 'train'"):
        learn_occupancy(scan, stiffness=STIFFNESS)
