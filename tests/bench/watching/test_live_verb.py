"""`bench live` as a user calls it: a hidden object, a pad behind a pty; and what is refused."""

import json
import signal
from dataclasses import replace

import pytest
from command_line import emulated, refused

from tactsim.core import Scan

SMALL = ["--estimator", "histogram", "--set", "bins=1000"]


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


def test_a_hidden_object_is_recognised_in_lines(here, scan_file):
    result = here(
        "live", "--port", "simulated:O@2,1,0.3", "--train-scan", scan_file, "--readings", "2", *SMALL
    )
    assert result.returncode == 0, result.stderr
    *lines, latency = result.stdout.splitlines()
    assert latency.startswith("2 touches, each known ")
    assert [line.split(":")[0] for line in lines] == ["touch 1", "touch 2"]
    assert "right" in lines[-1] or "wrong: it is O" in lines[-1]


@pytest.mark.long
def test_a_pad_on_a_pty_is_recognised_on_a_terminal(bench, here, scan_file, on_terminal):
    with emulated(bench, "--port", "pty:pad", "--letter", "I", "--hold", "1.2", "--lift", "1.6") as name:
        tare = here("tare", "--port", name, "--out", "tare.toml")  # nothing is pressed yet
        assert tare.returncode == 0, tare.stderr
        words = ["live", "--port", name, "--calibration", "tare.toml", "--train-scan", scan_file]
        terminal = on_terminal(*words, "--explore", "random", *SMALL)
        terminal.wait_for("lift it off")
        terminal.wait_for("touch 1: ")
        terminal.wait_for("touch 2: ")
        terminal.press("r")
        terminal.wait_for("touch 1: ")
        terminal.press("n")
        terminal.wait_for("no touch yet")
    terminal.wait_for(" lost ")
    terminal.press("q")
    assert terminal.ended() == 0
    assert "Traceback" not in terminal.said


@pytest.mark.long
def test_ctrl_c_ends_it_cleanly(bench, scan_file):
    process = bench.start("live", "--port", "simulated:I", "--train-scan", scan_file, *SMALL)
    assert process.stdout.readline().startswith("touch 1")
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=20)
    assert process.returncode == 0, errors
    assert "Traceback" not in errors


@pytest.mark.long
def test_a_pad_without_a_calibration_is_said_to_lack_it(bench, scan_file):
    with emulated(bench, "--port", "pty:pad", "--letter", "I") as name:
        process = bench.start("live", "--port", name, "--train-scan", scan_file, *SMALL)
        assert any("no --calibration: " in line and "`bench tare`" in line for line in process.stderr)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=20)


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (["--port", "simulated:A@1,2"], ["x,y,theta"]),
        (["--port", "x", "--web-port", "80"], ["--web-port", "--web shows"]),
        (
            ["--port", "simulated:A", "--explore", "information", "--estimator", "nearest"],
            ["explore at random"],
        ),
    ],
)
def test_mistakes_end_in_one_line(here, words, parts):
    refused(here("live", *words), *parts)


def test_what_does_not_fit_together_is_refused(here, tmp_path, scan_file):
    scan = Scan.load(scan_file)
    moved = Scan(scan.readings, scan.poses, scan.labels, scan.split, scan.taxel_xy + 0.7)
    moved.save(tmp_path / "moved.npz")
    refused(
        here("live", "--port", "simulated:I", "--train-scan", "moved.npz"),
        "moved.npz was taken on another pad",
    )
    replace(scan, meta={**scan.meta, "unit": "count"}).save(tmp_path / "counts.npz")
    refused(
        here("live", "--port", "simulated:I", "--train-scan", "counts.npz"), "in count, the pad reads kPa"
    )
    refused(here("live", "--port", "recording:all.tactrec"), "cannot be asked for more", "bench watch")


@pytest.mark.parametrize("estimator", ["stacked", "histogram"])
def test_where_nobody_knows_poses_no_place_is_said(here, tmp_path, scan_file, estimator):
    scan = Scan.load(scan_file).of_letters(("I", "O"))
    unknown = replace(scan, poses=0 * scan.poses, meta={**scan.meta, "poses": "unknown"})
    unknown.save(tmp_path / "unknown.npz")
    words = ["live", "--port", "simulated:O", "--train-scan", "unknown.npz", "--estimator", estimator]
    result = here(*words, "--readings", "1", "--json")
    assert result.returncode == 0, result.stderr
    assert "press all of the object" in result.stderr
    (said,) = (json.loads(line) for line in result.stdout.splitlines())
    assert said["within_mm"] is None
    assert said["error_mm"] is None
