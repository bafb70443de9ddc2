"""The share of (task, target) pairs solved, against loops over what a bundle says of each trial."""

import numpy as np
import pytest
from entered import entered

from tactsim.bench.leaderboard.bundle import write_bundle
from tactsim.bench.leaderboard.solved import TARGETS, first_reached, solved
from tactsim.bench.leaderboard.standings import read_folder


@pytest.fixture(scope="module")
def standings(tmp_path_factory):
    """Two methods on one task, one of them on another, too."""
    place = tmp_path_factory.mktemp("bundles")
    for number, (method, task, words) in enumerate(
        [
            ("good", "active-v1", {"skill": 2.5, "mm": 0.1}),
            ("fair", "active-v1", {"mm": 1.0}),
            ("fair", "open-set-v1", {"mm": 1.0}),
        ]
    ):
        write_bundle(entered(method, task, **words), place / f"{number}.zip")
    return read_folder(place).standings


def test_a_target_is_reached_at_the_first_reading_that_is_right_and_near_enough(standings):
    for of in standings:
        for one in of.ranked:
            trials, errors = one.pooled.trials, one.pooled.errors
            readings, ms = first_reached(one)
            for trial in range(0, len(trials.truth), 29):
                for number, target in enumerate(TARGETS):
                    first, spent = np.inf, 0.0
                    for k in range(trials.right.shape[1]):
                        spent += 1e3 * trials.seconds[trial, k]
                        near = not trials.known[trial] or errors[trial, k] <= target
                        if trials.right[trial, k] and near:
                            first = k + 1
                            break
                    assert readings[trial, number] == first
                    assert ms[trial, number] == pytest.approx(spent if first < np.inf else np.inf)


def test_tasks_weigh_alike_and_what_was_not_entered_is_not_solved(standings):
    by_label = {one.label: one for one in solved(standings)}
    fair, good = by_label["fair"], by_label["good"]
    assert (fair.tasks, good.tasks) == (2, 1)
    assert fair.weights.sum() == pytest.approx(1)
    assert good.weights.sum() == pytest.approx(1 / 2)
    shares = [
        np.isfinite(first_reached(one)[0]).mean()
        for of in standings
        for one in of.ranked
        if one.label == "fair"
    ]
    assert fair.share("readings", 1e9) == pytest.approx(np.mean(shares))
    assert fair.share("readings", 3) <= fair.share("readings", 4)
    assert fair.share("ms", 0.0) == 0
