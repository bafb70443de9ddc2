"""A robot presses an emulated pad by a plan: what is recorded is what was pressed, where and when the marks say."""

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from command_line import refused
from made_pads import counting_array, ramp

from tactsim import models
from tactsim.core import Scan
from tactsim.core.poses import compose
from tactsim.hardware.emulator import emulate
from tactsim.hardware.emulator.hand import SHARES, Timing, read_plan, record
from tactsim.press import ScanOptions
from tactsim.press.scanning import object_facts
from tactsim.press.simulated_source import press_table, rising_table

TEE = (
    '<svg xmlns="http://www.w3.org/2000/svg" width="44mm" height="36mm" viewBox="0 0 44 36">'
    '<path d="M0 0H44V9H26V36H17V9H0z"/></svg>'
)
PLAN = "label,split,x_mm,y_mm,theta_rad\ntee,train,0,0,0\ntee,test,3.5,-2,1.2\nO,train,4,4,0\n"
EXACT = (
    "placement_mm=0", "placement_rad=0", "placement_tilt=0", "sensor.noise=0", "press.force=25",
    "press.wrist_stiffness=rigid",
)  # fmt: skip
FAST = ("--rate", "20", "--hold", "0.5", "--lift", "0.3")


@pytest.fixture
def own(here):
    """Write the files of an array, a shape and a plan, and return a function that records the plan."""
    for name, text in (("array.toml", counting_array(16)), ("tee.svg", TEE), ("plan.csv", PLAN)):
        (Path(name)).write_text(text)

    def record(*words, settings=EXACT, out="array.csv"):
        given = [word for setting in settings for word in ("--scan-set", setting)]
        return here(
            "emulate", "--device", "array.toml", "--plan", "plan.csv", "--shape", "tee.svg", "--out", out,
            "--marks", "marks.csv", *FAST, *given, *words,
        )  # fmt: skip

    return record


def scan_of(here, recording="array.csv", *words):
    """Replay the presses at their whole load."""
    result = here(
        "replay", recording, "--device", "array.toml", "--marks", "marks.csv", "--scan", "a.npz",
        "--moments", "off", *words,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    return Scan.load(Path("a.npz"))


def test_what_is_recorded_is_what_was_pressed(here, own):
    curve = ("sensor.response=0.5", "sensor.response_pressure=40000")
    result = own("--jitter", "0.9", settings=(*EXACT, *curve))
    assert result.returncode == 0, result.stderr
    scan = scan_of(here)
    assert scan.labels.tolist() == ["tee", "tee", "O"]
    assert scan.split.tolist() == ["train", "test", "train"]
    assert scan.meta["unit"] == "count"
    np.testing.assert_array_equal(scan.poses, [[0, 0, 0], [3.5, -2, 1.2], [4, 4, 0]])
    # Without noise all frames under the full load count the same.
    np.testing.assert_allclose(scan.readings, np.round(scan.readings), atol=1e-9)
    pressed = (scan.readings / 200) ** 2  # kPa: the curve is sqrt(40000 p) = 200 sqrt(p)
    force = pressed.sum(axis=1) * 3.8**2 * 1e-3  # N, each taxel standing for its share of the pad
    # A part of the load lies beyond the taxels: the point spread smears it over the rim, and the shape may reach there.
    assert (np.abs(force - 25) < 2.5).all()
    # The force's middle is the shape's centre of area, seen from the pad.
    middle = (pressed[:, :, None] * scan.taxel_xy).sum(axis=1) / pressed.sum(axis=1)[:, None]
    placed = np.column_stack([middle, np.zeros(3)])
    np.testing.assert_allclose(compose(scan.poses, placed)[:, :2], 0, atol=0.5)


def test_both_kinds_of_file_hold_the_same(here, own):
    assert own().returncode == 0
    first = scan_of(here)
    Path("marks.csv").unlink()
    Path("a.npz").unlink()
    assert own(out="array.tactrec").returncode == 0
    again = scan_of(here, "array.tactrec")
    np.testing.assert_array_equal(again.readings, first.readings)
    assert again.meta["unit"] == "count"


def test_a_shape_says_what_scores_need(here, own):
    assert own().returncode == 0
    facts = scan_of(here, "array.csv", "--shape", "tee.svg", "--letters", "O").meta["objects"]
    assert facts["tee"] == object_facts(models.shape("tee.svg"))
    assert facts["O"]["symmetry"] == 0
    (Path("bar.svg")).write_text(TEE)
    words = ("replay", "array.csv", "--device", "array.toml", "--marks", "marks.csv", "--scan", "b.npz")
    refused(here(*words, "--shape", "bar.svg"), "no reading is of the shape 'bar'", "tee, O")
    (Path("O.svg")).write_text(TEE)
    refused(here(*words, "--shape", "O.svg", "--letters", "O"), "'O' is a shape and")


@pytest.mark.parametrize(
    ("plan", "parts"),
    [
        ("label,x_mm,y_mm,theta_rad\n", ("holds no presses", "label, x_mm")),
        ("label,x_mm,y_mm,theta_rad\ntee,1,inf,0\n", ("plan.csv, line 2", "y_mm")),
    ],
)
def test_a_wrong_plan_is_refused(here, own, plan, parts):
    (Path("plan.csv")).write_text(plan)
    refused(own(), *parts)
    assert not (Path("array.csv")).exists()


def test_the_timetable_is_that_of_the_presses(tmp_path):
    (tmp_path / "plan.csv").write_text(PLAN)
    timing = Timing(hold=1.0, lift=0.5, ramp=0.1)
    table = np.array([1.0, 2.0, 3.0])[:, None, None] * np.array(SHARES)[:, None]
    pressing = timing.pressing(table)
    course = np.array([pressing(now)[0] for now in np.arange(0, 6, 0.01)])
    for number, mark in enumerate(timing.intervals(read_plan(tmp_path / "plan.csv"))):
        inside = course[round(100 * mark.first_s) + 2 : round(100 * mark.last_s) - 1]
        np.testing.assert_array_equal(inside, number + 1.0)
    assert course[-1] == 0
    assert json.loads(read_plan(tmp_path / "plan.csv")[1].model_dump_json())["x_mm"] == 3.5


def test_on_its_way_a_press_feels_what_a_lighter_press_there_feels():
    """A tilted pad touches on one side first: its light images are no thinned ones of the full load."""
    words = {"placement_tilt": 0.02, "press": {"wrist_stiffness": "rigid"}}
    poses = np.array([[0.0, 0.0, 0.3], [2.0, -1.0, 1.0]])
    rising = rising_table("O", poses, ScanOptions(**words), np.random.default_rng(3), SHARES)
    for number, share in enumerate(SHARES):
        words["press"]["force"] = 2 * share
        alone = press_table("O", poses, ScanOptions(**words), np.random.default_rng(3))
        np.testing.assert_allclose(rising[:, number], alone, atol=1e-9)
    assert np.abs(rising[:, 1] - rising[:, 3] / 2).max() > 0.1 * rising.max()
    timing = Timing(hold=1.0, lift=0.5, ramp=0.4)
    pressing = timing.pressing(rising)
    np.testing.assert_allclose(pressing(0.5 + 0.2), rising[0, 1])
    np.testing.assert_allclose(pressing(timing.period + 0.5 + 0.35), (rising[1, 2] + rising[1, 3]) / 2)
    np.testing.assert_allclose(pressing(timing.period + 0.4 / 8 + 0.5), rising[1, 0] / 2)


@pytest.mark.parametrize("rate", [100.0, 141.0])
def test_a_recording_has_one_frame_at_each_of_its_moments(rate, paper_pad):
    """However multiples of the period are rounded."""
    at = Counter()
    record(emulate(paper_pad, ramp(paper_pad), rate), 4.0, lambda message, now: at.update([now]))
    assert len(at) == round(4.0 * rate)
    assert set(at.values()) == {len(paper_pad.part)}
