"""The device files that come along, read from devices behind real ptys that speak as public documents say."""

import os
import struct
import threading
import time
import tty
from contextlib import contextmanager, suppress

import numpy as np
import pytest

from tactsim.core.source import NoReading
from tactsim.hardware.device import built_in_devices, load_device
from tactsim.hardware.live import LiveSource


@contextmanager
def on_a_pty(device):
    """Serve a device on a pty; gives the name that a host opens.

    `device.hear(bytes)` returns the bytes that answer, `device.speak()` those that it says by itself.
    """
    master, end = os.openpty()
    tty.setraw(end)
    os.set_blocking(master, False)
    stop = threading.Event()

    def serve():
        pending = b""
        while not stop.wait(0.002):
            with suppress(BlockingIOError):
                pending += device.hear(os.read(master, 256))
            if not pending:  # a device does not wait: what does not fit is not said
                pending = device.speak()
            with suppress(BlockingIOError):
                pending = pending[os.write(master, pending) :]

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield os.ttyname(end)
    finally:
        stop.set()
        thread.join()
        os.close(master)
        os.close(end)


class Silent:
    """A device that says nothing."""

    def hear(self, data):
        return b""

    def speak(self):
        return b""


class DFRobot(Silent):
    """The Modbus slave of DFRobot_TactileSensor.h: input registers from 0x0007, 16 bits each.

    picture: (rows, columns) counts, what getDatas gives. It fills the picture from its last row on, so the first
    register is the bottom row's first value.
    """

    ADDRESS, READ_INPUT, DATA = 1, 4, 7

    def __init__(self, picture, spoil=lambda answer: answer):
        self.picture, self.spoil, self.asked, self.heard = picture, spoil, [], b""

    def hear(self, data):
        self.heard += data
        answers = b""
        while len(self.heard) >= 8:
            self.asked.append(time.monotonic())
            answers += self.answer(self.heard[:8])
            self.heard = self.heard[8:]
        return answers

    def answer(self, request):
        body, check = request[:-2], request[-2:]
        address, function, register, count = body[0], body[1], body[2] << 8 | body[3], body[4] << 8 | body[5]
        if self.crc(body) != check or (address, function) != (self.ADDRESS, self.READ_INPUT):
            return b""
        registers = [0] * self.DATA + [value for row in reversed(self.picture) for value in row]
        data = b"".join(value.to_bytes(2, "big") for value in registers[register : register + count])
        answer = bytes([address, function, len(data)]) + data
        return self.spoil(answer + self.crc(answer))

    @staticmethod
    def crc(data):
        """The Modbus specification's CRC, bit by bit."""
        value = 0xFFFF
        for byte in data:
            value ^= byte
            for _ in range(8):
                value = (value >> 1) ^ (0xA001 if value & 1 else 0)
        return value.to_bytes(2, "little")


class FlexiTac(Silent):
    """loop() of 32_16_fast.ino: AA 55, then analogRead() >> 2 of each column of each row, at once again."""

    def __init__(self, picture):
        self.picture = picture  # (rows, columns) counts of 10 bits, the first row first

    def speak(self):
        said = bytearray([0xAA, 0x55])
        for row in self.picture:
            for raw in row:
                said.append((raw >> 2) & 0xFF)
        return bytes(said)


class AnySkin(Silent):
    """loop() of 5X_binary_burst_stream.ino: for each chip `struct txyz`, four little-endian floats, then println().

    chips: for each chip t, x, y, z.
    """

    def __init__(self, chips):
        self.chips = chips

    def speak(self):
        return b"".join(struct.pack("<ffff", *chip) for chip in self.chips) + b"\r\n"


def lrc(data):
    """calc_lrc of Read_Single_Sensor_Hand.py: add up, invert, add 1, keep 8 bits."""
    total = 0
    for byte in data:
        total = (total + byte) & 0xFF
    return bytes([((~total) + 1) & 0xFF])


class PaxiniModule(Silent):
    """A GEN3 module on its USB line, as paxini-toolkit's captures have it.

    Question: 55 AA, length 9, address, 0, FB, start (4), count (2), LRC. Answer: AA 55, its bytes less 5 (2),
    address, 0, FB, start (4), count (2), 1, data, LRC. All little-endian. From 0x040E on: x, y, z of each taxel.
    """

    def __init__(self, address, taxels):
        self.address, self.taxels = address, taxels  # [(x, y, z)] in tenths of a newton

    def hear(self, data):
        if (
            data[:2] != b"\x55\xaa"
            or lrc(data[:-1]) != data[-1:]
            or data[4] != self.address
            or data[6] != 0xFB
        ):
            return b""
        start, count = int.from_bytes(data[7:11], "little"), int.from_bytes(data[11:13], "little")
        memory = bytes(0x040E) + b"".join(struct.pack("<bbB", *taxel) for taxel in self.taxels)
        body = bytes([self.address, 0, 0xFB]) + data[7:13] + b"\x01" + memory[start : start + count]
        answer = b"\xaa\x55" + (4 + len(body) + 1 - 5).to_bytes(2, "little") + body
        return answer + lrc(answer)


class PaxiniBoard(Silent):
    """The high-speed board with one module, as orca_core's mock and riverfog7's reference programs have it.

    It sends when register 0x0017 was set to 1; register 0x0016 says what: 1 whole forces, 2 taxels, 3 both.
    """

    def __init__(self, taxels, whole, error=0):
        self.taxels, self.whole, self.error = taxels, whole, error
        self.registers = {0x0016: 1, 0x0017: 0}

    def hear(self, data):
        answers = b""
        while data[:4] == b"\x55\xaa\x00\x10":
            register, count = int.from_bytes(data[4:6], "little"), int.from_bytes(data[6:8], "little")
            whole, data = data[: 9 + count], data[9 + count :]
            if lrc(whole[:-1]) == whole[-1:]:
                self.registers[register] = whole[8]
                answer = b"\xaa\x55\x00\x10" + whole[4:8] + b"\x00"
                answers += answer + lrc(answer)
        return answers

    def speak(self):
        if not self.registers[0x0017]:
            return b""
        data = b""
        if self.registers[0x0016] & 1:  # the low byte of each pair holds the value, the high byte its sign
            x, y, z = self.whole
            data += struct.pack("<hhBb", x, y, z, -1 if z > 127 else 0)
        if self.registers[0x0016] & 2:
            data += b"".join(struct.pack("<bbB", *taxel) for taxel in self.taxels)
        frame = b"\xaa\x56\x00" + (1 + len(data)).to_bytes(2, "little") + bytes([self.error]) + data
        return frame + lrc(frame)


class Arduino(Silent):
    """The sketch of docs/your-pad.md: millis(), the counts of the rows from the top down, "*" and the XOR of it all."""

    def __init__(self, picture):
        self.picture, self.millis = picture, 0

    def speak(self):
        self.millis += 10
        line = str(self.millis)
        for row in self.picture:
            for count in row:
                line += "," + str(count)
        check = 0
        for letter in line:
            check ^= ord(letter)
        return f"{line}*{check:02x}\r\n".encode()


OWN = {"emulated", "singletact-5x5"}  # tested beside their codecs


def at_once(name):
    """A device file without the time that an Arduino takes to start."""
    return load_device(name).model_copy(update={"settle": 0.0})


def rows_up(picture):
    """The pad's rows run up; a picture's run down."""
    return np.array(picture, dtype=float)[::-1].ravel()


def picture(rows, columns, most, seed=0):
    return np.random.default_rng(seed).integers(0, most, (rows, columns)).tolist()


def three_axes(count, seed=0):
    rng = np.random.default_rng(seed)
    return [
        (int(rng.integers(-128, 128)), int(rng.integers(-128, 128)), int(rng.integers(0, 256)))
        for _ in range(count)
    ]


SIX, EIGHT = picture(6, 6, 4096), picture(4, 8, 4096)
FORCES = three_axes(9)
SKIN = [(20.0 + k, 1.5 * k, -2.5 * k, 100.25 * (k + 1)) for k in range(5)]  # t, x, y, z of each chip
FULL, SHORT = picture(16, 32, 1024, 3), picture(12, 32, 1024, 4)
PRINTED = picture(4, 4, 1024)
DEVICES = {
    "dfrobot-6x6": (DFRobot(SIX), rows_up(SIX)),
    "dfrobot-4x8": (DFRobot(EIGHT), rows_up(EIGHT)),
    "flexitac-16x32": (FlexiTac(FULL), rows_up(FULL) // 4),
    "flexitac-12x32": (FlexiTac(SHORT), rows_up(SHORT) // 4),
    "anyskin": (AnySkin(SKIN), [SKIN[chip][3] for chip in (1, 0, 2)]),
    "paxini-m2020": (PaxiniModule(1, FORCES), [z for _, _, z in FORCES]),
    "paxini-m2020-board": (PaxiniBoard(FORCES, (-30, 40, 200)), [z for _, _, z in FORCES]),
    "arduino-csv": (Arduino(PRINTED), rows_up(PRINTED)),
}


def test_every_device_file_that_comes_along_is_read_from_its_device():
    assert set(built_in_devices()) == set(DEVICES) | OWN


@pytest.mark.parametrize("name", DEVICES)
def test_each_taxel_is_read_where_its_document_puts_it(name):
    speaker, counts = DEVICES[name]
    device = at_once(name)
    with on_a_pty(speaker) as url, LiveSource([url], device) as source:
        readings = [source.read(5.0) for _ in range(5)]
        counters = source.counters
        assert (counters.bad_checksums, counters.timeouts, counters.torn) == (0, 0, 0)
        # What was on its way when the port was opened, and answers to the command that starts a device.
        assert counters.garbage_bytes <= device.codec.build().longest + 100
    for reading in readings:
        assert np.array_equal(reading.pressures, device.codec.kpa_per_count * np.asarray(counts))
    assert (np.diff(source.taxel_xy.reshape(device.pad.rows, -1, 2)[:, 0, 1]) > 0).all()


def test_the_arduinos_clock_is_read():
    with on_a_pty(Arduino(PRINTED)) as url, LiveSource([url], at_once("arduino-csv")) as source:
        times = [source.read(5.0).device_time for _ in range(5)]
    assert np.allclose(np.diff(times), 0.01)


def test_a_device_is_asked_no_more_often_than_it_measures():
    slave = DFRobot(SIX)
    with on_a_pty(slave) as url, LiveSource([url], at_once("dfrobot-6x6")) as source:
        for _ in range(6):
            source.read(5.0)
    # The slave looks every 2 ms and may see one question late and the next in time.
    assert len(slave.asked) <= 2 + (slave.asked[-1] - slave.asked[0]) / 0.05


@pytest.mark.parametrize(
    ("name", "speaker", "said"),
    [
        ("dfrobot-6x6", DFRobot(SIX, lambda answer: answer[:20] + bytes([answer[20] ^ 4]) + answer[21:]),
         "right but for their checksum"),
        ("paxini-m2020-board", PaxiniBoard(FORCES, (0, 0, 0), error=7),
         "no whole frame .* comes, and not what is stated to follow it"),
        ("paxini-m2020", PaxiniModule(2, FORCES), "not one byte came"),
        ("anyskin", AnySkin([(20.0, 0.0, 0.0, float("nan"))] * 5), "no whole frame"),
    ],
)  # fmt: skip
def test_what_is_not_the_device_or_says_an_error_is_no_reading(name, speaker, said):
    with (
        on_a_pty(speaker) as url,
        LiveSource([url], at_once(name)) as source,
        pytest.raises(NoReading, match=said),
    ):
        source.read(1.0)
