"""Runs over several seeds: what is pooled, and whether intervals hold the truth."""

import dataclasses

import numpy as np
import pytest
from made_up import make_run

from tactsim.bench.runs.pooled import Figure, Pooled, cell, in_digits, pool, resampled, share
from tactsim.bench.score import wilson
from tactsim.core import InputError


def with_seed(run, seed, **config):
    return dataclasses.replace(run, config=run.config | {"seed": seed, **config})


def of_labels(right, seed=0):
    """A run whose trials are right as `right` (n, r) says."""
    right = np.asarray(right)
    made = make_run(n=3, r=right.shape[1])
    take = np.zeros(len(right), dtype=int)
    trials = {field.name: getattr(made.trials, field.name)[take] for field in dataclasses.fields(made.trials)}
    trials = dataclasses.replace(made.trials, **trials | {"label": np.where(right, "A", "E")})
    return with_seed(dataclasses.replace(made, trials=trials), seed)


def test_runs_that_differ_in_the_seed_alone_are_pooled():
    runs = [with_seed(make_run(seed=k), k) for k in range(3)]
    other = with_seed(make_run(), 0)
    other.about["budget"] = {"option": "bins", "value": 100}
    first, second = pool([runs[0], other, *runs[1:]])
    assert [run.seed for run in first.runs] == [0, 1, 2]
    assert (first.label, second.label) == ("histogram, 10,000 bins", "histogram, 100 bins")
    assert first.trials.right.tolist() == np.concatenate([run.trials.right for run in runs]).tolist()


def test_runs_of_other_readings_or_trials_are_apart_and_the_same_twice_is_refused():
    run = make_run()
    assert len(pool([run, with_seed(make_run(r=5), 1), with_seed(run, 2, trials=7)])) == 3
    with pytest.raises(InputError, match="histogram is there twice"):
        pool([run, make_run(seed=4)])


def test_a_draw_is_of_whole_runs_and_of_trials_in_them():
    sizes = [10, 30, 20]
    counts = resampled(sizes, np.random.default_rng(1), draws=5000)
    assert counts.shape == (5000, 60)
    of_runs = [part.sum(axis=1) for part in np.split(counts, [10, 40], axis=1)]
    for size, drawn in zip(sizes, of_runs, strict=True):
        assert set((drawn / size).tolist()) <= {0, 1, 2, 3}
    assert (sum(drawn / size for size, drawn in zip(sizes, of_runs, strict=True)) == 3).all()
    assert counts.mean(axis=0) == pytest.approx(
        np.ones(60), abs=0.1
    )  # five standard errors, of var 1 and 2/3
    assert np.array_equal(counts, resampled(sizes, np.random.default_rng(1), draws=5000))


def test_figures_are_those_of_all_trials():
    runs = [of_labels([[1, 1, 1], [0, 1, 1]], 0), of_labels([[0, 0, 1], [0, 1, 0]], 1)]
    (one,) = pool(runs)
    assert one.mean(one.trials.right[:, 1]).value == 0.75
    assert one.settled(0.5).value == 2
    assert one.settled(0.95).value is None
    assert one.settled(0.5).low == 1  # where the first run is drawn twice
    # 2 in the first run alone, never in the second.
    assert dataclasses.astuple(one.all_right_from()) == (None, 2, None)
    assert cell(one, "settled_95") == "later (2-later)"
    assert cell(one, "right@2").startswith("0.750 (")
    assert in_digits(Figure(0.051, 0.0482, 0.0549), 2) == [
        "0.051",
        "0.048",
        "0.055",
    ]  # 2 would end where it begins
    assert in_digits(Figure(1.0, 1.0, 1.0), 2) == ["1.00", "1.00", "1.00"]
    assert in_digits(Figure(0.0, 1e-9, 2e-9), 2) == ["0.00"] * 3
    assert in_digits(Figure(0.0, 1e-6, 2e-6), 2) == ["0.000000", "0.000001", "0.000002"]
    none = one.mean(one.trials.right[:, 0], of=np.zeros(4, dtype=bool))
    assert dataclasses.astuple(none) == (None, None, None)


def test_the_interval_of_a_share_is_never_narrower_than_wilsons():
    held = share(np.ones(40), (20, 20), of=np.arange(40) < 30)  # every draw of the bootstrap says 1
    assert (held.value, held.low, held.high) == (1.0, pytest.approx(float(wilson(30, 30)[0])), 1.0)
    apart = np.repeat([0.0, 1.0], 20)  # here scans differ more than trials do
    assert (share(apart, (20, 20)).low, share(apart, (20, 20)).high) == (0.0, 1.0)


@pytest.mark.parametrize(("spread", "at_least"), [(0.0, 0.95), (0.1, 0.84)])
def test_intervals_hold_the_truth_about_as_often_as_the_documentation_says(spread, at_least):
    # Five scans whose accuracy is 0.8, and differs by `spread` between scans (sd); 50 trials each. The intervals hold
    # 0.8 in 0.986 and 0.919 of 1,500 simulations by other code; the bounds are three standard errors of 120 below that.
    rng = np.random.default_rng(2)
    pooled = Pooled("made up", None, "", "", tuple(of_labels(np.zeros((50, 1)), seed) for seed in range(5)))
    held = 0
    for _ in range(120):
        shares = np.clip(0.8 + spread * rng.normal(size=5), 0, 1)
        right = rng.random((5, 50)) < shares[:, None]
        figure = pooled.mean(right.reshape(-1))
        held += figure.low <= 0.8 <= figure.high
    assert at_least <= held / 120
