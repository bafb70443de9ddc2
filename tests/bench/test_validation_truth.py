"""Recordings made in worlds whose tilt, layer and wrist are known, and what `bench validate` finds in them."""

import numpy as np
import pytest

from tactsim.bench.config import scan_options
from tactsim.bench.fitted_world import clipped, fitted_world
from tactsim.bench.recorded_presses import PressesAsRecorded
from tactsim.core import Scan
from tactsim.hardware.sensor_fit import fit_sensor
from tactsim.press import ScanOptions, scan_letters


def fitted(stated, *, tilt=0.0, seed=5, every=2, **press):
    """Fit a simulation with the press `stated` to every second training press of E in another world."""
    truth = ScanOptions(letters=("E",), seed=seed, placement_tilt=tilt, press=press)
    whole, _ = scan_letters(truth, cache=False)
    some = np.flatnonzero(whole.split == "train")[::every]
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


@pytest.mark.parametrize(("stiffness", "degrees"), [slow(100.0, 1.0), (1000.0, 0.25), slow(1000.0, 0.5)])
def test_on_a_rigid_wrist_stiffness_times_tilt_is_found_and_nothing_else(stiffness, degrees):
    tilt = float(np.radians(degrees))
    fit, world = fitted(RIGID, tilt=tilt, stiffness=stiffness, **RIGID)
    assert fit.gain * fit.lean == pytest.approx(stiffness * tilt, rel=0.2)
    assert world["placement_tilt"] * world["press"]["stiffness"] == pytest.approx(stiffness * tilt, rel=0.2)
    assert world["press"]["wrist_stiffness"] == "rigid"
    assert fit.stiffness_high == np.inf
    assert fit.placement_mm == pytest.approx(0.1, rel=0.2)


@pytest.mark.parametrize(
    ("stiffness", "degrees"), [slow(100.0, 1.0), slow(1000.0, 0.0), (1000.0, 0.25), slow(10000.0, 0.25)]
)
def test_with_a_known_wrist_the_layer_and_the_tilt_are_found(stiffness, degrees):
    tilt = float(np.radians(degrees))
    fit, world = fitted(SOFT, tilt=tilt, stiffness=stiffness, **SOFT)
    assert fit.held == "wrist"
    assert world["press"]["wrist_stiffness"] == 300.0
    assert world["press"]["stiffness"] == pytest.approx(stiffness, rel=0.2)
    assert world["placement_tilt"] == pytest.approx(tilt, rel=0.2)
    assert fit.yielding_low <= 1.1 * stiffness / 300
    assert stiffness / 300 <= 1.1 * fit.yielding_high
    assert fit.stiffness_high == np.inf


@pytest.mark.slow
def test_with_a_known_layer_the_wrist_is_found_though_a_rigid_one_was_simulated():
    fit, world = fitted(RIGID, tilt=0.0044, stiffness=1000.0, force=2.5, **SOFT)
    assert fit.held == "layer"
    assert world["press"]["stiffness"] == 1000.0
    assert world["press"]["wrist_stiffness"] == pytest.approx(300, rel=0.15)
    assert world["press"]["force"] == pytest.approx(2.5, rel=0.02)
    assert world["placement_tilt"] == pytest.approx(0.0044, rel=0.2)


def test_a_world_that_is_written_is_accepted(tmp_path):
    import dataclasses

    import tomli_w

    fit, _ = fitted(RIGID, every=16, **RIGID)
    wild = dataclasses.replace(
        fit,
        gain_spread=3.0,
        placement_rad=9.0,
        noise=1e9,
        wrist=1e12,
        tilt_offset=np.array([9.0, -9.0]),
        stiffness=1e-9,
    )
    for one in (fit, wild):
        (tmp_path / "world.toml").write_bytes(tomli_w.dumps(fitted_world(ScanOptions(), one, "kPa")).encode())
        options = scan_options(world=str(tmp_path / "world.toml"))
    assert set(clipped(ScanOptions(), wild)) >= {"gain_spread", "placement_rad", "noise", "tilt_y"}
    assert options.sensor.gain_spread == 1
    assert options.press.stiffness == 1
    assert options.press.tilt_y == -0.2
    assert options.press.wrist_stiffness == 1e7
