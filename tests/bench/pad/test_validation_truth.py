"""Recordings made in worlds whose tilt, layer and wrist are known, and what `bench validate` finds in them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import tomli_w

from tactsim import models
from tactsim.bench.cli.cmd_validate import verdict
from tactsim.bench.config import scan_options
from tactsim.bench.pad.validation import (
    PressesAsRecorded,
    clipped,
    fitted_world,
    means,
    numbers_of_copies,
    stated_world,
    wider,
)
from tactsim.core import Pad, Scan
from tactsim.hardware.sensor_fit import fit_sensor
from tactsim.press import ScanOptions, scan_letters


def fitted(stated, *, tilt=0.0, seed=5, angles=12, **press):
    """Fit a simulation with the press `stated` to every second training press of E in another world."""
    truth = ScanOptions(letters=("E",), seed=seed, placement_tilt=tilt, press=press)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tactsim.press.scan_poses.ANGLES", angles)
        whole, _ = scan_letters(truth, cache=False)
    some = np.flatnonzero(whole.split == "train")[::2]
    recorded = Scan(
        whole.readings[some], whole.poses[some], whole.labels[some], whole.split[some], whole.taxel_xy
    )
    options = ScanOptions(letters=("E",), placement_tilt=0.0, press=stated)
    simulated = Scan(
        recorded.readings, recorded.poses, recorded.labels, recorded.split, recorded.taxel_xy,
        {"options": options.model_dump(mode="json")},
    )  # fmt: skip
    simulator = PressesAsRecorded(simulated, recorded)
    fit = fit_sensor(recorded.readings, simulator, simulator.stated, simulator.bending())
    return fit, fitted_world(options, fit, "kPa")


RIGID, SOFT = {"wrist_stiffness": None}, {"wrist_stiffness": 300.0}


def slow(*values):
    return pytest.param(*values, marks=pytest.mark.slow)


@pytest.mark.long
@pytest.mark.parametrize(
    ("stated", "stiffness"), [(RIGID, 10000.0), (SOFT, 100.0), slow(RIGID, 100.0), slow(SOFT, 10000.0)]
)
def test_a_level_world_is_not_taken_for_a_tilted_one(stated, stiffness):
    fit, world = fitted(stated, stiffness=stiffness, **RIGID)
    assert not fit.tilts.any()
    assert world["placement_tilt"] == 0
    assert world["press"]["wrist_stiffness"] == "rigid"
    assert fit.stiffness == 1000.0
    assert (fit.stiffness_low, fit.stiffness_high) == (0, np.inf)
    assert fit.placement_mm == pytest.approx(0.1, rel=0.15)
    assert fit.psf_sigma == pytest.approx(1.0, abs=0.03)


# Half of the presses are enough by default.
@pytest.mark.long
@pytest.mark.parametrize(
    ("stiffness", "degrees", "angles"), [slow(100.0, 1.0, 12), (1000.0, 0.25, 6), slow(1000.0, 0.5, 12)]
)
def test_on_a_rigid_wrist_stiffness_times_tilt_is_found_and_nothing_else(stiffness, degrees, angles):
    tilt = float(np.radians(degrees))
    fit, world = fitted(RIGID, tilt=tilt, angles=angles, stiffness=stiffness, **RIGID)
    assert fit.gain * fit.lean == pytest.approx(stiffness * tilt, rel=0.2)
    assert world["placement_tilt"] * world["press"]["stiffness"] == pytest.approx(stiffness * tilt, rel=0.2)
    assert world["press"]["wrist_stiffness"] == "rigid"
    assert fit.stiffness_high == np.inf
    assert fit.placement_mm == pytest.approx(0.1, rel=0.2)


@pytest.mark.long
@pytest.mark.parametrize(
    ("stiffness", "degrees", "angles"),
    [slow(100.0, 1.0, 12), slow(1000.0, 0.0, 12), (1000.0, 0.25, 6), slow(10000.0, 0.25, 12)],
)
def test_with_a_known_wrist_the_layer_and_the_tilt_are_found(stiffness, degrees, angles):
    tilt = float(np.radians(degrees))
    fit, world = fitted(SOFT, tilt=tilt, angles=angles, stiffness=stiffness, **SOFT)
    assert fit.held == "wrist"
    assert world["press"]["wrist_stiffness"] == 300.0
    assert world["press"]["stiffness"] == pytest.approx(stiffness, rel=0.2)
    assert world["placement_tilt"] == pytest.approx(tilt, rel=0.2)
    assert fit.yielding_low <= 1.1 * stiffness / 300
    assert stiffness / 300 <= 1.1 * fit.yielding_high
    assert fit.stiffness_high == np.inf


@pytest.mark.long
def test_outlines_that_are_not_as_drawn_are_found_and_bend_no_response():
    """Without numbers of their own, wider outlines pass for a response that is less steep, and for other places."""
    options = ScanOptions(letters=("A", "E"), placement_tilt=0.0, press=RIGID)
    scan, _ = scan_letters(options, cache=False)
    train = np.flatnonzero(scan.split == "train")[::8]
    few = Scan(scan.readings[train], scan.poses[train], scan.labels[train], scan.split[train], scan.taxel_xy)
    presses = PressesAsRecorded(replace(few, meta={"options": options.model_dump(mode="json")}), few)
    rng = np.random.default_rng(2)
    errors = np.zeros((len(few), 5))
    errors[:, :2] = 0.3 * rng.standard_normal((len(few), 2))
    image = presses(replace(presses.stated, grown=(0.4, -0.3)), errors)
    recorded = 20 * (image / 20) ** 0.7 + 0.3 * rng.standard_normal(image.shape)
    free, held = (
        fit_sensor(recorded, presses, presses.stated, presses.bending(), None, outline)
        for outline in (presses.outline, None)
    )
    assert free.grown == pytest.approx((0.4, -0.3), abs=0.05)
    assert all(low < by < high for by, (low, high) in zip((0.4, -0.3), free.grown_range, strict=True))
    assert free.response == pytest.approx(0.7, abs=0.03)
    assert free.psf_sigma == pytest.approx(1.0, abs=0.05)
    assert free.placement_mm == pytest.approx(0.3, rel=0.25)
    assert free.misfit < 0.8 * held.misfit
    assert held.grown == ()


def test_an_outline_is_moved_by_what_is_asked_and_never_away():
    letter = models.letter("I")
    x, y, right, top = letter.footprint.bounds()
    assert wider(letter, 0.5).footprint.bounds() == pytest.approx((x - 0.5, y - 0.5, right + 0.5, top + 0.5))
    assert wider(letter, -9.0).footprint.area() > 0.25 * letter.footprint.area()


@pytest.mark.parametrize("pad", [Pad(), Pad(rows=16, columns=13, seam=None, unread_columns=2)])
@pytest.mark.parametrize("press", [RIGID, {**SOFT, "stiffness": 50.0}])
@pytest.mark.parametrize("unit", ["kPa", "count"])
def test_a_world_is_read_as_it_was_simulated(tmp_path, pad, press, unit):
    options = ScanOptions(letters=("E",), pad=pad, press=press)
    (tmp_path / "world.toml").write_bytes(tomli_w.dumps(stated_world(options, unit)).encode())
    again = scan_options(world=str(tmp_path / "world.toml"))
    assert again == options.model_copy(update={"unit": unit})


@pytest.mark.parametrize(
    ("misfit", "noise", "steady", "said"),
    [
        (1.1, 1.0, 0.5, "1.1 times the noise, so the intervals below hold"),
        (1.1, 1.0, None, "so the intervals below hold"),
        (1.3, 1.0, 0.5, "1.3 times the noise: the intervals below"),
        (0.75, 0.7, 0.03, "the zero moved, and the intervals below"),
        (0.2, 0.0, None, "there is no noise: the intervals below"),
    ],
)
def test_the_verdict_says_where_intervals_are_too_narrow(misfit, noise, steady, said):
    errors = {
        name: SimpleNamespace(relative=share)
        for name, share in (("as_it_is", 0.5), ("held_out_placed", 0.07))
    }
    sides = {"simulated": {"accuracy": [0.5, 0.6]}, "recorded": {"accuracy": [0.75, 1.0]}}
    result = SimpleNamespace(
        errors=errors, recognition={"refined": sides}, fit=SimpleNamespace(misfit=misfit, noise=noise), steady=steady,
        unit="kPa",
    )  # fmt: skip
    near, worth, doubt = verdict(result)
    assert "7 % of the contact as fitted, by 50 % as simulated" in near
    assert "refined is right after 2 touches" in worth
    assert "simulated 0.60, recorded 1.00" in worth
    assert said in doubt
    assert ("too narrow" in doubt) == ("so the" not in said)


def test_near_copies_of_a_press_are_averaged_and_no_others():
    """Of one label and one stated pose, each group about its first press; a lighter press is a copy, too."""
    rng = np.random.default_rng(4)
    pictures = rng.uniform(0, 100, (3, 30))
    kinds = np.array([0, 1, 0, 0, 2, 1, 2, 0])
    labels = np.array(["A", "A", "A", "A", "A", "A", "B", "A"])
    poses = np.zeros((8, 3))
    poses[7, 0] = 0.1
    readings = pictures[kinds] * rng.uniform(0.8, 1.2, (8, 1)) + rng.normal(0, 0.2, (8, 30))
    scan = Scan(readings, poses, labels, np.full(8, "train"), np.zeros((30, 2)))
    copies = numbers_of_copies(scan)
    assert copies.tolist() == [0, 1, 0, 0, 2, 1, 3, 4]
    averaged = means(scan, copies)
    assert np.allclose(averaged.readings[0], readings[[0, 2, 3]].mean(axis=0))
    assert averaged.labels.tolist() == ["A", "A", "A", "B", "A"]
    assert np.array_equal(averaged.poses, poses[[0, 1, 4, 6, 7]])


def test_a_world_that_is_written_is_accepted(tmp_path):
    import dataclasses

    fit, _ = fitted(RIGID, angles=2, **RIGID)
    wild = dataclasses.replace(
        fit, gain_spread=3.0, placement_rad=9.0, noise=1e9, wrist=1e12, tilt_offset=np.array([9.0, -9.0]),
        stiffness=1e-9,
    )  # fmt: skip
    for one in (fit, wild):
        (tmp_path / "world.toml").write_bytes(tomli_w.dumps(fitted_world(ScanOptions(), one, "kPa")).encode())
        options = scan_options(world=str(tmp_path / "world.toml"))
    assert set(clipped(ScanOptions(), wild)) >= {"gain_spread", "placement_rad", "noise", "tilt_y"}
    assert options.sensor.gain_spread == 1
