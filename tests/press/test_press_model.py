"""The forward model of estimators against the press itself, and against its own differences."""

from dataclasses import replace

import numpy as np
import pytest

import tactsim
from tactsim import models
from tactsim.core import InputError, compose
from tactsim.press import WORLDS, PressModel, ScanOptions, forward_model, scan_letters
from tactsim.press.engine import press_at
from tactsim.press.touches import Touches


def options(world="default", **press):
    named = WORLDS[world]
    return ScanOptions(**named | {"press": named.get("press", {}) | press})


def presses(rng, count=25):
    return rng.uniform([-10, -10, -np.pi], [10, 10, np.pi], (count, 3))


@pytest.mark.parametrize(("world", "name"), [("default", "A"), ("level", "O"), ("paper-like", "A")])
def test_it_reads_what_the_press_reads(world, name):
    rng = np.random.default_rng(0)
    given, letter, poses = options(world), models.letter(name), presses(rng)
    tilts = given.placement_tilt * rng.standard_normal((len(poses), 2))
    pressed = press_at(Touches(letter, poses, tilts), given)
    ideal = pressed.readings(given)
    ours = PressModel([letter], given).readings(name, poses, tilts)
    assert ideal.max() > 30
    assert len(pressed.blanks) == 0
    np.testing.assert_allclose(ours, ideal, atol=2e-3 * ideal.max(), rtol=0)
    assert np.median(np.abs(ours - ideal).max(axis=1)) < 2e-4 * ideal.max()


def test_the_press_comes_nearer_to_it_with_finer_cells():
    rng = np.random.default_rng(1)
    letter, poses = models.letter("E"), presses(rng)
    ours = PressModel([letter], options("level")).readings("E", poses)
    apart = []
    for cells in (2, 6):
        given = options("level", cells_per_taxel=cells)
        apart.append(np.abs(press_at(Touches.of(letter, poses), given).readings(given) - ours).max())
    assert apart[0] > 4 * apart[1]
    assert apart[1] < 2e-5 * ours.max()


def test_beside_the_letter_nothing_is_felt():
    model = PressModel([models.letter("I")], options())
    found = model.linearised("I", np.array([[model.reach["I"] + 0.1, 0, 0], [12.0, 0, 0], [1e9, 1e9, 1]]))
    assert not found.mean.any()
    assert not found.by_pose.any()
    assert not found.nuisance.any()


@pytest.mark.parametrize("name", ["I", "O"])
def test_half_a_turn_of_the_pad_reverses_a_reading_and_symmetry_hides_a_turn_of_the_letter(name):
    model = PressModel([models.letter(name)], options("level"))
    assert model.turns == 2
    pose = np.array([[3.0, -2.0, 0.4]])
    turned = compose(pose, [0, 0, np.pi])
    np.testing.assert_allclose(
        model.readings(name, turned)[:, ::-1], model.readings(name, pose), atol=1e-3, rtol=0
    )
    angle = 1.0 if model.symmetry[name] == 0 else 2 * np.pi / model.symmetry[name]
    alike = compose([0, 0, angle], pose)
    # An O's outline is a polygon, so it is nearly a disc.
    np.testing.assert_allclose(model.readings(name, alike), model.readings(name, pose), atol=0.05, rtol=0)


def test_the_response_curve_is_bent_as_the_sensor_bends_it():
    given = options("level").model_copy(
        update={"sensor": options().sensor.model_copy(update={"response": 0.7})}
    )
    letter, poses = models.letter("U"), presses(np.random.default_rng(3), 5)
    straight = PressModel([letter], options("level")).linearised("U", poses)
    bent = PressModel([letter], given).linearised("U", poses)
    felt = straight.mean > 1
    np.testing.assert_allclose(bent.mean[felt], 25 * (straight.mean[felt] / 25) ** 0.7, rtol=1e-9)
    slope = 0.7 * (straight.mean[felt] / 25) ** -0.3
    np.testing.assert_allclose(bent.by_pose[:, 0][felt], straight.by_pose[:, 0][felt] * slope, rtol=1e-9)


def test_ghosts_are_refused_and_unmixed_readings_are_not():
    letter = models.letter("U")
    for unmix in (True, False):
        sensor = options().sensor.model_copy(update={"ghosting": "floating", "unmix": unmix})
        given = options("level").model_copy(update={"sensor": sensor})
        if unmix:
            PressModel([letter], given)
        else:
            with pytest.raises(InputError, match=r"give sensor\.unmix = true"):
                PressModel([letter], given)


def test_a_scan_says_how_it_was_pressed():
    given = ScanOptions(letters=("I", "L"), **WORLDS["ideal"])
    scan, _ = scan_letters(given, cache=False)
    model = forward_model(scan)
    mine = scan.where("train", "L")
    assert model.letters == ("I", "L")
    np.testing.assert_allclose(
        model.readings("L", mine.poses), mine.readings, atol=3e-3 * mine.readings.max(), rtol=0
    )
    fewer = forward_model(replace(mine, readings=mine.readings[:, ::5], taxel_xy=mine.taxel_xy[::5]))
    assert (fewer.taxels, fewer.turns) == (8, 1)
    np.testing.assert_array_equal(fewer.readings("L", mine.poses), model.readings("L", mine.poses)[:, ::5])


def test_what_cannot_be_pressed_is_refused_in_one_line():
    scan = tactsim.scan(letters="I", cache=False)
    for meta, message in (
        ({}, "does not say how"),
        ({**scan.meta, "options": {**scan.meta["options"], "letters": ["L"]}}, "letter"),
        ({**scan.meta, "objects": {"I": {"digest": "other"}}}, "another shape"),
        ({"options": {**scan.meta["options"], "rounding": 0.5}}, "flat faces"),
    ):
        with pytest.raises(InputError, match=message) as caught:
            forward_model(replace(scan, meta=meta))
        assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="taxels lie elsewhere"):
        forward_model(replace(scan, taxel_xy=scan.taxel_xy + 0.5))
    with pytest.raises(InputError, match="letter of the forward model"):
        forward_model(scan).readings("A", np.zeros((1, 3)))


@pytest.mark.parametrize("world", ["default", "handheld", "rough"])
def test_a_press_that_is_off_is_predicted_as_it_is_pressed(world):
    """Its load, against a press of that force; its place and tilt, against one there; slopes, against differences.

    Loads have mean 1, so the middle one of a log-normal spread is a little less. A load that is given comes to that,
    and its logarithm is the last nuisance.
    """
    rng = np.random.default_rng(5)
    given = ScanOptions(**WORLDS[world])
    letter = models.letter("E")
    model, poses = PressModel([letter], given), presses(rng, 30)
    spread = [given.placement_mm, given.placement_mm, given.placement_rad, *2 * [given.placement_tilt]]
    spread = np.array(spread + [np.sqrt(np.log1p(given.load_spread**2))] * bool(given.load_spread))
    for off, times in (
        (np.zeros(len(spread)), None),
        (rng.standard_normal(len(spread)), None),
        (rng.standard_normal(len(spread)), 0.4),
    ):
        many = None if times is None else np.full(len(poses), times)
        found = model.linearised("E", poses, np.tile(off, (len(poses), 1)), many)
        load = np.exp(spread[5] * off[5] - spread[5] ** 2 / 2) if given.load_spread else 1.0
        load *= times or 1.0
        press = given.press.model_copy(update={"force": load * given.press.force})
        there = PressModel([letter], given.model_copy(update={"press": press}))
        actual = compose(poses, spread[:3] * off[:3])
        by_hand = there.readings("E", actual, np.tile(spread[3:5] * off[3:5], (len(poses), 1)))
        scale = by_hand.max()
        assert np.quantile(np.abs(found.mean - by_hand).max(axis=1), 0.9) < 3e-3 * scale
        for axis, step in enumerate((1e-3, 1e-3, 1e-4)):
            ends = [
                model.linearised(
                    "E", compose(poses, sign * step * np.eye(3)[axis]), np.tile(off, (len(poses), 1)), many
                )
                for sign in (1, -1)
            ]
            by = (ends[0].mean - ends[1].mean) / (2 * step)
            apart = np.abs(by - found.by_pose[:, axis]).max(axis=1) / np.abs(by).max()
            assert np.median(apart) < 0.005
        for k in range(len(spread)):
            ends = [
                model.linearised("E", poses, np.tile(off + d * np.eye(len(off))[k], (len(poses), 1)), many)
                for d in (1e-2, -1e-2)
            ]
            by = (ends[0].mean - ends[1].mean) / 2e-2
            apart = np.abs(by - found.nuisance[:, k]).max(axis=1) / np.abs(by).max()
            assert np.median(apart) < 0.01, k
        if many is not None:
            ends = [
                model.linearised("E", poses, np.tile(off, (len(poses), 1)), many * np.exp(d))
                for d in (1e-3, -1e-3)
            ]
            by = (ends[0].mean - ends[1].mean) / 2e-3
            apart = np.abs(by - found.nuisance[:, -1]).max(axis=1) / np.abs(by).max()
            assert np.median(apart) < 1e-3


def test_noise_is_that_of_a_taxel_and_its_steps_and_never_none():
    letter = models.letter("I")
    assert PressModel([letter], options()).noise == np.hypot(2.0, 0.7 / np.sqrt(12))
    least = [PressModel([letter], options("ideal", force=force)).noise for force in (1.0, 2.0)]
    assert 0 < least[0] < 0.2
    assert least[1] == pytest.approx(2 * least[0])
