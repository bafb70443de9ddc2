import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tactsim.bench.intervals import wilson
from tactsim.bench.placement import Properties
from tactsim.bench.score import Scored, settled_at, settled_by, summarise
from tactsim.bench.trials import Trials
from tactsim.core import compose, invert

PLAIN = Properties(symmetry=1, centre=(0.0, 0.0), inertia_over_mass=60.0)


def make_trials(label, truth="A", pose_error=0.0):
    """Build trials from a table of labels, their estimates off by `pose_error` mm in x."""
    label = np.array(label)
    n, r = label.shape
    true_pose = np.tile([1.0, 2.0, 0.5], (n, r, 1))
    estimated = invert(compose([pose_error, 0.0, 0.0], invert(true_pose)))
    zeros = np.zeros((n, r))
    return Trials(
        truth=np.full(n, truth), known=np.ones(n, dtype=bool), trial=np.arange(n), true_pose=true_pose,
        touch_index=zeros.astype(int), label=label, p_truth=np.full((n, r), 0.5), p_label=np.full((n, r), 0.75),
        pose=estimated, evaluations=zeros.astype(int),
        credibility=zeros, radius_90=zeros, nees=zeros, update_s=zeros, estimate_s=zeros, propose_s=zeros,
    )  # fmt: skip


def test_wilson_interval_has_the_published_values():
    low, high = wilson([0, 5, 10], 10)  # Newcombe 1998, method 3
    assert np.allclose(low, [0, 0.2366, 0.7225], atol=1e-4)
    assert np.allclose(high, [0.2775, 0.7634, 1], atol=1e-4)
    for count in range(1, 200):
        low, high = wilson([0, count], count)
        assert (low[0], high[1]) == (0, 1)


def test_settling_counts_from_the_last_mistake():
    right = np.array([[1, 1, 1, 1], [0, 1, 1, 1], [1, 0, 1, 1], [1, 1, 1, 0]], dtype=bool)
    assert settled_at(right).tolist() == [1, 2, 3, 5]
    assert settled_by(right, 0.25) == 1
    assert settled_by(right, 0.5) == 2
    assert settled_by(right, 0.75) == 3
    assert settled_by(right, 1.0) is None


@given(arrays(bool, st.tuples(st.integers(1, 9), st.integers(1, 7))))
def test_settling_is_what_a_plain_loop_finds(right):
    expected = [
        next((k + 1 for k in range(right.shape[1]) if row[k:].all()), right.shape[1] + 1) for row in right
    ]
    assert settled_at(right).tolist() == expected


def test_the_summary_of_a_small_run_by_hand():
    trials = make_trials([["A", "A"], ["E", "A"], ["E", "E"]], pose_error=2.0)
    summary = summarise(Scored(trials, {"A": PLAIN}))
    assert summary["accuracy"] == pytest.approx([1 / 3, 2 / 3])
    assert summary["error_mm"] == pytest.approx([2.0, 2.0])
    assert summary["error_all_mm"] == pytest.approx([2.0, 2.0])
    assert summary["negative_log_likelihood"] == pytest.approx([math.log(2)] * 2)
    assert summary["calibration_gap"] == pytest.approx([0.75 - 1 / 3, 0.75 - 2 / 3])
    assert summary["all_right_from"] is None
    assert summary["settled_50"] == 2
    assert summary["confusion"] == {"A": {"A": 2, "E": 1}}


def test_the_error_of_no_right_letter_is_none_and_not_a_number():
    summary = summarise(Scored(make_trials([["E", "A"]]), {"A": PLAIN}))
    assert summary["error_mm"] == [None, pytest.approx(0, abs=1e-9)]


def test_held_out_letters_have_refusals_and_no_placement():
    labels = [["A", "none"], ["none", "A"], ["A", "none"], ["none", "none"]]
    trials = replace(make_trials(labels, pose_error=2.0), known=np.array([True, True, False, False]))
    summary = summarise(Scored(trials, {"A": PLAIN}))
    assert summary["accuracy"] == pytest.approx([0.5, 0.75])
    assert summary["refused_known"] == pytest.approx([0.5, 0.5])
    assert summary["refused_unknown"] == pytest.approx([0.5, 1.0])
    assert summary["error_mm"] == pytest.approx([2.0, 2.0])
    moved = replace(trials, pose=trials.pose + np.where(trials.known, 0, 50)[:, None, None])
    for name in ("error_mm", "error_all_mm", "error_standard_error_mm"):
        assert summarise(Scored(moved, {"A": PLAIN}))[name] == summary[name]
    assert summarise(Scored(make_trials(labels), {"A": PLAIN}))["refused_unknown"] == [None, None]


def test_coverage_counts_right_letters_of_estimators_that_say_how_sure_they_are():
    trials = replace(
        make_trials([["A", "A"], ["A", "A"], ["E", "A"]]),
        credibility=np.array([[0.4, 0.95], [0.7, np.nan], [0.1, 0.2]]),
        radius_90=np.array([[1.0, 2.0], [3.0, np.nan], [99.0, 4.0]]),
    )
    summary = summarise(Scored(trials, {"A": PLAIN}))
    assert summary["coverage_50"] == pytest.approx([0.5, 0.5])
    assert summary["coverage_90"] == pytest.approx([1.0, 0.5])
    assert summary["sharpness_mm"] == pytest.approx([2.0, 3.0])
    silent = replace(trials, credibility=trials.credibility * np.nan, radius_90=trials.radius_90 * np.nan)
    assert summarise(Scored(silent, {"A": PLAIN}))["coverage_90"] == [None, None]
    assert summarise(Scored(silent, {"A": PLAIN}))["sharpness_mm"] == [None, None]
