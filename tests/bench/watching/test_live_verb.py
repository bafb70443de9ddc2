"""`bench live` as a user calls it: a hidden object, a pad behind a pty, a recorded session; and what is refused."""

import io
import json
import signal
import time

import numpy as np
import pytest
from command_line import BENCH, emulated, refused
from pty_session import Terminal
from rich.console import Console

from tactsim.bench.watching.live_screen import live
from tactsim.bench.watching.pad_view import PadReader
from tactsim.bench.watching.pressed_source import HiddenObject
from tactsim.bench.watching.recogniser import Recogniser, on_taxels
from tactsim.bench.watching.told import Told, Truth
from tactsim.bench.watching.touch_leader import LiveView, TouchLeader
from tactsim.core import Scan
from tactsim.core.reading import Reading
from tactsim.estimators import create
from tactsim.hardware.recording import Recorder
from tactsim.hardware.session import Plan
from tactsim.models import letter
from tactsim.press import ScanOptions, scan_letters

POSE = (0.0, 4.0, 0.0)
SMALL = ["--estimator", "histogram", "--set", "bins=1000"]


@pytest.fixture
def one_pose(device, scan_file):
    """Let a simulated hand press the letter I at one pose."""
    train = on_taxels(Scan.load(scan_file), device.pad.taxel_xy, "x")
    estimator = create("histogram", bins=1000)
    place = np.array([1.0, 0.5, 0.4])
    hidden = HiddenObject(letter("I"), place, np.array([POSE]), device, 0)
    plan = Plan(label="live", poses=(POSE,), frames=5, window=5, patience=1.0, touch_kpa=10.0)
    leading = TouchLeader(Recogniser.fitted(estimator, train, 0), plan, device.pad, "random", 0, hand=hidden)
    told = Told(leading, train, estimator.maps, hidden, Truth("I", place), from_behind=True)
    return leading, told, PadReader(hidden, device, "here", on_reading=leading.take)


@pytest.fixture
def recording(tmp_path, device, scan_file):
    """Write a session of the letter O: presses of a scan, three readings each, a moment apart."""
    test = Scan.load(scan_file).where("test", "O")
    path = tmp_path / "O.tactrec"
    plan = Plan(label="O", split="test", poses=tuple(map(tuple, test.poses[:4].tolist())), frames=3)
    with Recorder(path) as recorder:
        recorder.segment(
            {"device": device.as_json(), "calibration": None, "plan": plan.model_dump(mode="json")}, 0.0
        )
        for k in range(12):
            recorder.reading(Reading(test.readings[k // 3], 0.01 * k))
            if k % 3 == 2:
                recorder.mark({"number": k // 3, "what": "taken", "first": k - 2, "count": 3}, 0.01 * k)
        recorder.end({}, 0.2)
    return path


@pytest.mark.long
def test_a_shape_of_ones_own_is_learned_and_hidden(here, tmp_path):
    (tmp_path / "bar.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="24mm" height="6mm"><rect width="24mm" height="6mm"/></svg>'
    )
    words = ["--port", "simulated:bar@1,2,0.5", "--readings", "2", "--json", "--shape"]
    said = json.loads(here("live", *words, "bar.svg", *SMALL).stdout.splitlines()[-1])
    assert said["truth"] == "bar"
    assert set(said["probabilities"]) == {*"AEIOU", "bar"}
    refused(here("live", "--port", "simulated:rod", "--shape", "bar.svg"), "unknown letter 'rod'")


@pytest.mark.long
def test_a_hidden_object_is_recognised_as_json(here, scan_file):
    words = ["--port", "simulated:O@2,1,0.3", "--train-scan", scan_file, "--readings", "3", "--json"]
    result = here("live", *words, *SMALL)
    assert result.returncode == 0, result.stderr
    said = [json.loads(line) for line in result.stdout.splitlines()]
    assert [one["touch"] for one in said] == [1, 2, 3]
    last = said[-1]
    assert last["label"] == "O" == last["truth"]
    assert last["right"] is True
    assert sum(last["probabilities"].values()) == pytest.approx(1)
    assert 0 <= last["error_mm"] < 10
    assert len({tuple(one["sensor_in_robot"]) for one in said}) == 3
    assert all(one["delay_ms"] > 0 for one in said)
    assert "3 touches, each known " in result.stderr
    assert all(one["unexplained"] >= 0 for one in said)


@pytest.mark.long
def test_an_object_that_was_not_trained_is_said_to_be_explained_badly(here, tmp_path):
    scan_letters(ScanOptions(letters=("I", "L")))[0].save(tmp_path / "il.npz")
    result = here(
        "live", "--port", "simulated:O@2,1,0.3", "--train-scan", str(tmp_path / "il.npz"), "--readings", "20"
    )
    assert result.returncode == 0, result.stderr
    assert (
        "the touches are explained worse than the training's: lighter presses, another pad" in result.stdout
    )


def test_without_a_terminal_it_says_where_to_press_and_ends_when_every_pose_was_tried(one_pose, capsys):
    """A machine may press the pad, so it must be told where, and that there is nowhere any more."""
    leading, told, reader = one_pose
    console = Console(file=io.StringIO())
    with leading, reader:
        live(reader, told, console, readings=None, as_json=False, page=None)
    assert console.file.getvalue().startswith("touch 1: ")
    assert capsys.readouterr().err.splitlines() == [told.where(LiveView(asked=np.array(POSE)))]


def test_a_recorded_session_is_recognised_in_lines(here, recording, scan_file):
    result = here("live", "--port", f"recording:{recording}", "--train-scan", scan_file, *SMALL)
    assert result.returncode == 0, result.stderr
    *lines, latency = result.stdout.splitlines()
    assert latency.startswith("4 touches, each known ")
    assert [line.split(":")[0] for line in lines] == [f"touch {k}" for k in (1, 2, 3, 4)]
    assert "O " in lines[-1].split(",")[0]
    assert "right" in lines[-1]


@pytest.mark.long
def test_a_pad_on_a_pty_is_recognised_on_a_terminal(bench, here, tmp_path, scan_file, typing):
    with emulated(bench, "--port", "pty:pad", "--letter", "I", "--hold", "1.2", "--lift", "1.6") as name:
        tare = here("tare", "--port", name, "--out", "tare.toml")  # nothing is pressed yet
        assert tare.returncode == 0, tare.stderr
        words = ["live", "--port", name, "--calibration", "tare.toml", "--train-scan", scan_file]
        terminal = typing(
            Terminal([BENCH, *words, "--explore", "random", *SMALL], tmp_path, bench.environment)
        )
        terminal.wait_for("lift the letter")
        terminal.wait_for("touch 1: ")
        terminal.wait_for("touch 2: ")
        terminal.type("r")
        terminal.wait_for("touch 1: ")
        terminal.type("n")
        terminal.wait_for("no touch yet")
    terminal.wait_for(" lost ")
    terminal.type("q")
    last = terminal.end()
    assert terminal.status == 0
    assert "Traceback" not in last


@pytest.mark.long
def test_ctrl_c_ends_it_cleanly(bench, scan_file):
    process = bench.start("live", "--port", "simulated:I", "--train-scan", scan_file, *SMALL)
    assert process.stdout.readline().startswith("touch 1")
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=20)
    assert process.returncode == 0, errors
    assert "Traceback" not in errors


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (["--port", "simulated:?"], ["unknown letter"]),
        (["--port", "simulated:A@1,2"], ["x,y,theta"]),
        (["--port", "x", "--web-port", "80"], ["--web-port", "--web shows"]),
        (["--port", "simulated:A", "--explore", "blind"], ["information or random"]),
        (
            ["--port", "simulated:A", "--explore", "information", "--estimator", "nearest"],
            ["explore at random"],
        ),
    ],
)
def test_mistakes_end_in_one_line(here, words, parts):
    refused(here("live", *words), *parts)


def test_what_does_not_fit_together_is_refused(here, tmp_path, scan_file, device):
    scan = Scan.load(scan_file)
    moved = Scan(scan.readings, scan.poses, scan.labels, scan.split, scan.taxel_xy + 0.7)
    moved.save(tmp_path / "moved.npz")
    refused(
        here("live", "--port", "simulated:I", "--train-scan", "moved.npz"),
        "moved.npz was taken on another pad",
    )
    with Recorder(tmp_path / "all.tactrec") as recorder:
        recorder.segment({"device": device.as_json(), "calibration": None}, 0.0)
        recorder.reading(Reading(np.zeros(36), time.monotonic()))
    refused(
        here("live", "--port", "recording:all.tactrec"), "no recording of a guided session", "bench watch"
    )
