"""Every estimator does without taxels that are masked: dead, stuck or always loaded ones."""

import numpy as np
import pytest
from synthetic import CHEAPER, fitted, make_scan, paper_poses

from tactsim import estimators
from tactsim.core import InputError, Scan
from tactsim.estimators.registry import load


@pytest.fixture(scope="module")
def whole():
    return make_scan("EIL", poses=paper_poses(positions=4, angles=6))


PLANE = [name for name in estimators.names() if not load(name).in_space]


@pytest.mark.parametrize("name", PLANE)
def test_taxels_that_are_masked_are_done_without(name, whole):
    kept = np.setdiff1d(np.arange(len(whole.taxel_xy)), [0, 7, 8, 20])
    masked = Scan(
        whole.readings[:, kept], whole.poses, whole.labels, whole.split, whole.taxel_xy[kept], whole.meta
    ).of_letters("EI")
    estimator = fitted(name, masked, **CHEAPER.get(name, {}))
    felt = masked.where("test", "I")
    estimator.reset(np.random.default_rng(0))
    for row in np.flatnonzero(felt.readings.max(axis=1) > 10)[:3]:
        estimator.update(felt.readings[row], felt.poses[row])
    estimate = estimator.estimate()
    assert sum(estimate.probabilities.values()) == pytest.approx(1)
    assert np.isfinite(estimate.robot_in_object).all()
    with pytest.raises(InputError, match="taxels"):
        estimator.update(whole.readings[0], whole.poses[0])
