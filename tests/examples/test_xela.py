"""The example package for XELA's sensors, installed as a user installs it, against a WebSocket server of RFC 6455."""

import base64
import hashlib
import json
import socket
import subprocess
import sys
import threading
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest

import tactsim
from tactsim.core.source import NoReading, SourceError
from tactsim.hardware import sources
from tactsim.hardware.device import load_device
from tactsim.hardware.recorded import Replay
from tactsim.hardware.recording import Recorder

EXAMPLE = Path(tactsim.__file__).parents[1] / "examples" / "xela"
FORCES = np.arange(48.0).reshape(16, 3) / 10  # N: x, y and z of each taxel, from the top left


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    place = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation"]
    # Built from a copy, since setuptools writes beside what it builds.
    copy = tmp_path_factory.mktemp("xela")
    for file in EXAMPLE.iterdir():
        if file.is_file():
            (copy / file.name).write_bytes(file.read_bytes())
    subprocess.run([*command, "--target", place, copy], check=True, timeout=120)
    return place


@pytest.fixture
def installed(site, monkeypatch):
    monkeypatch.syspath_prepend(str(site))
    return load_device(EXAMPLE / "uspa44.toml")


def message(number, forces=FORCES, sensor="1", **more):
    entry = {"model": "uSPa44", "sensor": sensor, "time": 100.0 + number / 10, "taxels": 16}
    if forces is not None:
        entry["calibrated"] = np.ravel(forces).tolist()
    return json.dumps({"message": number, "type": "routine", sensor: entry} | more)


def text_frame(text):
    """RFC 6455, 5.2: final, text, no mask, and the length in 7 bits or in 16."""
    data = text.encode()
    length = bytes([len(data)]) if len(data) < 126 else b"\x7e" + len(data).to_bytes(2, "big")
    return b"\x81" + length + data


@contextmanager
def serving(*conversations):
    """Say one list of messages to each that connects, then hang up; the last one stays. Gives the port."""
    server = socket.create_server(("127.0.0.1", 0))
    stop = threading.Event()

    def serve():
        for number, said in enumerate(conversations):
            with suppress(OSError):
                connection, _ = server.accept()
                with connection:
                    head = b""
                    while not head.endswith(b"\r\n\r\n"):
                        head += connection.recv(4096)
                    (key,) = (
                        line[19:]
                        for line in head.split(b"\r\n")
                        if line.lower().startswith(b"sec-websocket-key: ")
                    )
                    accept = base64.b64encode(
                        hashlib.sha1(key + b"258EAFA5-E914-47DA-95CA-C5AB0DC85B11").digest()
                    )
                    connection.sendall(
                        b"HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                        b"Sec-WebSocket-Accept: " + accept + b"\r\n\r\n"
                    )
                    for text in said:
                        connection.sendall(text_frame(text))
                    if number == len(conversations) - 1:
                        stop.wait()

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield server.getsockname()[1]
    finally:
        stop.set()
        server.shutdown(socket.SHUT_RDWR)
        server.close()
        thread.join()


WELCOME = json.dumps({"message": "Welcome"})


def test_the_normal_forces_become_pressures_from_the_bottom_row_up(installed, tmp_path):
    said = [WELCOME, *(message(number, FORCES + number) for number in range(5, 8))]
    with serving(said) as port, Recorder(tmp_path / "copy") as recorder:
        recorder.segment({"device": installed.as_json()}, 0.0)
        with sources.open_source([f"xela:127.0.0.1:{port}"], installed, log=recorder) as source:
            readings = [source.read(5.0) for _ in range(3)]
            with pytest.raises(NoReading, match="sensor 1 says nothing"):
                source.read(0.1)
            assert (source.counters.strays, source.counters.missed) == (1, 0)
    area = installed.pad.taxel_width * installed.pad.taxel_height  # mm^2
    for number, reading in zip(range(5, 8), readings, strict=True):
        newtons = (FORCES + number)[:, 2].reshape(4, 4)[::-1].ravel()
        assert np.allclose(reading.pressures, newtons / area * 1000)
        assert (reading.index, reading.device_time, reading.after_loss) == (
            number,
            100.0 + number / 10,
            False,
        )
    assert [again.pressures.tolist() for again in Replay(tmp_path / "copy")] == [
        reading.pressures.tolist() for reading in readings
    ]


def test_what_is_no_reading_is_none_and_a_lost_server_is_found_again(installed):
    broken = FORCES.copy()
    broken[3, 2] = np.nan
    first = [
        WELCOME, message(1), "[1, 2", "[]", message(1), message(2, sensor="2"), message(3, broken),
        message(6),
    ]  # fmt: skip
    with (
        serving(first, [WELCOME, message(1)]) as port,
        sources.open_source([f"xela:127.0.0.1:{port}/1"], installed) as source,
    ):
        readings = [source.read(5.0) for _ in range(3)]
    assert [reading.index for reading in readings] == [1, 6, 1]
    assert [reading.after_loss for reading in readings] == [False, False, True]
    counters = source.counters
    assert (counters.repeats, counters.impossible, counters.missed, counters.reconnects) == (1, 1, 3, 1)
    assert counters.garbage_bytes == len("[1, 2") + len("[]")


@pytest.mark.parametrize(
    ("said", "why"),
    [
        (message(1, None), "have xServ.ini calibrate it"),
        (message(1, FORCES[:4]), "has 4 taxels, the device file 16"),
    ],
)
def test_a_sensor_that_is_not_the_device_files_is_named_in_one_line(installed, said, why):
    with (
        serving([said]) as port,
        sources.open_source([f"xela:127.0.0.1:{port}"], installed) as source,
        pytest.raises(SourceError, match=why),
    ):
        source.read(5.0)


def test_a_server_that_is_not_there_is_said_so(installed, monkeypatch):
    import tactsim_xela

    monkeypatch.setattr(tactsim_xela, "_PATIENCE", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    with pytest.raises(SourceError, match=r"no XELA server at .* refused.*Is xela_server running"):
        sources.open_source([f"xela:127.0.0.1:{port}"], installed)
