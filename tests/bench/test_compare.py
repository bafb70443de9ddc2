from dataclasses import replace

import numpy as np
import pytest
from made_up import make_run

from tactsim.bench.compare import compare, paired, paired_interval
from tactsim.bench.intervals import FEWEST_PAIRS
from tactsim.core import InputError
from tactsim.estimators import NONE


def run_with(right_share, error, seed, n=300, r=6):
    """Make a run whose trials are right with a probability and off by about `error` mm."""
    rng = np.random.default_rng(seed)
    base = make_run()
    trials = base.trials
    right = rng.random((n, r)) < right_share
    true_pose = np.tile([1.0, 2.0, 0.0], (n, r, 1))
    pose = true_pose.copy()
    pose[..., 0] += error * rng.uniform(0.5, 1.5, size=(n, r))
    many = {name: np.zeros((n, r)) for name in ("p_truth", "p_label", "update_s", "estimate_s", "propose_s")}
    trials = replace(
        trials, truth=np.full(n, "A"), known=np.ones(n, dtype=bool), trial=np.arange(n), true_pose=true_pose, pose=pose,
        label=np.where(right, "A", "E"), touch_index=np.zeros((n, r), int), evaluations=np.zeros((n, r), int), **many,
    )  # fmt: skip
    return replace(base, trials=trials, about={"protocol": "same"})


def verdicts(base, new):
    return [row.verdict for row in compare(base, new) if row.verdict]


def test_a_run_is_the_same_as_itself():
    run = run_with(0.9, 1.0, seed=0)
    assert verdicts(run, run) == ["not told apart"] * 2


@pytest.mark.long
def test_equal_quality_by_other_chance_is_no_alarm():
    alarms = [verdicts(run_with(0.9, 1.0, seed), run_with(0.9, 1.0, seed + 100)) for seed in range(20)]
    assert sum("worse" in verdict for verdict in alarms) <= 3  # 2.5 % a figure, two sides, two figures


def test_worse_accuracy_and_worse_error_are_both_seen():
    base = run_with(0.9, 1.0, seed=0)
    assert verdicts(base, run_with(0.8, 1.0, seed=1)) == ["worse", "not told apart"]
    assert verdicts(base, run_with(0.9, 1.1, seed=1)) == ["not told apart", "worse"]
    assert verdicts(base, run_with(0.97, 0.8, seed=1)) == ["better", "better"]


def test_the_placement_of_what_is_rightly_refused_is_not_compared():
    base, new = run_with(0.9, 1.0, seed=0), run_with(0.9, 1.0, seed=1)
    held_out = np.arange(len(base.trials.truth)) % 3 == 0

    def refusing(run, away):
        trials = run.trials
        moved = trials.pose + np.where(held_out, away, 0)[:, None, None]
        label = np.where(held_out[:, None], NONE, trials.label)
        return replace(run, trials=replace(trials, known=~held_out, label=label, pose=moved))

    near, far = (
        {row.name: row for row in compare(refusing(base, 0), refusing(new, away))} for away in (0, 50)
    )
    assert far["error after 6, mm, both right"] == near["error after 6, mm, both right"]


def test_errors_that_nobody_knows_are_not_called_the_same():
    run = run_with(0.9, 1.0, seed=0)
    nowhere = {name: replace(of, placed=False) for name, of in run.objects.items()}
    rows = compare(replace(run, objects=nowhere), replace(run, objects=nowhere))
    assert [row.name for row in rows if row.verdict] == ["share of readings right"]
    assert not any(np.isnan(row.base) for row in rows if row.base is not None)


def test_the_time_of_a_reading_holds_its_choice():
    base = run_with(0.9, 1.0, seed=0)
    spent = {name: np.full((300, 6), 0.001) for name in ("update_s", "estimate_s", "propose_s")}
    times = compare(base, replace(base, trials=replace(base.trials, **spent)))[-1]
    assert (times.name, times.base, times.new) == ("ms a reading", 0, pytest.approx(3))


def test_the_bootstrap_interval_is_near_the_normal_one_for_many_pairs():
    difference = np.random.default_rng(1).normal(0.3, 2.0, size=2000)
    low, high = paired_interval(difference, np.random.default_rng(0), 0.95)
    half = 1.96 * difference.std() / np.sqrt(2000)
    assert low == pytest.approx(difference.mean() - half, abs=0.1 * half)
    assert high == pytest.approx(difference.mean() + half, abs=0.1 * half)


@pytest.mark.parametrize("count", [1, 6, 7, 29])
@pytest.mark.parametrize("draw", ["normal", "laplace"])
def test_few_equal_pairs_are_called_different_no_more_often_than_stated(count, draw):
    rng = np.random.default_rng(count)
    differences = getattr(rng, draw)(size=(4000, count))
    found = [paired_interval(difference, rng, 0.975) for difference in differences]
    beyond = np.mean([low > 0 or high < 0 for low, high in found])
    assert beyond <= 0.025 + 3 * np.sqrt(0.025 * 0.975 / 4000)
    assert (beyond == 0) == (count < FEWEST_PAIRS)
    # All worse, and nobody knows below seven
    few = paired("", np.zeros(count), 10 + rng.random(count), rng, -1)
    assert few.verdict == ("too few" if count < FEWEST_PAIRS else "worse")


def test_runs_of_other_trials_or_protocols_are_not_compared():
    base = run_with(0.9, 1.0, seed=0)
    with pytest.raises(InputError, match="protocols"):
        compare(base, replace(base, about={"protocol": "chosen"}))
    moved = replace(base.trials, true_pose=base.trials.true_pose + 1)
    with pytest.raises(InputError, match="same trials"):
        compare(base, replace(base, trials=moved))
    slipped = base.trials.true_pose + np.arange(6)[:, None]
    with pytest.raises(InputError, match="move"):
        compare(base, replace(base, trials=replace(base.trials, true_pose=slipped)))
    with pytest.raises(InputError, match="readings"):
        compare(base, run_with(0.9, 1.0, seed=0, r=5))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {"seed": 1, "shapes": ["a.stl"], "scan": "a.npz"},
            "same trials; give both the same --shape, --seed, --scan",
        ),
        ({"scan_set": {"pad": {"seam": 3.0}}}, "same trials; give both the same --scan-set pad.seam"),
        ({"estimator": "particle", "bins": 5}, "same trials; their options are the same"),
    ],
)
def test_every_option_is_named_that_makes_the_trials_others(changes, said):
    base = run_with(0.9, 1.0, seed=0)
    moved = replace(base.trials, true_pose=base.trials.true_pose + 1)
    with pytest.raises(InputError) as refused:
        compare(base, replace(base, trials=moved, config=base.config | changes))
    assert said in str(refused.value)


def test_letters_count_as_they_were_tried():
    base = run_with(0.9, 1.0, seed=0)
    tried = [{"protocol": "same", "letters": list(letters)} for letters in ("AE", "AEI")]
    moved = replace(base.trials, true_pose=base.trials.true_pose + 1)
    for letters, said in ((tried[0], "options are the same"), (tried[1], "the same --letters")):
        new = replace(base, trials=moved, config=base.config | {"letters": ["A", "E"]}, about=letters)
        with pytest.raises(InputError, match=said):
            compare(replace(base, about=tried[0]), new)
