"""`bench watch` as a user calls it: on a terminal, in a pipe and as a page, on every kind of port."""

import http.client
import itertools
import signal
import socket

import numpy as np
import pytest
from command_line import emulated, refused

from tactsim.core.reading import Reading
from tactsim.hardware.recording import Recorder


@pytest.fixture
def recording(tmp_path, device):
    path = tmp_path / "a.tactrec"
    with Recorder(path) as recorder:
        recorder.segment({"device": device.as_json(), "calibration": None}, 0.0)
        for k in range(20):
            recorder.reading(Reading(np.full(36, float(k)), 0.02 * k))
        recorder.end({}, 0.4)
    return path


@pytest.mark.long
def test_on_a_terminal_the_pad_is_drawn_lost_and_back(bench, on_terminal):
    words = ["--port", "pty:pad", "--letter", "A", "--hold", "1000", "--lift", "0.1"]
    with emulated(bench, *words) as name:
        terminal = on_terminal("watch", "--port", name)
        terminal.wait_for(" live ")
        terminal.wait_for("kPa")
        terminal.press("f")
        terminal.wait_for("FROZEN")
        terminal.press("f")
    terminal.wait_for(" lost ")
    with emulated(bench, *words):
        terminal.wait_for(" live ")
        terminal.press("q")
        assert terminal.ended() == 0
    assert "readings/s" in terminal.said
    assert "reconnects 1" in terminal.said
    assert "Traceback" not in terminal.said
    assert terminal.said.count("\x1b[?1049l") == 1  # the terminal's own screen is back


@pytest.mark.long
def test_in_a_pipe_there_is_a_line_a_second(bench):
    with emulated(bench, "--port", "tcp", "--garbage", "0.2") as name:
        result = bench("watch", "--port", name, "--seconds", "2.5")
    assert result.returncode == 0, result.stderr
    lines = result.stdout.splitlines()
    assert 3 <= len(lines) <= 6
    assert lines[-2].startswith("live, force")
    assert "garbage bytes" in lines[-1]


def test_a_recording_is_played_and_ends(here, recording):
    result = here("watch", "--port", f"recording:{recording}")
    assert result.returncode == 0, result.stderr
    assert "ended" in result.stdout
    assert "20 so far" in result.stdout


def test_the_page_is_served_until_the_command_ends(bench):
    process = bench.start("watch", "--port", "simulated:A", "--web", "--web-port", "0")
    url = process.stdout.readline().strip()
    connection = http.client.HTTPConnection(url.removeprefix("http://").strip("/"), timeout=10)
    connection.request("GET", "/")
    assert "simulated:A" in connection.getresponse().read().decode()
    # The page is served before the first reading: a busy machine takes longer than one line until it is there.
    assert any(line.startswith("live") for line in itertools.islice(process.stdout, 60))
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=20)
    assert process.returncode == 0, errors
    assert errors == ""
    assert "readings/s" in output


def test_a_mistake_ends_in_one_line(here):
    refused(
        here("watch", "--port", "simulated:A", "--seen", "above"),
        "'--seen': unknown word 'above'",
        "behind, front",
    )


def test_a_page_on_a_port_that_is_taken_is_refused(here):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        refused(
            here("watch", "--port", "simulated:A", "--web", "--web-port", port),
            f"127.0.0.1:{port}",
            "--web-port",
        )
