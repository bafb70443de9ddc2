"""How sure a run is and may be: coverage by quarter, ranks of the truth, scores of probabilities."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from independent_coverage import SHOWN, independent
from made_up import make_run
from made_up_space import make_space_run

from tactsim.bench.intervals import wilson
from tactsim.bench.runs.pooled import figure_of, pool
from tactsim.bench.score import Scored, rank_band, rank_p, worst_quarter


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
    narrow = replace(
        template.trials, credibility=rng.random((count, 1)) ** 0.3
    )  # the truth is far out too often
    assert rank_p(Scored(narrow, template.objects), 0) < 0.01


def test_pooled_runs_have_intervals_over_scans_too():
    rng = np.random.default_rng(5)
    runs = [of_ranks(rng.random(40), rng.random(40)) for _ in range(2)]
    runs = [replace(run, config=run.config | {"seed": seed}) for seed, run in enumerate(runs)]
    (one,) = pool(runs)
    found = figure_of(one, "coverage_90_worst@1")
    assert found.low < found.value < found.high
    assert figure_of(one, "brier@1").value == pytest.approx(0.04)
