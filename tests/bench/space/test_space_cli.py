"""`--task solids` as a user calls it, with a quick estimator in place of the filters."""

import json
from pathlib import Path

import numpy as np
import pytest

import tactsim
from tactsim.bench.cli.app import app
from tactsim.bench.experiment import perform
from tactsim.bench.results import load
from tactsim.bench.space.space_config import space_config
from tactsim.bench.space.space_runner import perform_in_space
from tactsim.core import InputError, rigid
from tactsim.core.space_scan import SpaceScan
from tactsim.estimators import registry

SMALL = ["--objects", "nut,egg,key", "--scan-set", "points=16", "--scan-set", "tests=4"]
RUN = ["run", "--task", "solids", "--estimator", "alike", "--trials", "5", "--touches", "3", *SMALL]


@pytest.fixture(autouse=True)
def alike(monkeypatch, tmp_path):
    monkeypatch.setitem(registry.BUILT_IN, "alike", ("stand_in:AlikeTouches", "for tests"))
    monkeypatch.chdir(tmp_path)


def bench(*words):
    return app([*words], standalone_mode=False, prog_name="bench")


def refused(*words):
    with pytest.raises(Exception) as refusal:  # noqa: PT011  (the command line's own errors are of several classes)
        bench(*words)
    assert isinstance(refusal.value, InputError) or "--" in str(getattr(refusal.value, "message", "")), (
        refusal.value
    )
    message = getattr(refusal.value, "message", None) or str(refusal.value)
    assert "\n" not in message
    return message


@pytest.mark.long
def test_a_run_prints_its_table_and_leaves_its_folder_and_its_page(capsys, tmp_path):
    bench(*RUN, "--verbose", "--out", "here")
    out = capsys.readouterr().out
    for word in ("touches", "95 % interval", "degrees", "a recognition of 3 touches", "presses"):
        assert word in out
    names = {path.name for path in (tmp_path / "here").iterdir()}
    assert names == {
        "run.json", "trials.csv", "times.csv", "summary.json", "times.json", "objects.npz", "touches.png"
    }  # fmt: skip
    bench("report", "here", "--out", "page.html")
    assert "remark" not in capsys.readouterr().err
    assert len((tmp_path / "page.html").read_text()) > 10_000


@pytest.mark.long
def test_json_and_the_same_seed(capsys, tmp_path):
    bench(*RUN, "--json", "--out", "a")
    answer = json.loads(capsys.readouterr().out)
    assert answer["objects"] == ["nut", "egg", "key"]
    assert len(answer["accuracy"]) == len(answer["angle_deg"]) == 3
    assert answer["work"]["presses"] == 3 * (2 * 16 + 4)
    bench(*RUN, "--json", "--out", "b")
    bench(*RUN, "--json", "--out", "c", "--seed", "1")
    first, again, other = ((tmp_path / name / "trials.csv").read_bytes() for name in "abc")
    assert first == again != other


def test_a_scan_of_a_file_gives_the_run_that_touches_anew(tmp_path):
    bench("scan", "--task", "solids", *SMALL, "--out", "s.npz")
    scan = SpaceScan.load("s.npz")
    assert scan.objects == ("nut", "egg", "key")
    bench(*RUN, "--out", "a")
    bench(*RUN, "--out", "b", "--scan", "s.npz")
    assert np.array_equal(load(tmp_path / "a").trials.pose, load(tmp_path / "b").trials.pose)


@pytest.mark.long
def test_a_sweep_does_runs_with_objects_in_space(tmp_path, capsys):
    (tmp_path / "two.toml").write_text(
        '[defaults]\ntask = "solids"\nestimator = "space-refined"\nobjects = "nut,egg"\ntrials = 2\ntouches = 2\n'
        'scan_set = {points = 8}\n[[run]]\nexplore = ["random", "information"]\n'
    )
    bench("sweep", "two.toml", "--jobs", "1", "--out", "there")
    assert "chosen by information" in capsys.readouterr().out
    words = {"objects": "nut,egg", "trials": 2, "touches": 2, "scan_set": {"points": 8}}
    for folder in sorted((tmp_path / "there" / "runs").iterdir()):
        run = load(folder)
        alone = perform(space_config(**words, explore=run.config["explore"]))
        assert np.array_equal(run.trials.pose, alone.trials.pose)
        assert np.array_equal(run.trials.met, alone.trials.met)
    bench("sweep", "two.toml", "--jobs", "1", "--out", "there")  # nothing is left to do


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
    assert np.array_equal(run.trials.pose, perform_in_space(space_config(**words)).trials.pose)
    assert run.in_space
    assert "2 touches over nut egg" in repr(run)
    own = tactsim.run(
        task="solids", **(words | {"estimator": tactsim.create("alike")})
    )  # made with its options
    assert np.array_equal(own.trials.pose, run.trials.pose)
    touched = {"scan": run.plan.scan}
    for given in (touched, touched | {"train_scan": run.plan.scan}, touched | {"task": "solids"}):
        with pytest.raises(InputError, match="the scan is of objects in space; save it, and give its file"):
            tactsim.run(**given)


def test_runs_in_the_plane_and_in_space_share_no_comparison_and_no_page(tmp_path):
    plane, space = (Path(__file__).parents[2] / "fixtures" / "v0.1" / name for name in ("run", "solids"))
    assert "other of objects in space" in refused("compare", str(plane), str(space))
    assert "make two" in refused("report", str(plane), str(space), "--out", "page.html")


def test_an_estimator_that_chooses_is_offered_what_one_that_does_not_is():
    words = {"estimator": "alike", "objects": "nut,egg", "trials": 2, "touches": 3, "scan_set": {"points": 8}}
    random = perform(space_config(**words)).trials
    chosen = perform(space_config(**words, explore="information")).trials
    assert np.array_equal(random.true_pose, chosen.true_pose)
    assert not np.array_equal(random.start, chosen.start)  # the stand-in takes the last of those offered
    assert random.propose_s.sum() == 0


def test_a_hand_gives_two_readings_a_touch(tmp_path):
    words = {"estimator": "alike", "objects": "nut,egg", "trials": 4, "touches": 3, "scan_set": {"points": 8}}
    run = perform(space_config(**words, hand="gripper"))
    assert (run.trials.evaluations == 2).all()
    assert run.trials.met.max() == 2
    assert "gripper" in run.about["protocol"]


def test_the_frame_of_an_object_does_not_matter_to_its_error():
    """A pose that differs by a symmetry of a nut is no error; the mirror image of that turn is one."""
    run = perform(
        space_config(estimator="alike", objects="nut,key", trials=2, touches=1, scan_set={"points": 8})
    )
    from tactsim.bench.space.surface_distance import surface_distance, turn_between

    true = rigid.invert(run.trials.true_pose[:1, 0])
    for label, alike in (("nut", True), ("key", False)):
        of = run.objects[label]
        turn = run.objects["nut"].rotations[3]
        other = rigid.compose(true, np.concatenate([np.zeros(3), turn]))
        assert (surface_distance(other, true, of)[0] < 1e-3) == alike
        assert (turn_between(other, true, of)[0] < 1e-3) == alike


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--letters", "AE"], "--objects"),
        (["--readings", "5"], "--touches"),
        (["--world", "rough"], "--world"),
        (["--objects", "bolzen"], "bolt"),
        (["--objects", "none"], "nothing to touch"),
        (["--objects", "51"], "50"),
        (["--touches", "0"], "touches"),
        (["--trials", "0"], "trials"),
        (["--explore", "blind"], "information"),
        (["--hand", "nothere.toml"], "nothere.toml"),
    ],
)
def test_a_mistake_is_one_line_that_says_what_would_be_right(words, says):
    assert says in refused("run", "--task", "solids", "--estimator", "alike", *words)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["run", "--estimator", "alike"], "--task solids"),
        (["run", "--touches", "3"], "--task solids"),
        (["run", "--hand", "gripper"], "--task solids"),
        (["scan", "--objects", "nut", "--out", "x.npz"], "--task solids"),
        (["scan", "--task", "solid", "--out", "x.npz"], "solids"),
        (["scan", "--task", "solids", "--letters", "A", "--out", "x.npz"], "--objects"),
    ],
)
def test_what_is_of_space_is_not_of_the_plane(words, says):
    assert says in refused(*words)


def test_a_hand_whose_pads_overlap_is_refused(tmp_path):
    pad = "[[pads]]\npose = [0, 0, -70.0, 1, 0, 0, 0]\n"
    (tmp_path / "fist.toml").write_text(2 * pad)
    assert "overlap" in refused(*RUN, "--hand", "fist.toml")
    (tmp_path / "bent.toml").write_text(pad + pad.replace("1, 0", "2, 0"))
    assert "length" in refused(*RUN, "--hand", "bent.toml")


def test_an_estimator_that_answers_in_the_plane_is_named(monkeypatch):
    from stand_in import AlikeTouches

    from tactsim.estimators import Estimate

    flat = Estimate("nut", {"nut": 1.0, "egg": 0.0}, np.zeros(3))
    monkeypatch.setattr(AlikeTouches, "estimate", lambda self: flat)
    assert "AlikeTouches" in refused(*RUN)
