import numpy as np
import pytest
from level_world import level_press, level_scan

from tactsim import models
from tactsim.bench.runs.scan_quality import classifier_agreement
from tactsim.core import InputError
from tactsim.core.checking import checked
from tactsim.press import WORLDS, ScanOptions, press_letter, scan_letters


def classify(readings, threshold=2.0, share=0.3):
    """Eq. 3, with its corrected "No Contact"."""
    largest = readings.max(axis=1, keepdims=True)
    return (
        (readings > threshold) & (readings > share * largest),
        (readings <= threshold) & (readings <= share * largest),
    )


def test_default_readings_are_classified_right_about_as_often_as_in_the_paper():
    scan, work = scan_letters(level_scan())
    letters = {name: models.letter(name) for name in scan.letters}
    share, decided = classifier_agreement(scan, *classify(scan.readings), letters)
    assert 0.88 < share < 0.92
    assert decided > 0.7 * 1920 * 36
    assert work["presses"] + work["skipped"]["no_contact"] == 1920


def test_a_letter_s_readings_do_not_depend_on_which_others_are_scanned():
    scan, _ = scan_letters(level_scan(letters=("A", "I")))
    other, _ = scan_letters(level_scan(letters=("I",)))
    assert np.array_equal(scan.where(label="I").readings, other.readings)


def test_test_poses_leave_the_training_readings_alone_and_are_random_unless_said_otherwise():
    scan, _ = scan_letters(level_scan(letters=("E",), test_poses="same"))
    other, _ = scan_letters(level_scan(letters=("E",)))
    assert np.array_equal(scan.where(split="train").poses, scan.where(split="test").poses)
    assert not np.array_equal(scan.where(split="train").readings, scan.where(split="test").readings)
    assert np.array_equal(scan.where(split="train").readings, other.where(split="train").readings)
    poses = other.where(split="test").poses
    assert 10.2 < np.abs(poses[:, :2]).max() <= 12.0
    assert not np.isin(np.round(poses[:, 0], 6), [-10.2, -3.4, 3.4, 10.2]).any()


@pytest.mark.parametrize("gain_spread", [0.0, 0.2])
def test_the_ideal_world_reads_what_a_single_press_reads(gain_spread):
    options = level_scan(letters=("U",), **WORLDS["ideal"])
    sensor = options.sensor.model_copy(update={"gain_spread": gain_spread})
    options = options.model_copy(update={"sensor": sensor})
    scan, _ = scan_letters(options)
    for k in (50, 77):
        press = press_letter(models.letter("U"), scan.poses[k], options)
        assert press.reading == pytest.approx(scan.readings[k], abs=1e-9)
        assert (press.reading == pytest.approx(press.ideal, rel=0.01)) == (gain_spread == 0)


def test_a_single_press_without_a_generator_has_no_noise():
    press = press_letter(models.letter("E"), [1.0, 2.0, 0.3])
    assert np.abs(press.reading - press.ideal).max() <= 0.35 + 1e-9  # half a step


def test_worlds_are_valid_and_worse_data_is_classified_worse(few_angles):
    letters, shares = {"E": models.letter("E")}, {}
    for world, values in WORLDS.items():
        scan, _ = scan_letters(ScanOptions(letters=("E",), **values))
        shares[world], _ = classifier_agreement(scan, *classify(scan.readings), letters)
    assert shares["rough"] < shares["default"] - 0.05
    assert shares["paper-like"] < shares["default"] - 0.01


def test_a_shape_of_one_s_own_is_pressed_like_a_letter(tmp_path):
    drawing = tmp_path / "bar.svg"
    drawing.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="20mm" height="6mm" viewBox="0 0 20 6">'
        '<rect width="20" height="6"/></svg>'
    )
    scan, _ = scan_letters(level_scan(letters=("I",), shapes=(str(drawing),)), cache=False)
    assert scan.letters == ("I", "bar")
    assert scan.meta["objects"]["bar"]["symmetry"] == 2
    assert scan.meta["objects"]["bar"]["area"] == pytest.approx(120, abs=0.01)
    assert len(scan) == 768


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"letters": ("AB",)}, "AB"),
        ({"letters": ()}, "nothing"),
        ({"shapes": ("missing.stl",)}, "missing.stl"),
    ],
)
def test_what_cannot_be_pressed_is_said(options, says):
    with pytest.raises(InputError, match=says):
        scan_letters(level_scan(**options))


TIPPING = level_press(wrist_stiffness=16.0)


def test_a_press_that_tips_over_is_a_blank_with_its_reason():
    options = level_scan(letters=("O",), press=TIPPING, test_poses="same")
    scan, work = scan_letters(options, cache=False)
    blanks = scan.meta["blanks"]
    assert 0 < len(blanks) == work["blanks"] < 20
    assert len(scan) == 384 - len(blanks)
    assert work["presses"] + work["skipped"]["no_contact"] == 384
    for blank in blanks:
        assert (blank["letter"], "tips over" in blank["reason"]) == ("O", True)
        stated = scan.where(split=blank["split"]).poses
        assert not (stated == blank["pose"]).all(axis=1).any()
    whole, _ = scan_letters(options.model_copy(update={"press": level_press()}), cache=False)
    assert len(whole) == 384
    assert "blanks" not in whole.meta


def test_blanks_are_not_forgotten_by_the_cache():
    options = level_scan(letters=("O",), press=TIPPING)
    first, _ = scan_letters(options)
    again, work = scan_letters(options)
    assert work["blanks"] == len(first.meta["blanks"]) == len(again.meta["blanks"])
    assert np.array_equal(first.readings, again.readings)


@pytest.mark.long
def test_too_many_blanks_are_refused():
    options = level_scan(letters=("O",), press=level_press(wrist_stiffness=2.0))
    with pytest.raises(InputError, match=r"\d+ of 64 presses of 'O' .* 5% at most: .*wrist is too soft"):
        scan_letters(options, cache=False)


def test_every_press_has_a_tilt_of_its_own():
    tilted = level_scan(letters=("O",), placement_tilt=0.01)
    scan, work = scan_letters(tilted, cache=False)
    level, _ = scan_letters(level_scan(letters=("O",)), cache=False)
    assert work["engine_bed"] == work["presses"]
    touched = level.readings.max(axis=1) > 20
    change = np.abs(scan.readings - level.readings).max(axis=1)[touched]
    assert (change > 0.5).mean() > 0.95
    assert np.median(change / level.readings.max(axis=1)[touched]) > 0.1
    train, test = (scan.where(split=split).readings for split in ("train", "test"))
    assert np.abs(train - test).max() > 20


GONE = {
    "foundation": "winkler",
    "poisson": 0.45,
    "dissipation": 0.1,
    "wrist_relaxation": 0.005,
    "clearance": 0.2,
    "time_step": 1.0,
    "skip": {"cells": True, "parts": True, "stages": True, "solver": True, "known": True},
}


def test_options_that_are_gone_may_still_state_what_they_always_are():
    stated = checked(ScanOptions, {"press": GONE | {"force": 3.0}}, "scan")
    assert stated == ScanOptions(press={"force": 3.0})


@pytest.mark.parametrize(
    ("press", "message"),
    [
        (
            {"foundation": "layer"},
            r"^scan: press: foundation is always winkler now, and no option; leave it out",
        ),
        ({"time_step": 0.5}, r"^scan: press: time_step is always 1.0 now"),
        ({"skip": {"parts": False}}, r"^scan: press.skip: parts is always True now"),
    ],
)
def test_an_option_that_is_gone_and_says_otherwise_is_one_line(press, message):
    with pytest.raises(InputError, match=message) as refused:
        checked(ScanOptions, {"press": press}, "scan")
    assert "\n" not in str(refused.value)
