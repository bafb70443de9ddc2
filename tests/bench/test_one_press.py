"""Trials of presses whose poses nobody knows: each takes its touches from one, far from the robot."""

import re
from dataclasses import replace

import numpy as np
import pytest
from test_trials import Witness

import tactsim
from tactsim.bench.placement import properties
from tactsim.bench.report.picture import plots
from tactsim.bench.runs.pooled import collect, figure_of, pool
from tactsim.bench.runs.saved import load
from tactsim.bench.terminal import print_run
from tactsim.bench.trials import OneTrial, TrialRules, check_readings, run_trial
from tactsim.core import InputError, Scan, compose, invert
from tactsim.estimators import Estimate, Options

PRESSES, WINDOWS = 4, 6


def windows(letters="AB"):
    """Windows of presses: taxel 0 says the press, taxel 1 the window; the last press has fewer windows."""
    rng = np.random.default_rng(0)
    rows = [
        (letter, split, press, window)
        for letter in letters
        for split in ("train", "test")
        for press in range(PRESSES)
        for window in range(WINDOWS if press < PRESSES - 1 else 2)
    ]
    label, split, press, window = (np.array(column) for column in zip(*rows, strict=True))
    return Scan(
        np.column_stack([press, window]).astype(float), rng.normal(0, 8, (len(rows), 3)), label, split,
        np.array([[0.0, 0.0], [2.0, 0.0]]), {"poses": "unknown"},
        presses=press + 10 * (split == "test") + 20 * (label == "B"),
    )  # fmt: skip


class Heard(Witness):
    def estimate(self):
        return Estimate("A", {"A": 1.0}, np.zeros(3))


def test_a_trial_takes_one_press_and_presses_take_turns():
    scan = windows()
    run = tactsim.run(scan=scan, estimator=Heard(Options()), trials=PRESSES, readings=5)
    every = scan.where("test", "B")
    plan, taken = run.plan, []
    for task in (OneTrial("B", trial) for trial in range(PRESSES)):
        estimator = Heard(Options())
        run_trial(
            estimator, plan.test_readings(task), task, TrialRules(5, 0), letters="AB",
            of=properties(scan)["B"],
        )  # fmt: skip
        pressed = {int(reading[0]) for reading, _ in estimator.seen}
        assert len(pressed) == 1
        taken += pressed
        # What is true of the touches is how they lie to the first, and no more.
        own = every.chosen(every.readings[:, 0] == taken[-1])
        poses = np.array([own.poses[own.readings[:, 1] == reading[1]][0] for reading, _ in estimator.seen])
        told = np.array([pose for _, pose in estimator.seen])
        apart, expected = compose(invert(told[0]), told), compose(invert(poses[0]), poses)
        assert np.allclose(apart[:, :2], expected[:, :2], rtol=0, atol=1e-6)
        assert np.hypot(*told[0, :2]) > 100
    assert sorted(taken[:3]) == [0, 1, 2]  # the fourth press has too few windows
    assert taken[3] == taken[0]


def test_nobody_knows_the_placement_error():
    run = tactsim.run(scan=windows(), estimator=Heard(Options()), trials=2, readings=3)
    assert np.isnan(run.trials.credibility).all()
    assert run.summary["error_mm"] == [None] * 3
    assert run.summary["error_all_mm"] == [None] * 3
    assert run.summary["accuracy"] == [0.5] * 3
    assert "one press" in run.about["protocol"]


def test_more_readings_than_a_press_has_are_refused():
    with pytest.raises(InputError, match="no test press of 'A' has more than 6"):
        check_readings(windows(), "A", 7)
    alone = replace(windows(), presses=None)
    with pytest.raises(InputError, match="has more than 1;"):
        check_readings(alone, "A", 2)


def test_a_run_with_unknown_poses_is_read_again(tmp_path):
    run = tactsim.run(scan=windows(), estimator="nearest", trials=2, readings=3)
    run.save(tmp_path / "run")
    again = tactsim.Run.load(tmp_path / "run")
    assert again.summary == run.summary
    assert not again.objects["A"].placed


def test_runs_with_unknown_poses_are_pooled_without_a_placement_error():
    runs = [
        tactsim.run(scan=windows(), estimator="nearest", trials=2, readings=3, seed=seed) for seed in (0, 1)
    ]
    (pooled,) = pool(runs)
    assert figure_of(pooled, f"error_mm@{pooled.readings}").value is None


def test_all_trials_take_every_press_with_enough_readings_once(tmp_path):
    """Every press but the last has six windows: with five a trial there are three trials of each letter."""
    run = tactsim.run(scan=windows(), estimator=Heard(Options()), trials="all", readings=5)
    taken = [run.plan.test_readings(OneTrial("A", trial)).readings[0, 0] for trial in range(PRESSES - 1)]
    assert (len(run.trials.truth), sorted(taken)) == (2 * (PRESSES - 1), list(range(PRESSES - 1)))
    again = load(run.save(tmp_path / "run"))
    np.testing.assert_array_equal(again.trials.label, run.trials.label)
    known = replace(windows(), meta={})
    with pytest.raises(InputError, match=r"poses nobody noted; .*--poses none"):
        tactsim.run(scan=known, estimator=Heard(Options()), trials="all", readings=5)
    with pytest.raises(InputError, match="name it with --scan"):
        tactsim.run(letters="A", trials="all")
    with pytest.raises(InputError, match="a number of at least 1, or all, got 'x'"):
        tactsim.run(letters="A", trials="x")


def test_a_curve_of_one_reading_is_a_mark_and_what_is_not_placed_has_no_panel(tmp_path):
    run = tactsim.run(scan=windows(), estimator=Heard(Options()), trials=2, readings=1)
    (axes,) = run.plot().axes
    assert axes.lines[0].get_marker() == "o"
    assert np.array(axes.collections[0].get_segments()).shape == (1, 2, 2)
    (group,) = collect([(tmp_path, run)])
    assert "one-error" not in plots(group, "one")


def grasps():
    """The windows as grasps: no reading lies elsewhere than another."""
    scan = windows()
    return replace(scan, poses=np.zeros_like(scan.poses))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"slip": {"walk_mm": 0.5}}, "slip: poses are unknown"),
        ({"explore": "information", "estimator": "refined"}, "explore information: poses are unknown"),
        ({"trials": "all", "explore": "information"}, "leave out explore"),
        ({"readings": 7}, "ask for at most 6 (--readings 6)"),
        ({"set": {"unknown": 0.5}}, "leave unknown out"),
    ],
)
def test_what_needs_poses_is_refused_where_nobody_knows_them(words, said):
    with pytest.raises(InputError, match=re.escape(said)):
        tactsim.run(scan=grasps(), **{"trials": 2, "readings": 3, **words})


def test_a_run_says_what_its_maps_are_of_and_which_presses_trained():
    told = "maps are of presses laid over each other"
    quick = {"trials": 1, "readings": 2, "bins": 200}
    maps = tactsim.run(scan=grasps(), estimator="histogram", **quick)
    assert any(told in note for note in maps.about["notes"])
    images = tactsim.run(scan=grasps(), trials=1, readings=2)
    assert not any(told in note for note in images.about.get("notes", []))
    scan = grasps()
    leaked = replace(scan, presses=scan.press_numbers - 10 * (scan.split == "test"))
    run = tactsim.run(scan=leaked, estimator="nearest", trials=1, readings=2)
    assert any("8 of 8 test presses have training readings, too" in note for note in run.about["notes"])


def test_what_places_nothing_has_no_words_of_an_error(tmp_path, capsys):
    run = tactsim.run(scan=grasps(), trials=1, readings=2)
    print_run(run)
    assert "error" not in capsys.readouterr().out
    (group,) = collect([(tmp_path, run)])
    assert not group.places
    assert run.about["budget"] is None
