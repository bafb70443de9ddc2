"""The face for Python: what a user types in a notebook."""

import json
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from dataclasses import fields, replace

import numpy as np
import pytest
from made_up import make_run
from matplotlib.figure import Figure
from test_trials import Blind

import tactsim
from tactsim.bench.compare import compare
from tactsim.bench.config import RunConfig, scan_options
from tactsim.bench.report.recognition import readings_of
from tactsim.bench.results import save, task_name, to_json
from tactsim.bench.runs.saved import load
from tactsim.bench.trials import TrialRules
from tactsim.core import InputError
from tactsim.estimators import Options

WORDS = {"estimator": "histogram", "bins": 1000, "trials": 2, "readings": 4}


class Even(Blind):
    """Hold every letter to be equally likely, and say the first."""

    def update(self, reading, sensor_in_robot):
        self.guess = self.letters[0]


@pytest.fixture(scope="module")
def scan():
    return tactsim.scan("AE")


@pytest.fixture(scope="module")
def run(scan):
    return tactsim.run(scan, **WORDS)


def test_readings_that_are_given_give_what_pressed_ones_give(scan, run):
    pressed = tactsim.run(letters="AE", **WORDS)
    assert run.summary == pressed.summary
    assert run.protocol == pressed.protocol == "test poses random, random order"
    assert scan.letters == ("A", "E")
    assert np.array_equal(scan.readings, tactsim.scan(letters=["A", "E"]).readings)


def test_a_runs_configuration_does_it_again():
    pressed = tactsim.run(letters="AE", noise=1.5, hold_out="E", **WORDS)
    assert tactsim.run(**pressed.config).summary == pressed.summary


def test_curves_and_headlines_are_those_of_the_summary(run):
    for name, values in run.summary.items():
        if isinstance(values, list):
            wanted = np.array([np.nan if value is None else value for value in values])
            assert np.array_equal(getattr(run, name), wanted, equal_nan=True), name
        else:
            assert getattr(run, name) == values, name
    assert (run.readings, run.seed, run.estimator, run.letters) == (4, 0, "histogram", ["A", "E"])


def test_the_table_has_a_row_for_every_trial_and_reading(run, monkeypatch):
    frame, columns = run.table(), run.columns()
    assert len(frame) == run.trials.label.size == 16
    assert list(frame.columns) == [*columns, "error_mm"]
    named = frame[(frame.label == frame.truth) & (frame.reading_number == 4)]
    assert named.error_mm.mean() == pytest.approx(run.error_mm[3])
    share = (frame.label == frame.truth).groupby(frame.reading_number).mean()
    assert np.array_equal(share, run.accuracy)
    monkeypatch.setitem(sys.modules, "pandas", None)
    assert list(run.table()) == [*columns, "error_mm"]


def test_curves_are_drawn_on_axes_of_the_users_own(run):
    one, two = Figure().subplots(1, 2)
    assert run.plot(ax=(one, two)) == (one, two)
    assert np.array_equal(one.lines[0].get_ydata(), run.accuracy)
    assert np.array_equal(two.lines[0].get_ydata(), run.error_mm)
    assert run.plot(ax=one) is one
    with pytest.raises(tactsim.InputError, match="one for the accuracy or two"):
        run.plot(ax="here")


@pytest.mark.long
def test_python_sweeps_compares_and_submits_as_the_command_line_does(tmp_path, undrawn):
    file = tmp_path / "two.toml"
    file.write_text(
        '[[run]]\nestimator = ["nearest", "histogram"]\nletters = "AE"\ntrials = 1\nreadings = 3\n'
    )
    runs = tactsim.sweep(file, tmp_path / "out")
    assert [run.estimator for run in runs] == ["nearest", "histogram"]
    rows = tactsim.compare(next((tmp_path / "out" / "runs").glob("nearest*")), runs[1])
    assert rows[0].name == "share of readings right"
    with pytest.raises(tactsim.InputError, match="unknown estimator"):
        tactsim.submit("letters-v1", "nearst", tmp_path / "bundle.tar.xz")


def test_a_run_is_saved_loaded_and_drawn(run, tmp_path):
    folder = run.save(tmp_path / "run")
    assert {path.name for path in folder.iterdir()} >= {"run.json", "readings.png", "maps.png"}
    again = tactsim.Run.load(folder)
    assert np.array_equal(again.accuracy, run.accuracy)
    assert repr(again) == repr(run)
    assert again._repr_html_() == run._repr_html_()
    assert json.loads(to_json(again.config)) == again.config == run.config
    for figure in (run.plot(), run.plot_maps(), again.plot()):
        assert figure._repr_png_().startswith(b"\x89PNG")
    with pytest.raises(InputError, match="no maps"):
        again.plot_maps()
    with pytest.raises(InputError, match=r"cannot write.*holds something already"):
        run.save(folder)


def test_a_report_does_a_trial_again_from_readings_that_can_be_had_again(run, scan, tmp_path, undrawn):
    page = tactsim.Run.load(run.save(tmp_path / "run")).report(tmp_path / "page.html")
    rows = (tmp_path / "page-recognition.csv").read_text().splitlines()
    assert len(rows) > 8
    assert "could be done again" not in page.read_text()
    louder = tactsim.run(replace(scan, readings=scan.readings * 1.5), **WORDS)
    page = tactsim.Run.load(louder.save(tmp_path / "louder")).report(tmp_path / "louder.html")
    assert "its readings were given in Python" in page.read_text()


def test_an_estimator_of_ones_own_is_tried(scan, tmp_path, undrawn):
    run = tactsim.run(scan, estimator=Even(Options()), trials=2, readings=3)
    assert run.accuracy.tolist() == [0.5, 0.5, 0.5]
    assert run.estimator == "test_api:Even"
    again = tactsim.Run.load(run.save(tmp_path / "run"))
    assert "could be done again" in again.report(tmp_path / "again.html").read_text()


def test_an_estimator_that_workers_cannot_import_is_refused_in_one_line():
    class Local(Even):
        pass

    with pytest.raises(InputError, match=r"Local .* or use jobs=1") as caught:
        tactsim.run(letters="AE", estimator=Local(Options()), trials=2, readings=3, jobs=2)
    assert "\n" not in str(caught.value)


WRONG = {
    "a class": ({"estimator": Even}, "made with its options"),
    "options twice": ({"estimator": Even(Options()), "bins": 3}, "leave out bins"),
    "a word": ({"trails": 3}, "did you mean 'trials'"),
    "an estimator's option": ({"halvings": 3}, "option of the estimator stacked; give set="),
    "a count twice": ({"bins": 100, "set": {"bins": 200}}, "bins is given by itself and in set"),
    "a training scan": ({"train_scan": 5}, "train_scan is 5; give a Scan, or the path"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_words_are_refused_in_one_line(scan, case):
    words, said = WRONG[case]
    with pytest.raises(InputError, match=said) as caught:
        tactsim.run(scan, **words)
    assert "\n" not in str(caught.value)


HOSTILE = "<img src=x onerror=alert(1)> $\\frac$ & \"'"


def test_hostile_names_stay_text_in_a_notebook_and_in_pictures():
    run = make_run()
    run.config["estimator"] = run.about["description"] = run.about["protocol"] = HOSTILE
    run.about["letters"] = [HOSTILE, "E"]
    tree = ElementTree.fromstring(run._repr_html_())
    (image,) = tree.iter("img")
    assert image.get("src").startswith("data:image/png;base64,")
    assert HOSTILE in "".join(tree.itertext())
    assert HOSTILE in repr(run)
    run.plot()._repr_png_()


def test_the_press_is_a_package_and_a_function():
    script = """
import tactsim.press
import tactsim
from tactsim.press import press_letter
from tactsim.press.scan_options import ScanOptions
assert tactsim.press.press_letter is press_letter is tactsim.press_letter
print(tactsim.press("A", pose=(1, 0, 0.5)).reading.shape)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == "(36,)\n"


def test_the_face_takes_what_the_command_line_takes():
    dotted, nested = {"press.force": 3.0, "pad.seam": None}, {"press": {"force": 3.0}, "pad": {"seam": None}}
    options = [scan_options(letters="A", scan_set=words) for words in (dotted, nested)]
    assert options[0] == options[1]
    assert (options[0].press.force, options[0].pad.seam) == (3.0, None)
    assert scan_options(shapes="key.svg").shapes == scan_options(shapes=["key.svg"]).shapes == ("key.svg",)
    assert scan_options(letters=np.array(["A", "E"])).letters == ("A", "E")


def test_an_estimator_that_nobody_names_is_the_one_of_the_task(monkeypatch):
    monkeypatch.setattr("tactsim.bench.api.perform", lambda config, **how: config)
    assert tactsim.run().estimator == "stacked"
    assert tactsim.run(task="solids").estimator == "space-refined"


def test_a_run_on_given_readings_is_not_done_again_on_others(run):
    with pytest.raises(InputError, match="give the same again"):
        tactsim.run(**run.config)
    with pytest.raises(InputError, match="give the same again"):
        tactsim.run(**run.config | {"scan": tactsim.scan("AE", seed=1)})


def test_scans_to_train_on_are_taken_as_scans_and_as_files(scan, tmp_path):
    other = tactsim.scan("AE", seed=1)
    run = tactsim.run(scan, train_scan=other, **WORDS)
    for name, one in (("test", scan), ("train", other)):
        one.save(tmp_path / f"{name}.npz")
    files = {"scan": tmp_path / "test.npz", "train_scan": tmp_path / "train.npz"}
    assert run.summary == tactsim.run(**files, **WORDS).summary
    again = run.config | {"scan": scan, "train_scan": other}
    assert tactsim.run(**again).summary == run.summary
    with pytest.raises(InputError, match="give the same again"):
        tactsim.run(**run.config | {"scan": scan})
    with pytest.raises(InputError, match="train_scan is a Scan, so scan has to be one, too"):
        tactsim.run(scan=files["scan"], train_scan=other, **WORDS)


def test_nothing_is_written_over(run, tmp_path):
    run.save(tmp_path / "run")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(InputError, match="it is a folder"):
        run.report(tmp_path / "run")
    assert sorted(tmp_path.rglob("*")) == before


def test_a_run_learns_from_as_few_presses_as_are_asked_for(tmp_path):
    words = {"letters": "AE", "estimator": "nearest", "trials": 2, "readings": 3}
    few = tactsim.run(**words, train_presses=12)
    assert np.bincount(few.plan.scan.where("train").labels == "A").tolist() == [12, 12]
    assert len(few.plan.scan.where("test")) == 2 * 192
    assert np.array_equal(few.trials.true_pose, tactsim.run(**words).trials.true_pose)  # the same trials
    assert task_name(few) == "train_presses 12, letters AE"
    save(few, tmp_path / "few")
    assert readings_of(load(tmp_path / "few"), {}).digest == few.plan.scan.digest
    with pytest.raises(InputError, match="A has 192 training presses; 500 are asked for"):
        tactsim.run(**words, train_presses=500)


def test_errors_are_measured_alike_however_few_presses_are_learned_from():
    pressed = tactsim.scan(letters="AE", test_poses="random")
    scan = replace(pressed, meta={name: of for name, of in pressed.meta.items() if name != "objects"})
    words = {"estimator": "nearest", "scan": scan, "trials": 2, "readings": 3}
    whole = tactsim.run(**words)
    assert whole.objects == tactsim.run(**words, train_presses=5).objects
    assert whole.objects == tactsim.run(**words, hold_out="A").objects
    assert whole.objects["A"].centre == pytest.approx((0, 0), abs=2)


# Of each option of a run a value that is not its own, with what it needs beside it.
OTHER = {
    "letters": "AE", "shapes": "S.svg", "test_poses": "same", "world": "rough", "pad": "anyskin", "noise": 1.5,
    "scan_set": {"press": {"force": 3}}, "seed": 1, "estimator": "histogram", "bins": 7, "particles": 7,
    "set": {"sigma_mm": 2}, "hold_out": "A", "trials": 3, "readings": 7, "explore": "information", "stop_at": 0.9,
    "slip": {"walk_mm": 1}, "scan": "a.npz", "train_scan": "b.npz", "train_presses": 9, "bound": True, "given": "d",
    "presses": {"presses": "c", "train_scan": "b.npz"},
}  # fmt: skip


def test_every_option_of_a_run_counts_in_its_digest():
    """A sweep does one run for each digest: an option that did not count would be swept over without a word."""
    assert set(OTHER) == set(RunConfig.model_fields) - {"task"}  # which says the others
    words = {name: value if name == "presses" else {name: value} for name, value in OTHER.items()}
    digests = {name: RunConfig(**more).digest for name, more in words.items()}
    assert RunConfig().digest == RunConfig(seed=0).digest
    assert len({*digests.values(), RunConfig().digest}) == len(OTHER) + 1


def test_every_rule_of_a_trial_comes_from_the_configuration():
    config = RunConfig(
        readings=7, seed=3, explore="information", slip={"walk_mm": 1}, hold_out="each", stop_at=0.9
    )
    rules = TrialRules.of(config, None)
    for rule in fields(TrialRules):
        assert rule.name == "press" or hasattr(config, rule.name)
        assert rule.name in ("press", "measured") or getattr(rules, rule.name) != rule.default


def test_a_run_whose_trials_may_end_says_how_many_touches_they_took(tmp_path):
    words = {"estimator": "histogram", "bins": 1000, "letters": "AEI", "trials": 4, "readings": 12}
    whole, ended = tactsim.run(**words), tactsim.run(**words, stop_at=0.9)
    took = ended.trials.touches
    assert took.min() >= 1
    assert took.max() <= 12
    assert took.mean() < 12 == whole.touches
    p = whole.trials.p_label
    assert (took == np.where((p >= 0.9).any(axis=1), (p >= 0.9).argmax(axis=1) + 1, 12)).all()
    assert ended.touches == took.mean()
    assert f"after {took.mean():.1f} touches on average" in ended.cautions[0]
    assert "stop at 0.9" in ended.protocol
    assert whole.ended is None
    assert ended.as_json()["stop_at"] == 0.9
    loaded = load(ended.save(tmp_path / "ended"))
    assert np.array_equal(loaded.trials.touch_index, ended.trials.touch_index)
    assert loaded.summary == ended.summary
    page = loaded.report(tmp_path / "page.html").read_text(encoding="utf-8")
    assert "touches on average" in page
    with pytest.raises(InputError, match="different protocols"):
        compare(whole, ended)


def test_a_run_says_so_if_it_refuses_much_of_what_it_knows():
    run = tactsim.run(estimator="histogram", bins=500, letters="AE", trials=2, readings=2)
    assert run.refusing is None
    label = run.trials.label.astype("U4")
    label[0, -1] = "none"
    refused = replace(run, trials=replace(run.trials, label=label))
    assert refused.cautions == run.cautions + [refused.refusing]
    assert refused.refusing.startswith("25% of the trials of a known letter end in 'none'")
