"""`bench fit` as a user calls it, and what a run of a recorded scan says of what was fitted."""

import json
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from command_line import refused

import tactsim
from tactsim.core import InputError, Scan


@pytest.fixture(scope="module")
def imported():
    """Give two pressed letters as if somebody had measured them in counts, with a bent response."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tactsim.press.scan_poses.ANGLES", 6)
        scan = tactsim.scan(letters="IL")
    pad = scan.meta["options"]["pad"]
    bent = 1000 * np.sign(scan.readings) * np.abs(scan.readings / 30) ** 2
    return replace(scan, readings=bent, meta={"source": "imported", "unit": "count", "pad": pad})


@pytest.mark.long
def test_what_is_chosen_is_said_and_written_as_a_world_that_can_be_pressed(here, tmp_path, imported):
    imported.save(tmp_path / "made.npz")
    said = here("fit", "made.npz", "--out", "pad.toml")
    assert said.returncode == 0
    for word in ("threshold", "sigma", "nats", "count", "response"):
        assert word in said.stdout
    told = json.loads(here("fit", "made.npz", "--set", "sigma=1.5", "--json").stdout)
    assert told["unit"] == "count"
    assert "sigma" not in told["chosen"]
    assert told["information_chosen"] >= told["information_default"] > 0
    assert told["response_exponent"] < 1  # a response that squares is undone by a root
    world = tomllib.loads((tmp_path / "pad.toml").read_text())
    assert world == told["world"]
    assert world["sensor"]["response"] == pytest.approx(1 / told["response_exponent"])
    assert here("scan", "--letters", "I", "--world", "pad.toml", "--out", "again.npz").returncode == 0


@pytest.mark.long
def test_a_run_on_imported_readings_says_what_was_fitted_and_takes_the_unit_as_it_comes(imported):
    run = tactsim.run(imported, trials=10, readings=3)
    other = replace(imported, readings=imported.readings / 1000)
    again = tactsim.run(other, trials=10, readings=3)
    assert run.accuracy[-1] >= 0.8  # after three readings
    np.testing.assert_array_equal(again.trials.label, run.trials.label)
    np.testing.assert_allclose(again.trials.pose, run.trials.pose, atol=1e-6)
    facts = run.about["pad_fit"]
    assert run.options["threshold"] == facts["chosen"]["threshold"]
    assert again.options["threshold"] == pytest.approx(run.options["threshold"] / 1000)
    assert "pad_fit" not in tactsim.run(imported, set={"fit": "off"}, trials=1, readings=1).about
    assert "pad_fit" not in tactsim.run(imported, estimator="nearest", trials=1, readings=1).about


def test_wrong_input_is_one_line(here, tmp_path, imported):
    imported.save(tmp_path / "made.npz")
    replace(imported, readings=0 * imported.readings).save(tmp_path / "blank.npz")
    refused(here("fit", "blank.npz"), "blank.npz", "touches")
    refused(here("fit", "none.npz"), "none.npz")
    refused(here("fit", "made.npz", "--estimator", "nearest"), "nearest", "maps")


FEW = {"spacing": 2.0, "angles": 9, "modes": 200}


@pytest.fixture(scope="module")
def scan():
    return tactsim.scan(letters="IL")


@pytest.mark.long
def test_a_run_recognises_by_pressing_whatever_the_number_of_processes(scan):
    run = tactsim.run(scan, estimator="synthesis", set=FEW, trials=4, readings=6)
    assert run.accuracy[-1] == 1
    assert run.error_mm[-1] < 0.5
    assert np.isfinite(run.trials.pose).all()
    again = tactsim.run(scan, estimator="synthesis", set=FEW, trials=4, readings=6, jobs=2)
    np.testing.assert_array_equal(again.trials.pose, run.trials.pose)


def test_a_scan_that_does_not_say_how_it_was_pressed_is_refused_in_one_line(scan, tmp_path):
    bare = Scan(scan.readings, scan.poses, scan.labels, scan.split, scan.taxel_xy)
    with pytest.raises(InputError, match="does not say how its letters were pressed"):
        tactsim.run(bare, estimator="synthesis", trials=1, readings=2)


@pytest.mark.long
@pytest.mark.parametrize("power", [0.5, 1.0])
def test_counts_that_training_presses_explain_are_recognised_by_pressing(scan, tmp_path, power):
    counts = np.round(200 * np.maximum(scan.readings, 0) ** power)
    meta = {"source": "imported", "unit": "count", "objects": scan.meta["objects"]}
    replace(scan, readings=counts, meta=meta).save(tmp_path / "counts.npz")
    (tmp_path / "world.toml").write_text("[sensor]\nnoise = 1.0\n")
    words = {
        "scan": tmp_path / "counts.npz",
        "estimator": "synthesis",
        "set": FEW,
        "trials": 4,
        "readings": 6,
    }
    run = tactsim.run(**words, world=str(tmp_path / "world.toml"))
    assert run.accuracy[-1] == 1
    assert run.error_mm[-1] < 0.5
    with pytest.raises(InputError, match=r"does not say how its letters were pressed.*--shape FILE"):
        tactsim.run(**words)
    labels = np.where(scan.labels == "I", "bolt", "L")
    bolt = replace(scan, labels=labels, readings=counts, meta=meta)
    with pytest.raises(InputError, match="no --shape is called 'bolt'"):
        tactsim.run(bolt, estimator="synthesis", noise=1.0, trials=1, readings=1)
    with pytest.raises(InputError, match="noise says how letters are pressed"):
        tactsim.run(**words | {"estimator": "nearest", "set": {}}, noise=1.0)


@pytest.mark.long
def test_a_world_without_noise_is_recognised_too():
    run = tactsim.run(letters="AEIOU", world="ideal", estimator="synthesis", trials=2, readings=6)
    assert run.accuracy[-1] == 1
    assert run.error_mm[-1] < 0.1
