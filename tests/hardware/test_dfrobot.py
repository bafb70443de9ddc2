"""DFRobot's 6x6 sensor behind a real pty: a Modbus slave written from the maker's library, not from the codec."""

import os
import threading
import time
import tty
from contextlib import contextmanager, suppress

import numpy as np
import pytest

from tactsim.core.source import NoReading
from tactsim.hardware.device import load_device
from tactsim.hardware.live import LiveSource

ADDRESS, READ_INPUT, DATA = 1, 4, 7  # DFRobot_TactileSensor.h: INPUTREG_GETDATAS 0x0007, 36 values of 16 bits


def crc(data):
    """The Modbus specification's CRC, bit by bit."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = (value >> 1) ^ (0xA001 if value & 1 else 0)
    return value.to_bytes(2, "little")


class Slave:
    """Answers reads of its input registers, and nothing else; `picture`, (6, 6), is what getDatas gives."""

    def __init__(self, picture, spoil=lambda answer: answer):
        self.picture, self.spoil, self.asked = picture, spoil, []

    def answer(self, request):
        """getDatas fills the picture from its last row on: the first register is the bottom row's first value."""
        body, check = request[:-2], request[-2:]
        address, function, register, count = body[0], body[1], body[2] << 8 | body[3], body[4] << 8 | body[5]
        if crc(body) != check or (address, function) != (ADDRESS, READ_INPUT):
            return b""
        registers = [0] * DATA + [value for row in reversed(self.picture) for value in row]
        data = b"".join(value.to_bytes(2, "big") for value in registers[register : register + count])
        answer = bytes([address, function, len(data)]) + data
        return self.spoil(answer + crc(answer))


@contextmanager
def on_a_pty(slave):
    """Serve the slave on a pty; gives the name that a host opens."""
    master, end = os.openpty()
    tty.setraw(end)
    os.set_blocking(master, False)
    stop = threading.Event()

    def serve():
        heard = b""
        while not stop.wait(0.002):
            with suppress(BlockingIOError):
                heard += os.read(master, 256)
            while len(heard) >= 8:
                slave.asked.append(time.monotonic())
                os.write(master, slave.answer(heard[:8]))
                heard = heard[8:]

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield os.ttyname(end)
    finally:
        stop.set()
        thread.join()
        os.close(master)
        os.close(end)


@pytest.fixture
def picture():
    return np.random.default_rng(0).integers(0, 4096, (6, 6)).tolist()


def test_each_taxel_is_where_the_makers_library_draws_it(picture):
    device = load_device("dfrobot-6x6")
    with on_a_pty(Slave(picture)) as name, LiveSource([name], device) as source:
        readings = [source.read(5.0) for _ in range(5)]
        assert (source.counters.garbage_bytes, source.counters.timeouts) == (0, 0)
    top_down = readings[4].pressures.reshape(6, 6)[::-1]  # the pad's rows run up
    assert np.allclose(top_down, device.codec.kpa_per_count * np.array(picture))
    assert (np.diff(source.taxel_xy.reshape(6, 6, 2)[:, 0, 1]) > 0).all()


def test_it_is_asked_no_more_often_than_it_measures(picture):
    slave = Slave(picture)
    with on_a_pty(slave) as name, LiveSource([name], load_device("dfrobot-6x6")) as source:
        for _ in range(6):
            source.read(5.0)
    # The slave looks every 2 ms and may see one question late and the next in time.
    assert len(slave.asked) <= 2 + (slave.asked[-1] - slave.asked[0]) / 0.05


def test_a_changed_byte_is_no_reading(picture):
    flipped = Slave(picture, lambda answer: answer[:20] + bytes([answer[20] ^ 4]) + answer[21:])
    with (
        on_a_pty(flipped) as name,
        LiveSource([name], load_device("dfrobot-6x6")) as source,
        pytest.raises(NoReading, match="right but for their checksum"),
    ):
        source.read(1.5)
