import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from independent_coverage import SHOWN, independent
from made_up import make_run
from made_up_space import make_space_run

from tactsim.bench.intervals import wilson
from tactsim.bench.placement import Properties
from tactsim.bench.runs.pooled import figure_of, pool
from tactsim.bench.score import Scored, rank_band, rank_p, settled_at, settled_by, summarise, worst_quarter
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


def of_ranks(ranks, radius):
    """A run of one reading whose trials are all right, with these ranks (n,) and radii (n,)."""
    run = make_run(n=len(ranks), r=1)
    trials = replace(
        run.trials,
        label=run.trials.truth[:, None],
        p_label=np.full((len(run.trials.truth), 1), 0.8),
        p_truth=np.full((len(run.trials.truth), 1), 0.8),
        credibility=np.resize(ranks, (len(run.trials.truth), 1)),
        radius_90=np.resize(radius, (len(run.trials.truth), 1)),
    )
    return replace(run, trials=trials)


def test_an_independent_reading_of_the_folder_gives_the_same(tmp_path):
    rng = np.random.default_rng(3)
    for number, power in enumerate((1.0, 0.4)):
        run = of_ranks(rng.random(60) ** power, rng.random(60))
        summary = json.loads((run.save(tmp_path / str(number)) / "summary.json").read_text())
        for k, wanted in enumerate(independent(tmp_path / str(number))):
            for name, value in wanted.items():
                assert summary[name][k] == pytest.approx(value, rel=1e-6, abs=1e-9), name


def test_it_gives_the_same_of_objects_in_space_and_of_runs_together(tmp_path):
    run = make_space_run(n=40)
    summary = json.loads((run.save(tmp_path / "space") / "summary.json").read_text())
    for k, wanted in enumerate(independent(tmp_path / "space")):
        for name, value in wanted.items():
            assert summary[name][k] == pytest.approx(value, rel=1e-6, abs=1e-9), name
    runs = [replace(make_run(n=20, seed=seed), config=make_run().config | {"seed": seed}) for seed in (0, 1)]
    folders = [run.save(tmp_path / f"seed-{run.seed}") for run in runs]
    (one,) = pool(runs)
    for k, wanted in enumerate(independent(*folders), start=1):
        for name in SHOWN:
            assert figure_of(one, f"{name}@{k}").value == pytest.approx(wanted[name], rel=1e-6), name


def test_the_quarter_that_claims_to_be_surest_is_found():
    ranks = np.where(np.arange(400) < 100, 0.95, 0.5)  # the surest quarter holds the truth nowhere
    scored = of_ranks(ranks, np.arange(400)).scored
    count = len(scored.trials.truth)
    found = worst_quarter(scored, 0)
    assert found.value == 0
    assert found.low == 0
    assert found.high == pytest.approx(float(wilson(0, count // 4, 1 - 0.05 / 4)[1]))
    few = of_ranks([0.5], [1.0]).scored
    silent = replace(few.trials, credibility=few.trials.credibility * np.nan)
    assert worst_quarter(Scored(silent, few.objects), 0).value is None
    assert rank_p(Scored(silent, few.objects), 0) is None


def test_even_ranks_leave_the_band_in_one_case_of_twenty_and_uneven_ones_often():
    rng = np.random.default_rng(4)
    template = of_ranks(np.zeros(20), np.ones(20)).scored
    count, drawn, outside = len(template.trials.truth), 1000, 0
    for _ in range(drawn):
        ranks = np.sort(rng.random(count))
        trials = replace(template.trials, credibility=ranks[:, None])
        p = rank_p(Scored(trials, template.objects), 0)
        steps = np.arange(count + 1) / count
        away = max((steps[1:] - ranks).max(), (ranks - steps[:-1]).max())
        assert (p < 0.05) == (away > rank_band(count))
        outside += p < 0.05
    assert outside / drawn == pytest.approx(0.05, abs=4 * math.sqrt(0.05 * 0.95 / drawn))
    # The truth is far out too often
    narrow = replace(template.trials, credibility=rng.random((count, 1)) ** 0.3)
    assert rank_p(Scored(narrow, template.objects), 0) < 0.01


def test_pooled_runs_have_intervals_over_scans_too():
    rng = np.random.default_rng(5)
    runs = [of_ranks(rng.random(40), rng.random(40)) for _ in range(2)]
    runs = [replace(run, config=run.config | {"seed": seed}) for seed, run in enumerate(runs)]
    (one,) = pool(runs)
    found = figure_of(one, "coverage_90_worst@1")
    assert found.low < found.value < found.high
    assert figure_of(one, "brier@1").value == pytest.approx(0.04)
