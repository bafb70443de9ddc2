"""From a recording of an unknown pad to trials: what the harness says beside the truth."""

import json
from pathlib import Path

import numpy as np
import pytest
from made_pads import counting_array
from matplotlib.path import Path as Ring

from tactsim import models
from tactsim.core import Scan
from tactsim.core.poses import transform

OUTLINES = {
    "bracket": (34, 40, "M0 0H34V9H9V40H0z"),
    "tee": (44, 36, "M0 0H44V9H26V36H17V9H0z"),
    "zed": (44, 36, "M0 0H27V27H44V36H17V9H0z"),
}
# The truth: a bent curve in counts, gains 10 % apart, loads as those of 50 to 150 %, misplaced and tilted presses.
TRUTH = """placement_mm = 0.4
placement_rad = 0.01
placement_tilt = 0.004
load_spread = 0.29
[press]
force = 8
stiffness = 100
thickness = 3
wrist_stiffness = "rigid"
[sensor]
psf_sigma = 2.0
gain_spread = 0.1
response = 0.5
response_pressure = 40000
noise = 30
"""
SHAPES = tuple(word for name in OUTLINES for word in ("--shape", f"{name}.svg"))


@pytest.fixture
def chain(here):
    """Write the files of the pad, its truth and the shapes; return functions that record and that replay."""
    for name, (width, height, path) in OUTLINES.items():
        Path(f"{name}.svg").write_text(
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{height}mm" '
            f'viewBox="0 0 {width} {height}"><path d="{path}"/></svg>'
        )
    Path("device.toml").write_text(counting_array(6))
    Path("truth.toml").write_text(TRUTH)

    def record(presses):
        """Press `presses` (label, split, x, y, theta) and record them."""
        lines = ["label,split,x_mm,y_mm,theta_rad", *(",".join(map(str, press)) for press in presses)]
        Path("plan.csv").write_text("\n".join(lines))
        result = here(
            "emulate", "--device", "device.toml", "--plan", "plan.csv", "--out", "pad.csv", "--marks", "marks.csv",
            "--world", "truth.toml", "--rate", "20", "--hold", "0.3", "--lift", "0.3", *SHAPES,
        )  # fmt: skip
        assert result.returncode == 0, result.stderr

    def replay(*words, out="small.npz"):
        return here(
            "replay", "pad.csv", "--device", "device.toml", "--marks", "marks.csv", "--scan", out, *words
        )

    return record, replay


def plan(presses, seed=0):
    """Draw presses of each shape at random poses, every other one for tests."""
    rng = np.random.default_rng(seed)
    return [
        (name, "test" if number % 2 else "train", *rng.uniform((-16, -16, 0), (16, 16, 6.28)).round(2))
        for name in OUTLINES
        for number in range(presses)
    ]


def test_pressed_places_are_where_the_shapes_are(chain):
    """What is felt lies on the shape, by the poses of the marks: nothing is mirrored, turned or shifted on the way."""
    record, replay = chain
    record(plan(12))
    assert replay().returncode == 0
    scan = Scan.load("small.npz")
    assert scan.meta["unit"] == "count"
    for name in OUTLINES:
        of = scan.where(label=name)
        places = transform(of.poses, scan.taxel_xy)
        footprint = models.shape(f"{name}.svg").footprint
        inside = footprint.offset(-2.5, 2).to_polygons(), footprint.offset(4.0, 2).to_polygons()
        deep, near = (
            np.logical_xor.reduce([Ring(ring).contains_points(places.reshape(-1, 2)) for ring in rings])
            for rings in inside
        )
        readings = of.readings.reshape(-1)
        assert np.median(readings[deep]) > 400
        assert np.median(np.abs(readings[~near])) < 60  # twice the noise of a mean of few frames, in counts


@pytest.mark.slow
def test_a_large_array_is_recognised_with_no_option_given(here, chain):
    """A 16x16 array in counts, bent, of twice the paper's pitch, under loads that vary: estimators keep their order."""
    record, replay = chain
    Path("device.toml").write_text(counting_array(16))
    Path("truth.toml").write_text(TRUTH.replace("force = 8", "force = 25"))
    rng = np.random.default_rng(1)
    record([
        (name, "test" if number % 2 else "train", *rng.uniform((-8, -8, 0), (8, 8, 6.28)).round(2))
        for name in OUTLINES for number in range(20)
    ])  # fmt: skip
    assert replay("--cut", "6x6", "--stride", "3", *SHAPES, out="touches.npz").returncode == 0
    right = {}
    asked = {name: ("--estimator", name) for name in ("refined", "histogram")}
    asked["histogram"] += ("--bins", "1000")
    for name, option in ({"default": ()} | asked).items():
        words = ("--scan", "touches.npz", *option, "--trials", "60", "--readings", "5", "--json")
        result = here("run", *words)
        assert result.returncode == 0, result.stderr
        found = json.loads(result.stdout)
        right[name] = found["accuracy"]
        if name != "histogram":  # also where a press gives many windows, which share its errors
            assert found["coverage_90"][4] > 0.85, name
            assert right[name][4] >= 0.95
    assert sum(right["default"]) > sum(right["refined"]) > sum(right["histogram"])
    said = json.loads(here("fit", "touches.npz", "--json").stdout)
    assert said["response_exponent"] == 2  # undoes the truth's root
    assert said["unit"] == "count"
    assert said["length_ratio"] == pytest.approx(3.8 / 1.9)
    assert 25 < said["chosen"]["threshold"] < 500  # within the noise and half of what a covered taxel reads
