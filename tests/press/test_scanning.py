import numpy as np
import pytest
from level_world import level_press, level_scan
from manifold3d import Manifold

from tactsim import models
from tactsim.bench.runs.scan_quality import classifier_agreement
from tactsim.core import InputError, Pad
from tactsim.core.checking import checked
from tactsim.press import WORLDS, ScanOptions, cache, press_letter, scan_letters
from tactsim.press.scan_poses import PAPER, grid_poses, random_poses, stage_for


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
    [({"letters": ("AB",)}, "AB"), ({"letters": ()}, "nothing"),
     ({"shapes": ("missing.stl",)}, "missing.stl")],
)  # fmt: skip
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
    "foundation": "winkler", "poisson": 0.45, "dissipation": 0.1, "wrist_relaxation": 0.005, "clearance": 0.2,
    "time_step": 1.0, "skip": {"cells": True, "parts": True, "stages": True, "solver": True, "known": True},
}  # fmt: skip


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


def scaled_pad(k):
    """Give the paper's pad, every length times k."""
    pad = Pad()
    names = ("pitch_x", "pitch_y", "taxel_width", "taxel_height", "seam")
    return pad.model_copy(update={name: k * getattr(pad, name) for name in names})


def box(width, height, name="box"):
    return models.relief(name, Manifold.cube((width, height, 4.0), True))


def test_the_grid_is_the_paper_s():
    expected = [
        [x, y, k * np.pi / 6]
        for x in (-10.2, -3.4, 3.4, 10.2)
        for y in (-10.2, -3.4, 3.4, 10.2)
        for k in range(12)
    ]
    assert PAPER.poses == 192
    assert grid_poses() == pytest.approx(np.array(expected))


def test_random_poses_are_uniform_over_12_mm_and_all_angles():
    poses = random_poses(np.random.default_rng(0), 4000)
    assert random_poses(np.random.default_rng(0)).shape == (192, 3)
    for values, low, high in zip(poses.T, (-12.0, -12.0, 0), (12.0, 12.0, 2 * np.pi), strict=True):
        share, _ = np.histogram(values, 8, (low, high))
        assert share.sum() == 4000
        assert share / 4000 == pytest.approx(1 / 8, abs=5 * np.sqrt(1 / 8 * 7 / 8 / 4000))


@pytest.mark.parametrize("k", [0.2, 3.7])
@pytest.mark.parametrize("size", [(4, 6), (60, 10)])
def test_what_is_scaled_together_is_pressed_alike(k, size):
    at_one = stage_for(Pad(), box(*size))
    scaled = stage_for(scaled_pad(k), box(k * size[0], k * size[1]))
    assert np.array(scaled.positions) / k == pytest.approx(np.array(at_one.positions))
    assert scaled.reach / k == pytest.approx(at_one.reach)


@pytest.mark.parametrize(("width", "height"), [(24, 20), (80, 80)])
@pytest.mark.parametrize("k", [0.7, 2.5])
def test_the_pad_reaches_the_rim_and_no_gap_is_wider_than_the_paper_s(width, height, k):
    stage = stage_for(scaled_pad(k), box(width, height))
    rim = max(width, height) / 2
    assert stage.positions[-1] + 5.8 * k >= rim - 1e-9 or stage.positions[-1] >= 0.56 * (rim + 5.8 * k) - 1e-9
    assert np.diff(stage.positions).max() <= 6.8 * k + 1e-9
    assert len(stage.positions) >= 4
    assert stage.reach > stage.positions[-1]


def test_a_shape_too_large_for_the_pad_is_refused():
    with pytest.raises(
        InputError, match=r"'plate' reaches 100 mm from its middle; with this pad a scan covers 70.4 mm"
    ):
        stage_for(Pad(), box(200, 50, "plate"))
    assert len(stage_for(scaled_pad(3), box(200, 50)).positions) < 20


OPTIONS = level_scan(letters=("E", "I"))


def files(folder):
    return sorted(folder.glob("*.readings"))


def test_a_cached_scan_is_the_same_and_presses_nothing(own_cache, few_angles):
    fresh, work = scan_letters(OPTIONS)
    again, less = scan_letters(OPTIONS)
    uncached, more = scan_letters(OPTIONS, cache=False)
    assert np.array_equal(fresh.readings, again.readings)
    assert np.array_equal(fresh.readings, uncached.readings)
    assert fresh.meta == again.meta == uncached.meta
    assert work["presses"] == more["presses"] > 0
    assert (less["presses"], less["skipped"]["cached"]) == (0, 192)
    assert len(files(own_cache)) == 4


def cut(content):
    return content[: len(content) // 2]


def flip(content):
    return content[:-9] + bytes([content[-9] ^ 1]) + content[-8:]


@pytest.mark.parametrize("damage", [cut, flip, lambda _: b""], ids=["cut", "flipped", "empty"])
def test_a_damaged_file_is_made_again(own_cache, damage, few_angles):
    fresh, _ = scan_letters(OPTIONS)
    for path in files(own_cache):
        path.write_bytes(damage(path.read_bytes()))
    again, work = scan_letters(OPTIONS)
    assert work["skipped"]["cached"] == 0
    assert np.array_equal(fresh.readings, again.readings)
    assert scan_letters(OPTIONS)[1]["skipped"]["cached"] == 192


@pytest.mark.parametrize(
    "other",
    [level_scan(letters=("E", "I"), seed=1), level_scan(letters=("E", "I"), press=level_press(force=1.0))],
)
def test_what_changes_a_reading_changes_the_key(other, few_angles):
    scan_letters(OPTIONS)
    assert scan_letters(other)[1]["skipped"]["cached"] == 0


def test_another_shape_at_the_same_poses_has_another_key(few_angles):
    exact = {"placement_mm": 0, "placement_rad": 0, "test_poses": "same"}
    scan_letters(level_scan(letters=("E",), **exact))
    assert scan_letters(level_scan(letters=("I",), **exact))[1]["skipped"]["cached"] == 0


def test_noise_is_no_reason_to_press_again(few_angles):
    scan_letters(OPTIONS)
    noisy = OPTIONS.model_copy(update={"sensor": OPTIONS.sensor.model_copy(update={"noise": 5.0})})
    scan, work = scan_letters(noisy)
    assert work["presses"] == 0
    assert np.array_equal(scan.readings, scan_letters(noisy, cache=False)[0].readings)


def test_a_folder_that_cannot_be_written_is_done_without(tmp_path, monkeypatch, few_angles):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    monkeypatch.setenv("TACTSIM_CACHE_DIR", str(blocked))
    scan, work = scan_letters(OPTIONS)
    assert work["presses"] > 0
    assert len(scan) == 192


def test_readings_of_another_source_are_not_taken(monkeypatch, few_angles):
    scan_letters(OPTIONS)
    monkeypatch.setattr(cache, "source_digest", lambda: "0" * 64)
    assert scan_letters(OPTIONS)[1]["skipped"]["cached"] == 0
