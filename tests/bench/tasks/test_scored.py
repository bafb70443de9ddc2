"""Figures of a task: their values from trials, and which value is better."""

import math

import numpy as np
import pytest
from made_up import make_run

from tactsim.bench.score import CURVES, HEADLINES
from tactsim.bench.tasks import scored

METRICS = sorted(scored._BADNESS)


@pytest.mark.parametrize("metric", METRICS)
def test_a_figure_is_what_the_summary_of_a_run_says(metric):
    run = make_run(n=3, r=4, seed=1)
    for figure in [f"{metric}@2", f"{metric}@4"] if metric in CURVES else [metric]:
        stated = run.summary[metric]
        stated = stated[int(figure[-1]) - 1] if "@" in figure else stated
        assert scored.value_of(figure, run.trials, run.objects) == stated


def test_a_figure_of_no_trials_is_none_and_the_worst():
    run = make_run(n=3, r=4)
    assert scored.value_of("refused_unknown@4", run.trials, run.objects) is None
    assert scored.badness("refused_unknown@4", None) == math.inf


@pytest.mark.parametrize(
    ("figure", "best_first"),
    [
        ("accuracy@5", [1.0, 0.9, 0.0, None]),
        ("refused_unknown@5", [1.0, 0.9, 0.0]),
        ("refused_known@5", [0.0, 0.1, 1.0]),
        ("error_mm@20", [0.1, 2.0, None]),
        ("error_all_mm@20", [0.1, 2.0]),
        ("settled_95", [2, 9, None]),
        ("all_right_from", [2, 9, None]),
        ("coverage_90@20", [0.91, 0.85, 1.0, 0.5]),
        ("coverage_50@20", [0.51, 0.4, 1.0]),
        ("calibration_gap@20", [0.0, -0.01, 0.02, -0.5]),
        ("recovered_within_3", [1.0, 0.2]),
    ],
)
def test_values_are_sorted_from_the_best_to_the_worst(figure, best_first):
    rng = np.random.default_rng(0)
    shuffled = [best_first[place] for place in rng.permutation(len(best_first))]
    assert sorted(shuffled, key=lambda value: scored.badness(figure, value)) == best_first


def test_whatever_ranks_is_a_metric():
    assert set(METRICS) <= set(CURVES | HEADLINES)
