"""Emulated devices: the bytes that a device sends until a given time, on a pty or a TCP port."""

from __future__ import annotations

import os
import select
import socket
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.hardware.codecs.codec import Codec, Frame
from tactsim.hardware.codecs.singletact import (
    ACCUMULATOR_REGISTER,
    ELEMENTS_REGISTER,
    FOOTER,
    HEADERS,
    INDEX_REGISTER,
    MOST_READ,
    READ,
    REGISTERS,
    WRITE,
    Reply,
    SingleTactCodec,
    SingleTactFormat,
    write_reply,
)
from tactsim.hardware.device import UNREAD, Device

Pressures = Callable[[float], FloatArray]

_SAMPLES = (1, 4, 8, 16, 32, 64)  # a frame, by the accumulator (CS0ACU of C8051F70x)
_SHIPPED = 4  # the accumulator's default (SingleTact's manual 2.3, table 2)
_BEHIND = 1.0  # s: older frames are dropped while the host does not read


class Emulated(ABC):
    """The emulated end of a device on one port. Times are s since the emulation began.

    device: the description that a host would use. pressures(now): (taxels,) kPa on the pad. rate: frames a second.
    """

    def __init__(self, device: Device, pressures: Pressures, rate: float) -> None:
        self._device, self._pressures, self.rate = device, pressures, rate
        self._codec: Codec[Any] = device.build_codec()
        self._parts = [(device.place(part)[1], device.wiring(part)) for part in device.part]

    @abstractmethod
    def hear(self, data: bytes, now: float) -> None:
        """Take in bytes that the host sent."""

    @abstractmethod
    def say(self, now: float) -> list[bytes]:
        """Return what the device has sent since the last call until `now`, frame by frame."""

    @abstractmethod
    def unheard(self, now: float) -> None:
        """Drop what the device would have sent until `now`, because no host listens."""

    def values(self, wiring: np.ndarray, time: float) -> FloatArray:
        """Measure one part at `time`: (taxels,) in the device's units."""
        pad, matrix = self._pressures(time), self._device.matrix
        if matrix is not None:
            pad = matrix.read(pad.reshape(self._device.pad.rows, -1)).ravel()
        return self._codec.from_kpa(np.where(wiring == UNREAD, 0.0, pad[wiring]))


class EmulatedFrames(Emulated):
    """A device whose codec writes frames: it sends them `rate` times a second, or when it is asked.

    jitter: how unevenly it measures: each frame is up to half that share of the time between frames too early or
    too late, and its clock says so.
    """

    def __init__(self, device: Device, pressures: Pressures, rate: float, jitter: float = 0.0) -> None:
        super().__init__(device, pressures, rate)
        self._jitter, self._rng = jitter, np.random.default_rng(0)
        self._frame = 0  # number of the next frame
        self._heard = b""
        self._started = not self._codec.start
        self._asked = 0
        self._title = self._codec.title

    def hear(self, data: bytes, now: float) -> None:
        """Look for the command to start and for requests."""
        self._heard += data
        if not self._started and self._codec.start in self._heard:
            self._heard = self._heard.partition(self._codec.start)[2]
            self._started, self._frame = True, self._latest(now) + 1
        if self._started and self._codec.request:
            *requests, self._heard = self._heard.split(self._codec.request)
            self._asked += len(requests)
        self._heard = self._heard[-256:]

    def say(self, now: float) -> list[bytes]:
        """Return the frames that were measured since the last call, or one for each request."""
        if not self._started:
            return []
        said = [self._title] if self._title else []
        self._title = b""
        if self._codec.request:
            asked, self._asked, self._frame = self._asked, 0, self._latest(now)
            return said + list(self._next_frame()) * asked
        latest = self._latest(now)
        self._frame = max(self._frame, latest - int(_BEHIND * self.rate))
        while self._frame <= latest:
            said += self._next_frame()
        return said

    def unheard(self, now: float) -> None:
        """Drop the frames that were measured since the last call."""
        self._frame, self._asked = max(self._frame, self._latest(now) + 1), 0

    def _latest(self, now: float) -> int:
        """Give the number of the last frame that was measured; the rounding of `now` loses none."""
        return int(now * self.rate + 1e-6)

    def _next_frame(self) -> Iterator[bytes]:
        frame, self._frame = self._frame, self._frame + 1
        time = frame / self.rate
        if self._jitter:
            time = max(0.0, time + self._jitter * self._rng.uniform(-0.5, 0.5) / self.rate)
        for address, wiring in self._parts:
            ticks = round(time / self._codec.tick_s)
            yield self._codec.encode(Frame(self.values(wiring, time), address, frame, ticks))


class EmulatedSingleTact(Emulated):
    """SingleTact sensors behind the maker's bridge, which answers one request at a time.

    silent: addresses that do not answer; for them the bridge sends old bytes after 100 ms and its
    timed-out flag stays 0, as the real one's does. A sensor measures `rate` frames a second as it is shipped, with 32
    samples a frame, and more with fewer.
    """

    _codec: SingleTactCodec

    def __init__(self, device: Device, pressures: Pressures, rate: float) -> None:
        super().__init__(device, pressures, rate)
        self.silent: frozenset[int] = frozenset()
        # By sensor: when its rate last changed, the frames until then, and the samples of a frame.
        self._counted = {address: (0.0, 0.0, _SAMPLES[_SHIPPED]) for address, _ in self._parts}
        self._heard = b""
        self._answers: list[tuple[float, bytes]] = []  # (time when due, bytes)
        self._old = bytes(MOST_READ)  # what the bridge's buffer held before
        self._settings = {address: self._registers(address) for address, _ in self._parts}

    def hear(self, data: bytes, now: float) -> None:
        """Find requests as the bridge does; after a wrong byte the search starts again."""
        self._heard += data
        while (at := self._heard.find(HEADERS[0])) >= 0:
            request = self._heard[at:]
            if len(request) < 15:
                break
            size = 15 + (0 if request[7] == READ else request[9])
            if len(request) < size:
                break
            if request[size - 4 : size] == FOOTER:
                self._answer(request[:size], now)
                self._heard = request[size:]
            else:
                self._heard = request[1:]
        self._heard = self._heard[-64:]

    def say(self, now: float) -> list[bytes]:
        """Return the answers that are due."""
        due = [content for when, content in self._answers if when <= now]
        self._answers = [answer for answer in self._answers if answer[0] > now]
        return due

    def unheard(self, now: float) -> None:
        """Lose the answers that were due."""
        self._answers.clear()

    def _answer(self, request: bytes, now: float) -> None:
        address, number, command, register, count = (request[k] for k in (4, 6, 7, 8, 9))
        data, when = b"", now
        if command == READ:
            count = min(count, MOST_READ)
            if self._hears(address):
                data = self._memory(address, now)[register : register + count].ljust(count, b"\0")
                self._old = (data + self._old)[:MOST_READ]
            else:
                data, when = self._old[:count], now + 0.1
        elif command == WRITE and self._hears(address) and register + count <= INDEX_REGISTER:
            self._settings[address][register : register + count] = request[10 : 10 + count]
            accumulator = min(self._settings[address][ACCUMULATOR_REGISTER], len(_SAMPLES) - 1)
            self._counted[address] = now, self._frames(address, now), _SAMPLES[accumulator]
        ticks = round(now / self._codec.tick_s) % self._codec.tick_wrap
        self._answers.append((when, write_reply(Reply(address, False, number, ticks, data))))

    def _hears(self, address: int) -> bool:
        return address in self._settings and address not in self.silent

    def _per_second(self, address: int) -> float:
        return self.rate * _SAMPLES[_SHIPPED] / self._counted[address][2]

    def _frames(self, address: int, now: float) -> float:
        """Count a sensor's frames until `now`, with the share of the one that is being measured."""
        since, before, _ = self._counted[address]
        return before + (now - since) * self._per_second(address)

    def _registers(self, address: int) -> bytearray:
        """Make the settings registers, as far as a host reads them."""
        settings = bytearray(INDEX_REGISTER)
        settings[0] = address
        settings[ACCUMULATOR_REGISTER] = _SHIPPED
        settings[10:12] = (100).to_bytes(2, "big")
        settings[ELEMENTS_REGISTER] = self._codec.taxels
        settings[15 : 15 + self._codec.taxels] = bytes(range(self._codec.taxels))
        return settings

    def _memory(self, address: int, now: float) -> bytes:
        """Make the content of all registers at `now`."""
        frames = self._frames(address, now)
        frame = int(frames)
        wiring = dict(self._parts)[address]
        head = (frame % 65536).to_bytes(2, "big") + (round(1e3 * now) % 65536).to_bytes(2, "big")
        output = (
            self.values(wiring, now - (frames - frame) / self._per_second(address)).astype(">u2").tobytes()
        )
        memory = bytes(self._settings[address]) + head + output
        return memory.ljust(REGISTERS, b"\0")


def emulate(device: Device, pressures: Pressures, rate: float, jitter: float = 0.0) -> Emulated:
    """Make the emulated end of a device on one port. jitter: see `EmulatedFrames`; SingleTact has none.

    Raises CodecError if the device has no codec, or one that writes no frames.
    """
    if isinstance(device.codec, SingleTactFormat):
        return EmulatedSingleTact(device, pressures, rate)
    emulated = EmulatedFrames(device, pressures, rate, jitter)
    codec = device.build_codec()
    codec.encode(Frame(codec.from_kpa(np.zeros(codec.taxels)), index=0, ticks=0))
    return emulated


_LONGEST_BURST = 200  # bytes


@dataclass(frozen=True)
class Faults:
    """How often each fault happens.

    drop, flip: probability that a byte is lost, or changed. torn: probability that a frame breaks off in its
    middle. garbage: probability of a burst of random bytes before a frame. drift: kPa a second that all
    taxels gain. disconnect: s after which the line is cut, again and again; 0 for never.
    """

    drop: float = 0.0
    flip: float = 0.0
    torn: float = 0.0
    garbage: float = 0.0
    drift: float = 0.0
    disconnect: float = 0.0

    def drifted(self, pressures: Pressures) -> Pressures:
        """Add the drift to what the pad would say."""
        return lambda now: pressures(now) + self.drift * now

    def spoil(self, message: bytes, rng: np.random.Generator) -> bytes:
        """Apply the faults to one frame and return the bytes that arrive."""
        if self.torn and rng.random() < self.torn:
            message = message[: rng.integers(len(message))]
        if self.flip:
            data = np.frombuffer(message, np.uint8).copy()
            hit = rng.random(len(data)) < self.flip
            data[hit] ^= rng.integers(1, 256, size=int(hit.sum()), dtype=np.uint8)
            message = data.tobytes()
        if self.drop:
            data = np.frombuffer(message, np.uint8)
            message = data[rng.random(len(data)) >= self.drop].tobytes()
        if self.garbage and rng.random() < self.garbage:
            message = rng.bytes(int(rng.integers(1, _LONGEST_BURST))) + message
        return message


Ready = Callable[[str], None]

_AWAY = 0.3  # s for which a cut line stays down
_NAP = 0.02  # s: the longest time between looks at the clock


@dataclass
class _Clock:
    """Seconds since the first host connected; the emulation begins then."""

    started: float | None = None

    def start(self) -> None:
        self.started = time.monotonic() if self.started is None else self.started

    def now(self) -> float:
        return 0.0 if self.started is None else time.monotonic() - self.started


def serve_pty(
    device: Emulated,
    faults: Faults,
    rng: np.random.Generator,
    *,
    link: Path | None = None,
    ready: Ready = lambda url: None,
    stop: Event | None = None,
) -> None:
    """Serve on a new pty until `stop`. `ready(name)` is called with the name that a host opens.

    link: a symbolic link to the pty. When a fault cuts the line it is gone until another pty takes over: the system may
    give the old one's name to any other program.
    Raises InputError if `link` exists and is no symbolic link, or cannot be made, and where there are no ptys.
    """
    if link is not None and link.exists() and not link.is_symlink():
        raise InputError(f"{link} exists and is no link; name another place for the pty")
    stop, clock = stop or Event(), _Clock()
    while not stop.is_set():
        master, name = _open_pty()
        try:
            if link is not None:
                _point(link, name)
            ready(str(link or name))
            os.set_blocking(master, False)
            line = _Line(master, partial(os.read, master), partial(os.write, master), gone_for_good=False)
            _talk(line, device, faults, rng, clock, stop)
        finally:
            if link is not None and link.is_symlink() and str(link.readlink()) == name:  # and not another's
                link.unlink()
            os.close(master)
        stop.wait(_AWAY)


def serve_tcp(
    device: Emulated,
    faults: Faults,
    rng: np.random.Generator,
    *,
    host: str = "127.0.0.1",
    port: int = 0,
    ready: Ready = lambda url: None,
    stop: Event | None = None,
) -> None:
    """Serve on a TCP port until `stop`, one host after another; port 0 takes any that is free.

    `ready(url)` is called with the URL that a host opens. Raises InputError if the port is taken.
    """
    stop, clock = stop or Event(), _Clock()
    try:
        server = socket.create_server((host, port))
    except (OSError, OverflowError) as error:
        raise InputError(f"cannot serve on {host}:{port}: {error}") from error
    with server:
        ready(f"socket://{host}:{server.getsockname()[1]}")
        while not stop.is_set():
            if not select.select([server], [], [], _NAP)[0]:
                continue
            connection, _ = server.accept()
            with connection:
                connection.setblocking(False)
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                line = _Line(connection.fileno(), connection.recv, connection.send, gone_for_good=True)
                _talk(line, device, faults, rng, clock, stop)


@dataclass(frozen=True)
class _Line:
    """The device's end of a pty, which another host may open again, or of a connection, which is `gone_for_good`.

    receive(most) and send(data): as those of a file or a socket that does not block.
    """

    fileno: int
    receive: Callable[[int], bytes]
    send: Callable[[bytes], int]
    gone_for_good: bool

    def connected(self) -> bool:
        """Tell whether a host has the other end open; a connection has one until it is gone."""
        if self.gone_for_good:
            return True
        poll = select.poll()
        poll.register(self.fileno, select.POLLHUP)
        return not any(event & select.POLLHUP for _, event in poll.poll(0))

    def read(self) -> bytes:
        """Read what the host sent; b"" if it has gone."""
        try:
            return self.receive(4096)
        except OSError:
            return b""


def _talk(
    line: _Line, device: Emulated, faults: Faults, rng: np.random.Generator, clock: _Clock, stop: Event
) -> None:
    """Let the device hear and speak until the host is gone, a fault cuts the line, or `stop`."""
    pending = b""  # the rest of a frame that the host was too slow for
    cut_at = clock.now() + faults.disconnect if faults.disconnect else float("inf")
    while not stop.is_set():
        if not line.connected():
            pending = b""
            if clock.started is not None:
                device.unheard(clock.now())
            stop.wait(_NAP)
            continue
        clock.start()
        wait = min(_NAP, 0.5 / device.rate)
        if select.select([line.fileno], [], [], wait)[0]:
            data = line.read()
            if not data and line.gone_for_good:
                return
            device.hear(data, clock.now())
        for message in device.say(clock.now()):
            if not pending:  # a device does not wait: while a frame is pending, later ones are dropped whole
                pending = faults.spoil(message, rng)
                pending = _write(line, pending)
        if pending:
            pending = _write(line, pending)
        if clock.now() >= cut_at:
            return


def _write(line: _Line, data: bytes) -> bytes:
    """Write what fits and return the rest."""
    try:
        while data:
            data = data[line.send(data) :]
    except BlockingIOError:
        pass
    except OSError:  # the host went away meanwhile
        return b""
    return data


def _open_pty() -> tuple[int, str]:
    """Open a pty that passes bytes on as they are. Raises InputError on a system that has none, as Windows."""
    try:
        import tty
    except ImportError:
        raise InputError("this system has no ptys; serve on a TCP port: --port tcp") from None
    master, slave = os.openpty()
    tty.setraw(slave)
    name = os.ttyname(slave)
    os.close(slave)
    return master, name


def _point(link: Path, name: str) -> None:
    """Make `link` point to the pty, at once. Raises InputError if it cannot be made."""
    part = link.with_name(f".{link.name}.{os.getpid()}")
    try:
        part.unlink(missing_ok=True)
        part.symlink_to(name)
        part.replace(link)
    except OSError as error:
        raise InputError(
            f"cannot make the link {link}: {error.strerror}; name another place for the pty"
        ) from error
