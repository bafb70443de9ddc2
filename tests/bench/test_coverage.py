"""How sure a run is and may be: coverage by quarter, ranks of the truth, scores of probabilities.

`independent` reads folders of runs with NumPy alone, in the plane or in space, and computes the same by other means:
`python tests/bench/test_coverage.py RUN...` prints what docs/method.md shows of their trials together.
"""

import csv
import json
import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_up import make_run
from made_up_space import make_space_run

from tactsim.bench.intervals import wilson
from tactsim.bench.runs.pooled import figure_of, pool
from tactsim.bench.score import Scored, rank_band, rank_p, worst_quarter

SHOWN = "coverage_90", "coverage_90_worst", "rank_p", "sharpness_mm", "nees"
SURE = 2.497705474412  # standard normal quantile of a two-sided interval of 98.75 %, from a table


def independent(*folders):
    """Compute the figures of runs' folders, pooled, by reading: a list of dicts."""
    rows = []
    for folder in folders:
        with (folder / "trials.csv").open(newline="") as file:
            rows += csv.DictReader(file)
    found = []
    number = next(name for name in rows[0] if name.endswith("_number"))
    for k in sorted({int(row[number]) for row in rows}):
        at = [row for row in rows if int(row[number]) == k]
        right = np.array([row["label"] == row["truth"] for row in at])
        p, p_truth, rank, radius, nees = (
            np.array([float(row[name]) for row in at])
            for name in ("p_label", "p_truth", "credibility", "radius_90", "nees")
        )
        sure = right & ~np.isnan(rank)
        rank, radius, nees = rank[sure], radius[sure], nees[sure & ~np.isnan(nees)]
        n = len(rank)
        quarters = [rank[part] < 0.9 for part in np.array_split(np.argsort(radius, kind="stable"), 4)]
        ends = [interval(part.sum(), len(part)) for part in quarters] if n >= 4 else [(None, None)]
        ordered = sorted(rank.tolist())
        away = max((max(abs(r - i / n), abs(r - (i + 1) / n)) for i, r in enumerate(ordered)), default=None)
        away = away and away * (math.sqrt(n) + 0.12 + 0.11 / math.sqrt(n))
        # The other series of the same function, by a theta identity; it converges where the first does not.
        p_value = away and 1 - math.sqrt(2 * math.pi) / away * sum(
            math.exp(-((2 * j - 1) ** 2) * math.pi**2 / (8 * away**2)) for j in range(1, 200)
        )
        found.append(
            {
                "brier": float(np.mean((p - right) ** 2)),
                "negative_log_likelihood": float(np.mean(-np.log(p_truth))),
                "coverage_90": float(np.mean(rank < 0.9)) if n else None,
                "sharpness_mm": float(np.mean(radius)) if n else None,
                "nees": float(np.mean(nees)) if len(nees) else None,
                "coverage_90_worst": float(min(part.mean() for part in quarters)) if n >= 4 else None,
                "coverage_90_worst_low": min(low for low, _ in ends),
                "coverage_90_worst_high": min(high for _, high in ends),
                "rank_p": p_value,
            }
        )
    return found


def interval(successes, n):
    """Wilson's interval by its definition: all p with |share - p| <= z sqrt(p (1 - p) / n)."""
    a, b, c = 1 + SURE**2 / n, -(2 * successes / n + SURE**2 / n), (successes / n) ** 2
    root = math.sqrt(max(0.0, b * b - 4 * a * c))
    return (-b - root) / (2 * a), (-b + root) / (2 * a)


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


if __name__ == "__main__":
    for reading, row in enumerate(independent(*map(Path, sys.argv[1:])), start=1):
        print(reading, *(f"{name} {row[name]:.3f}" for name in SHOWN))
