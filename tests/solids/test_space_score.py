"""Metrics of runs in space, worked out the slow way."""

import numpy as np
import pytest
from made_up_space import make_space_run, make_space_trials

from tactsim.bench.score import Scored, summarise
from tactsim.core import rigid
from tactsim.solids.score import angle


@pytest.fixture(scope="module")
def run():
    return make_space_run(n=40, r=3)


def test_errors_are_mean_distances_of_surface_points_and_angles(run):
    trials, scored = run.trials, Scored(run.trials, run.objects)
    for i in range(40):
        for k in range(3):
            points = run.objects[trials.truth[i]].points
            at, other = (
                rigid.transform(rigid.invert(pose), points)
                for pose in (trials.pose[i, k], trials.true_pose[i, k])
            )
            assert scored.error[i, k] == pytest.approx(np.linalg.norm(at - other, axis=1).mean(), abs=1e-9)
            assert angle(scored)[i, k] == pytest.approx(
                np.degrees(rigid.angle_between(trials.pose[i, k, 3:], trials.true_pose[i, k, 3:]))
            )


def test_a_run_that_is_never_right_has_no_error(run):
    trials = make_space_trials(6, 3)
    trials.label[:] = np.where(trials.truth == "wedge", "block", "wedge")[:, None]
    summary = summarise(Scored(trials, run.objects))
    assert summary["error_mm"] == summary["angle_deg"] == summary["error_low_mm"] == [None] * 3
    assert summary["accuracy"] == [0.0] * 3
    assert summary["settled_95"] is None
    assert summary["confusion"] == {"wedge": {"block": 3}, "block": {"wedge": 3}}
