"""`--task solids` as a user calls it, with a quick estimator in place of the filters."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from command_line import refused

import tactsim
from tactsim.bench.experiment import perform
from tactsim.bench.runs.saved import load
from tactsim.core import InputError
from tactsim.estimators import registry
from tactsim.solids.kind import space_config
from tactsim.solids.scan import SpaceScan

SMALL = ["--objects", "nut,egg,key", "--scan-set", "points=16", "--scan-set", "tests=4"]
RUN = ["run", "--task", "solids", "--estimator", "alike", "--trials", "5", "--touches", "3", *SMALL]


@pytest.fixture(autouse=True)
def alike(monkeypatch):
    monkeypatch.setitem(registry.BUILT_IN, "alike", ("stand_in:AlikeTouches", "for tests"))


@pytest.mark.long
def test_a_run_prints_its_table_and_leaves_its_folder_and_its_page(here, tmp_path):
    assert "a recognition of 3 touches" in here(*RUN, "--verbose", "--out", "here").stdout
    names = {path.name for path in (tmp_path / "here").iterdir()}
    assert names == {
        "run.json", "trials.csv", "times.csv", "summary.json", "times.json", "objects.npz", "touches.png"
    }  # fmt: skip
    assert "remark" not in here("report", "here", "--out", "page.html").stderr
    for words in (("--width", "3.4in"), ("--panel", "error"), ("--no-caption",)):
        refused(here("report", "here", "--out", "narrow.html", *words), words[0], "letters in the plane")
    assert len((tmp_path / "page.html").read_text()) > 10_000


def test_a_scan_of_a_file_gives_the_run_that_touches_anew(here, tmp_path):
    here("scan", "--task", "solids", *SMALL, "--out", "s.npz")
    scan = SpaceScan.load("s.npz")
    assert scan.objects == ("nut", "egg", "key")
    here(*RUN, "--out", "a")
    here(*RUN, "--out", "b", "--scan", "s.npz")
    assert np.array_equal(load(tmp_path / "a").trials.pose, load(tmp_path / "b").trials.pose)


def test_readings_of_one_shape_are_not_scored_as_another_of_its_name(here, tmp_path):
    for folder, sides in (("one", (20, 14, 9)), ("other", (20, 14, 11))):
        (tmp_path / folder).mkdir()
        trimesh.creation.box(sides).export(tmp_path / folder / "brick.stl")
    few = ["--objects", "none", "--scan-set", "points=8", "--scan-set", "tests=4"]
    here("scan", "--task", "solids", *few, "--shape", "one/brick.stl", "--out", "s.npz")
    run = ["run", "--task", "solids", "--estimator", "alike", "--trials", "1", "--touches", "1", *few]
    here(*run, "--scan", "s.npz", "--shape", "one/brick.stl", "--out", "same")
    other = here(*run, "--scan", "s.npz", "--shape", "other/brick.stl", "--out", "another")
    refused(other, "touched another brick than the --shape of that name")


@pytest.mark.long
def test_a_sweep_does_runs_with_objects_in_space(here, tmp_path):
    (tmp_path / "two.toml").write_text(
        '[defaults]\ntask = "solids"\nestimator = "space-refined"\nobjects = "nut,egg"\ntrials = 2\ntouches = 2\n'
        'scan_set = {points = 8}\n[[run]]\nexplore = ["random", "information"]\n'
    )
    assert here("sweep", "two.toml", "--jobs", "1", "--out", "there").returncode == 0
    words = {"objects": "nut,egg", "trials": 2, "touches": 2, "scan_set": {"points": 8}}
    for folder in sorted((tmp_path / "there" / "runs").iterdir()):
        run = load(folder)
        alone = perform(space_config(**words, explore=run.config["explore"]))
        assert np.array_equal(run.trials.pose, alone.trials.pose)
        assert np.array_equal(run.trials.met, alone.trials.met)


@pytest.mark.long
@pytest.mark.parametrize("hand", [None, "gripper"])
def test_worker_processes_do_the_same_trials(hand):
    config = space_config(objects="nut,egg", trials=3, touches=2, scan_set={"points": 8}, hand=hand)
    here, there = perform(config), perform(config, jobs=2)
    assert np.array_equal(here.trials.pose, there.trials.pose)
    assert np.array_equal(here.trials.start, there.trials.start)
    assert here.work["likelihood_evaluations"] == there.work["likelihood_evaluations"]


def test_python_does_what_the_command_line_does():
    words = {"estimator": "alike", "objects": "nut,egg", "trials": 2, "touches": 2, "scan_set": {"points": 8}}
    run = tactsim.run(task="solids", **words)
    assert np.array_equal(run.trials.pose, perform(space_config(**words)).trials.pose)
    assert run.kind.name == "solids"
    # Made with its options
    own = tactsim.run(task="solids", **(words | {"estimator": tactsim.create("alike")}))
    assert np.array_equal(own.trials.pose, run.trials.pose)
    with pytest.raises(InputError, match="the scan is of solids; save it, and give its file"):
        tactsim.run(scan=run.plan.scan)


def test_runs_in_the_plane_and_in_space_share_no_comparison_and_no_page(here):
    plane, space = (Path(__file__).parents[1] / "fixtures" / "v0.1" / name for name in ("run", "solids"))
    refused(here("compare", plane, space), "the other solids")
    refused(here("report", plane, space, "--out", "page.html"), "make two")


def test_an_estimator_that_chooses_is_offered_what_one_that_does_not_is():
    words = {"estimator": "alike", "objects": "nut,egg", "trials": 2, "touches": 3, "scan_set": {"points": 8}}
    random = perform(space_config(**words)).trials
    chosen = perform(space_config(**words, explore="information")).trials
    assert np.array_equal(random.true_pose, chosen.true_pose)
    assert not np.array_equal(random.start, chosen.start)  # the stand-in takes the last of those offered
    assert random.propose_s.sum() == 0


def test_a_trial_ends_as_soon_as_it_is_sure(tmp_path):
    words = {"estimator": "alike", "objects": "nut,egg", "trials": 2, "touches": 3, "scan_set": {"points": 8}}
    whole, ended = perform(space_config(**words)), perform(space_config(**words, stop_at=0.3))
    assert whole.trials.touches.tolist() == [3, 3]
    assert ended.trials.touches.tolist() == [1, 1]
    assert np.array_equal(ended.trials.pose[:, -1], whole.trials.pose[:, 0])
    assert "stop at 0.3" in ended.protocol
    again = load(ended.save(tmp_path / "ended"))
    assert np.array_equal(again.trials.touch_index, ended.trials.touch_index)
    assert again.summary == ended.summary


def test_a_hand_gives_two_readings_a_touch():
    words = {"estimator": "alike", "objects": "nut,egg", "trials": 4, "touches": 3, "scan_set": {"points": 8}}
    run = perform(space_config(**words, hand="gripper"))
    assert (run.trials.evaluations == 2).all()
    assert run.trials.met.max() == 2
    assert "gripper" in run.about["protocol"]


@pytest.mark.parametrize(
    ("words", "says"),
    [(["--letters", "AE"], "--objects"), (["--pad", "pad.toml"], "use --scan-set pad=FILE"),
     (["--objects", "bolzen"], "bolt"), (["--touches", "0"], "touches"),
     (["--hand", "nothere.toml"], "nothere.toml")],
)  # fmt: skip
def test_a_mistake_is_one_line_that_says_what_would_be_right(here, words, says):
    refused(here("run", "--task", "solids", "--estimator", "alike", *words), says)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["run", "--estimator", "alike"], "--task solids"),
        (["scan", "--objects", "nut", "--out", "x.npz"], "--task solids"),
        (["scan", "--task", "solids", "--sequence", "--out", "x.npz"], "--sequence is for letters"),
        (["scan", "--task", "solid", "--out", "x.npz"], "solids"),
    ],
)
def test_what_is_of_space_is_not_of_the_plane(here, words, says):
    refused(here(*words), says)


def test_a_hand_whose_pads_overlap_is_refused(here, tmp_path):
    pad = "[[pads]]\npose = [0, 0, -70.0, 1, 0, 0, 0]\n"
    (tmp_path / "fist.toml").write_text(2 * pad)
    refused(here(*RUN, "--hand", "fist.toml"), "overlap")
