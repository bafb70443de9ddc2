import numpy as np
import pytest

from tactsim.estimators.likelihoods.classifier import CONTACT, NO_CONTACT, UNKNOWN
from tactsim.estimators.likelihoods.likelihood import Evidence, covered
from tactsim.estimators.likelihoods.occupancy import OccupancyMap


def evidence(table=(0, 1, 1), taxel=(0, 35, 7), weight=(1.0, 0.0, 2.5)):
    return Evidence(
        np.array(table, dtype=int), np.array(taxel, dtype=int), np.array(weight, dtype=np.float32)
    )


def test_terms_that_exist_pass():
    evidence().check(tables=2, taxels=36)
    evidence([], [], []).check(tables=2, taxels=36)


@pytest.mark.parametrize("change", [{"table": (0, 2, 1)}, {"table": (0, -1, 1)}, {"table": (-1, 2, 0)}])
def test_a_table_that_does_not_exist_is_named(change):
    with pytest.raises(ValueError, match="table that does not exist, of 2"):
        evidence(**change).check(tables=2, taxels=36)


@pytest.mark.parametrize("taxel", [36, -1])
def test_a_taxel_that_does_not_exist_is_named(taxel):
    with pytest.raises(ValueError, match="taxel that does not exist, of 36"):
        evidence(taxel=(0, taxel, 3)).check(tables=2, taxels=36)


@pytest.mark.parametrize("weight", [-0.1, np.nan, np.inf])
def test_a_weight_that_is_negative_or_not_finite_is_refused(weight):
    with pytest.raises(ValueError, match="weight"):
        evidence(weight=(1.0, weight, 1.0)).check(tables=2, taxels=36)


@pytest.mark.parametrize("with_unknown", [True, False])
def test_classes_are_terms_of_weight_1(with_unknown):
    classes = np.array([UNKNOWN, CONTACT, NO_CONTACT, UNKNOWN, CONTACT], dtype=np.int8)
    terms = Evidence.of_classes(classes, with_unknown)
    taxels = [0, 1, 2, 3, 4] if with_unknown else [1, 2, 4]
    assert terms.taxel.tolist() == taxels
    assert terms.table.tolist() == classes[taxels].tolist()
    assert terms.weight.tolist() == [1.0] * len(taxels)


def test_what_maps_cover_reaches_a_cell_around_the_outermost_of_them():
    maps = {
        "A": OccupancyMap(np.array([-3.0, 1.0]), 0.5, np.zeros((4, 7)), 0.2),
        "B": OccupancyMap(np.array([-1.0, -2.0]), 0.5, np.zeros((2, 20)), 0.2),
    }
    low, high = covered(maps)
    assert low.tolist() == [-3.5, -2.5]
    assert high.tolist() == [9.0, 3.0]  # columns to the right of B's last, rows above A's last
    for chart in maps.values():
        for corner in (low, high):
            assert chart.log_odds_at(corner) == pytest.approx(np.log(0.2 / 0.8))
