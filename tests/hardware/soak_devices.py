"""Two devices of the soak test, written from docs/hardware.md and the sensor's public documents, not from the codecs.

What a device measures at one of its moments (0, 1, 2, ...) says which it is, and every other value is a hash of it. So
whoever reads it can tell whether all values are of one moment. Every fault that the device makes is counted.
"""

import json
import os
import random
import select
import socket
import struct
import time
import tty
from pathlib import Path

MIX = 0x9E3779B97F4A7C15
ROWS = COLUMNS = (
    6  # the pad of the two 6x4 arrays; of the left one the first column is not read, of the right the last
)
SINGLETACT_TAXELS = 25


def hashed(moment, taxel, bits):
    value = (moment * 0xD1342543DE82EF95 + taxel * MIX + 0x632BE59BD9B4E019) & (2**64 - 1)
    value ^= value >> 29
    value = value * 0xBF58476D1CE4E5B9 & (2**64 - 1)
    return value >> (64 - bits)


def arrays_at(moment):
    """Give the 36 values (12 bits) that are read of both arrays; each array says the moment in three of its taxels."""
    values = [hashed(moment, taxel, 12) for taxel in range(36)]
    values[0:3] = values[3:6] = [moment >> 24 & 0xFFF, moment >> 12 & 0xFFF, moment & 0xFFF]
    return values


def singletact_at(moment):
    """Give the 25 counts (0 to 1023) of a moment, which the first and the last three taxels say."""
    values = [hashed(moment, taxel, 10) for taxel in range(SINGLETACT_TAXELS)]
    values[0:3] = values[22:25] = [moment >> 20 & 0x3FF, moment >> 10 & 0x3FF, moment & 0x3FF]
    return values


def crc16_modbus(data):
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc


def _shifted(byte):
    for _ in range(8):
        byte = byte >> 1 ^ (0xA001 if byte & 1 else 0)
    return byte


_TABLE = [_shifted(byte) for byte in range(256)]


class Faults:
    """Draws what goes wrong, and counts it. often: how many times as often as in the long test everything does."""

    def __init__(self, seed, often):
        self.random, self.often = random.Random(seed), often
        self.counts = {}
        self.unplug_at = 0.0

    def strikes(self, name, probability):
        hit = self.random.random() < self.often * probability
        self.counts[name] = self.counts.get(name, 0) + hit
        return hit

    def plugged(self, now):
        self.unplug_at = now + self.random.uniform(5, 25) / self.often

    def unplugs(self, now):
        if now < self.unplug_at:
            return False
        self.counts["unplugged"] = self.counts.get("unplugged", 0) + 1
        return True

    def spoil(self, message, flips):
        """Lose a byte, tear the frame, put garbage before it, or, with `flips`, change a byte."""
        if self.strikes("dropped byte", 0.002):
            at = self.random.randrange(len(message))
            message = message[:at] + message[at + 1 :]
        if self.strikes("torn frame", 0.002):
            message = message[: self.random.randrange(len(message))]
        if flips and message and self.strikes("flipped byte", 0.002):  # a torn one may be empty
            at = self.random.randrange(len(message))
            message = message[:at] + bytes([message[at] ^ self.random.randrange(1, 256)]) + message[at + 1 :]
        if self.strikes("garbage", 0.002):
            message = self.random.randbytes(self.random.randrange(1, 200)) + message
        return message


class Arrays:
    """Two 6x4 arrays on one line that speak by themselves, `rate` moments a second: `emulated` of docs/hardware.md."""

    def __init__(self, faults, rate):
        self.faults, self.rate, self.begun = faults, rate, time.monotonic()
        self.said = 0
        # Counter and clock are about to wrap.
        self.index_from, self.clock_from = 65536 - int(1.5 * rate), 2**32 - 2000
        self.repeated = b""

    def hear(self, data):
        pass

    def say(self):
        due = int((time.monotonic() - self.begun) * self.rate)
        self.said = max(self.said, due - self.rate)  # what nobody heard for a second is gone
        said = b""
        while self.said < due:
            said += self._moment(self.said)
            self.said += 1
        return said

    def _moment(self, moment):
        if self.faults.strikes("restart", 0.0001):
            self.index_from, self.clock_from = (
                self.faults.random.randrange(65536),
                -round(1e3 * moment / self.rate),
            )
        values = arrays_at(moment)
        said = b""
        for address in (1, 2):
            rows = [values[6 * row + 3 * (address - 1) :][:3] for row in range(ROWS)]
            unread = self.faults.random.randrange(4096)
            taxels = [v for row in rows for v in ([unread, *row] if address == 1 else [*row, unread])]
            if self.faults.strikes("lost part", 0.002):
                continue
            frame = self._frame(address, moment, taxels)
            if self.faults.strikes("same frame again", 0.002):
                frame += frame
            said += self.faults.spoil(frame, flips=True)
        return said

    def _frame(self, address, moment, taxels):
        packed = sum(value << 12 * (len(taxels) - 1 - k) for k, value in enumerate(taxels)).to_bytes(
            36, "big"
        )
        index, clock = self.index_from + moment, self.clock_from + round(1e3 * moment / self.rate)
        body = struct.pack(">BHI", address, index % 65536, clock % 2**32) + packed
        after_header = bytes([len(body) + 4]) + body
        crc = 0xFFFF
        for byte in after_header:
            crc = crc >> 8 ^ _TABLE[(crc ^ byte) & 0xFF]
        return b"\xaa\x55" + after_header + struct.pack(">H", crc) + b"\r\n"


class Bridge:
    """A SingleTact array of 25 taxels behind the maker's bridge: answers reads of its registers, one after another."""

    def __init__(self, faults, rate):
        self.faults, self.rate, self.begun = faults, rate, time.monotonic()
        self.heard, self.answers, self.old = b"", [], bytes(32)
        self.index_from, self.clock_from = 65536 - int(1.5 * rate), 2**32 - 20_000

    def hear(self, data):
        self.heard = (self.heard + data)[-200:]
        while (at := self.heard.find(b"\xff\xff\xff\xff\x04")) >= 0 and len(self.heard) >= at + 15:
            request, self.heard = self.heard[at : at + 15], self.heard[at + 15 :]
            assert request[7] == 1, "the host only reads"
            assert request[10:] == b"\xff\xfe\xfe\xfe\xfe"
            self._answer(request[6], request[8], request[9])

    def say(self):
        now = time.monotonic()
        said = b"".join(content for due, content in self.answers if due <= now)
        self.answers = [answer for answer in self.answers if answer[0] > now]
        return said

    def _answer(self, number, register, count):
        now = time.monotonic()
        moment = int((now - self.begun) * self.rate)
        due = now
        if self.faults.strikes("stale answer", 0.002):
            data, due = (
                self.old[:count],
                now + 0.1,
            )  # the sensor is silent: old bytes, and no flag that says so
        else:
            settings = bytearray(128)
            settings[0], settings[12] = 4, SINGLETACT_TAXELS
            head = struct.pack(">HH", (self.index_from + moment) % 65536, moment % 65536)
            output = struct.pack(f">{SINGLETACT_TAXELS}H", *singletact_at(moment))
            data = (bytes(settings) + head + output).ljust(256, b"\0")[register : register + count]
            self.old = (data + self.old)[:32]
        if self.faults.strikes("no answer", 0.002):
            return
        ticks = (self.clock_from + round(1e4 * (now - self.begun))) % 2**32
        reply = b"\xff\xff\xff\xff" + struct.pack(">BBBIB", 4, 0, number, ticks, len(data)) + data
        self.answers.append((due, self.faults.spoil(reply + b"\xfe\xfe\xfe\xfe", flips=False)))


def serve_pty(device, link, stop):
    """Speak on a pty behind the link; each time it is unplugged another takes over after a moment."""
    while not stop.is_set():
        master, slave = os.openpty()
        tty.setraw(slave)
        part = Path(f"{link}.part")
        part.symlink_to(os.ttyname(slave))
        part.replace(link)
        os.close(slave)
        os.set_blocking(master, False)
        device.faults.plugged(time.monotonic())
        while not stop.is_set() and not device.faults.unplugs(time.monotonic()):
            poll = select.poll()
            poll.register(master, select.POLLHUP)
            if any(event & select.POLLHUP for _, event in poll.poll(0)):  # nobody has opened it
                device.say()
                time.sleep(0.005)
                continue
            _turn(device, master, lambda data, to=master: os.write(to, data))
        Path(link).unlink()  # first: the system may give the pty's name to any other program
        os.close(master)
        time.sleep(0.3)


def serve_tcp(device, port, stop):
    """Speak on a TCP port; when it is unplugged the connection ends, and for a moment nobody answers."""
    while not stop.is_set():
        with socket.create_server(("127.0.0.1", port)) as server:
            if not select.select([server], [], [], 0.1)[0]:
                continue
            connection, _ = server.accept()
        with connection:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            connection.setblocking(False)
            device.answers.clear()
            device.faults.plugged(time.monotonic())
            while not stop.is_set() and not device.faults.unplugs(time.monotonic()):
                if not _turn(device, connection.fileno(), connection.send):
                    break
        time.sleep(0.3)


def _turn(device, fileno, write):
    """Hear and speak once; tells whether the host is still there. What the host has no room for is lost."""
    try:
        if select.select([fileno], [], [], 0.001)[0]:
            data = os.read(fileno, 4096)
            if not data:
                return False
            device.hear(data)
        said = device.say()
        while said:
            said = said[write(said) :]
    except BlockingIOError:
        pass
    except OSError:
        return False
    return True


def run(kind, place, rate, stop, seed, often, report):
    """Be the device `kind` at `place` until `stop`, in a process of its own; write what went wrong to `report`."""
    faults = Faults(seed, often)
    if kind == "arrays":
        serve_pty(Arrays(faults, rate), place, stop)
    else:
        serve_tcp(Bridge(faults, rate), place, stop)
    Path(report).write_text(json.dumps(faults.counts))
