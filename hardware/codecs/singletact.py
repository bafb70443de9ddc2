"""`singletact`: SingleTact sensors and arrays behind the maker's Arduino bridge.

The protocol is public (MIT): SingleTact's manual 2.3, WinAppArduinoInterface and NETInterface. The
bridge answers one question at a time, over 115200 baud 8N1:

    host -> bridge    FF FF FF FF  address  100  id  command  register  n  data  FF  FE FE FE FE
    bridge -> host    FF FF FF FF  address  timed-out  id  ticks (4)  n  data  FE FE FE FE

Numbers are big-endian and a tick is 100 us. The USB board's header is AA AA AA AA. There is no checksum.

The accumulator (register 5) is that of the sensor's chip, a C8051F70x, as the maker's SingleTactSettings.cs says. Its
codes are those of CS0ACU in Silicon Labs' SI_C8051F700_Register_Enums.h: 0 to 5 for 1, 4, 8, 16, 32 and 64 samples.
The manual's default is 4, and its rates agree: more than 140 frames a second as shipped, up to 4,000.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from tactsim.core.counters import Counters
from tactsim.core.poses import FloatArray
from tactsim.hardware.codecs.codec import (
    PATIENCE,
    Codec,
    CodecError,
    CodecFormat,
    Dialogue,
    Frame,
    mark_begun,
)

HEADERS = (b"\xff\xff\xff\xff", b"\xaa\xaa\xaa\xaa")
FOOTER = b"\xfe\xfe\xfe\xfe"
READ, WRITE = 1, 2
MOST_READ = 32  # bytes in one answer
DATA = 12  # where an answer's data begin
INDEX_REGISTER = 128  # frame index (2), device time (2), then 2 bytes a taxel
REGISTERS = 192
ACCUMULATOR_REGISTER, ELEMENTS_REGISTER = 5, 12
SETTINGS = 8  # bytes from the accumulator's register to that of the number of elements
ZERO, FULL_SCALE = 255, 512  # output of an unloaded taxel, and counts from there to the rated pressure
MOST_COUNTS = 1023
# A bridge whose sensor does not answer waits 100 ms, then sends what its buffer held before, and the
# timed-out flag stays 0 (`timeout` in SingleTactDemo.ino is never changed). Its slowness tells.
BRIDGE_GIVES_UP = 0.1  # s


@dataclass(frozen=True)
class Reply:
    """One answer of the bridge. data: the registers asked for, or none after a write."""

    address: int
    timed_out: bool
    id: int
    ticks: int
    data: bytes


@dataclass(frozen=True)
class Question:
    """What was asked of the sensor at `address`: `count` registers from `register` on, or to set them to `data`."""

    address: int
    id: int
    register: int
    count: int
    data: bytes = b""


class SingleTactFormat(CodecFormat):
    """The table `[codec]` of a device file with `kind = "singletact"`."""

    usual_address: ClassVar[int] = 4

    kind: Literal["singletact"]
    taxels: int = Field(1, ge=1, le=25, description="taxels of one sensor (register 12)")
    full_scale_kpa: float = Field(
        gt=0, description="kPa at output 767, the rated pressure of the sensor", examples=[100.0]
    )
    torn_frames: int = Field(
        0, ge=0, le=1000, description="frames that a sensor may measure while one is read; 0: only whole ones"
    )
    accumulator: int | None = Field(
        None,
        ge=0,
        le=5,
        description="register 5 is set to it, 0 to 5 for 1, 4, 8, 16, 32 (as shipped) or 64 samples; none: as it is",
    )

    def build(self) -> SingleTactCodec:
        """Make the codec."""
        return SingleTactCodec(self)


class SingleTactCodec(Codec[Reply]):
    """Read the bridge's answers."""

    longest = DATA + MOST_READ + len(FOOTER)
    tick_s = 1e-4
    tick_wrap = 1 << 32
    index_wrap = 1 << 16
    speaks = False
    clock_common = True  # the bridge's

    def __init__(self, form: SingleTactFormat) -> None:
        self.format = form
        self.taxels = form.taxels

    def decode(self, buffer: bytes | bytearray, start: int = 0) -> tuple[int, Reply | None]:
        """Look for an answer at `start`; see `Codec.decode`.

        Header, address (at most 127), flag, length and footer must agree, or one byte is given up. So
        a run of FF before a header costs nothing: its last four bytes are the header.
        """
        have = len(buffer) - start
        header = bytes(buffer[start : start + 4])
        if header not in HEADERS:
            found = [at for known in HEADERS if (at := buffer.find(known, start)) >= 0]
            return (min(found) - start, None) if found else (have - mark_begun(buffer, start, *HEADERS), None)
        if have > 4 and buffer[start + 4] > 127:
            return 1, None
        if have > 5 and buffer[start + 5] > 1:
            return 1, None
        if have < DATA:
            return 0, None
        count = buffer[start + DATA - 1]
        if count > MOST_READ:
            return 1, None
        size = DATA + count + len(FOOTER)
        if have < size:
            return 0, None
        if not buffer.startswith(FOOTER, start + DATA + count):
            return 1, None
        address, flag, number, ticks = struct.unpack_from(">BBBI", buffer, start + 4)
        return size, Reply(
            address, bool(flag), number, ticks, bytes(buffer[start + DATA : start + DATA + count])
        )

    def to_kpa(self, values: FloatArray) -> FloatArray:
        """Turn outputs into kPa: 255 is zero, 767 the rated pressure, less is negative, more is too much."""
        return (values - ZERO) * (self.format.full_scale_kpa / FULL_SCALE)

    def from_kpa(self, pressures: FloatArray) -> FloatArray:
        """Turn kPa into the nearest outputs, 0 to 1023."""
        return np.clip(np.round(pressures * (FULL_SCALE / self.format.full_scale_kpa) + ZERO), 0, MOST_COUNTS)

    def dialogue(self, addresses: tuple[int, ...], counters: Counters) -> Dialogue:
        """Start asking the sensors at these addresses in turn."""
        return Polling(self.format, addresses, counters)


class Polling(Dialogue):
    """Ask sensor after sensor for its frame, and before the first one for its settings.

    More than 14 taxels take two reads, which can fall in different frames. So the frame index is
    read once more behind them: a frame whose index moved was torn and is dropped.
    """

    def __init__(self, form: SingleTactFormat, addresses: tuple[int, ...], counters: Counters) -> None:
        self._format, self._addresses, self._counters = form, addresses, counters
        output = 4 + 2 * form.taxels  # bytes: index, device time, taxels
        self._reads = [
            (INDEX_REGISTER + at, min(MOST_READ, output - at)) for at in range(0, output, MOST_READ)
        ]
        if len(self._reads) > 1:
            self._reads.append((INDEX_REGISTER, 4))
        self._id = 0
        self._turn = 0  # whose turn it is
        # Answers so far, of `_reads`, and when they were asked for.
        self._have: list[tuple[Reply, float]] = []
        self._asked: tuple[Question, float] | None = None
        self._right: set[int] = set()  # sensors whose settings agree with the device file
        # By sensor: settings that do not; bits can flip, so they are asked again.
        self._doubted: dict[int, bytes] = {}
        self._to_set: set[int] = set()  # sensors whose accumulator is to be set next

    def request(self, now: float) -> bytes:
        """Ask the next question; one not answered in time is given up with its frame, and the next sensor asked."""
        step, turn = len(self._have), self._turn
        if self._asked is not None:
            if now - self._asked[1] < PATIENCE:
                return b""
            step, turn = 0, self._after(turn)  # as `sent` will note
        address = self._addresses[turn]
        if address in self._to_set:
            data = bytes([self._format.accumulator or 0])
            return write_request(Question(address, self._id, ACCUMULATOR_REGISTER, len(data), data))
        if address not in self._right:
            return write_request(Question(address, self._id, ACCUMULATOR_REGISTER, SETTINGS))
        register, count = self._reads[step]
        return write_request(Question(address, self._id, register, count))

    def sent(self, request: bytes, now: float) -> None:
        """Note what was asked."""
        if self._asked is not None:
            self._counters.timeouts += 1
            self._next_sensor()
        question = parse_request(request)
        self._asked = (question, now)
        self._id = (question.id + 1) % 256

    def take(self, packet: Reply, began: float) -> Frame | None:
        """Take an answer in; returns the sensor's frame when its last part has come and it is whole.

        Raises CodecError if the sensor's settings are not those of the device file.
        """
        if self._asked is None or not _answers(packet, self._asked[0]):
            self._counters.strays += 1
            return None
        question, asked_at = self._asked
        self._asked = None
        if packet.timed_out or began - asked_at >= BRIDGE_GIVES_UP:
            self._counters.stale += 1
            self._next_sensor()
            return None
        if question.data:
            self._to_set.discard(question.address)
            return None
        if question.register == ACCUMULATOR_REGISTER:
            self._check(question.address, packet.data)
            return None
        self._have.append((packet, asked_at))
        if len(self._have) < len(self._reads):
            return None
        have = self._have
        self._next_sensor()
        return self._frame(have)

    def reset(self) -> None:
        """Forget the open question, what was read of a frame, and the settings: another sensor may be there now."""
        self._asked = None
        self._have = []
        self._right.clear()
        self._doubted.clear()
        self._to_set.clear()

    def _next_sensor(self) -> None:
        self._have = []
        self._turn = self._after(self._turn)

    def _after(self, turn: int) -> int:
        return (turn + 1) % len(self._addresses)

    def _check(self, address: int, settings: bytes) -> None:
        """Compare a sensor's settings with the device file, and have its accumulator set where the two differ."""
        form = self._format
        accumulator, elements = settings[0], settings[ELEMENTS_REGISTER - ACCUMULATOR_REGISTER]
        accumulates = form.accumulator is None or accumulator == form.accumulator
        if elements == form.taxels and accumulates:
            self._right.add(address)
        elif self._doubted.get(address) != settings:
            self._doubted[address] = settings
            if elements == form.taxels:
                self._to_set.add(address)
        elif elements != form.taxels:
            raise CodecError(
                f"the sensor at address {address} has {elements} elements (register 12), the device file says taxels = "
                f"{form.taxels}; write down what the sensor has"
            )
        else:
            raise CodecError(
                f"the sensor at address {address} keeps its accumulator (register 5) at {accumulator} though it was "
                f"set to {form.accumulator}; it may be locked. Leave accumulator out of the device file"
            )

    def _frame(self, have: list[tuple[Reply, float]]) -> Frame | None:
        replies = [reply for reply, _ in have]
        first, last = (int.from_bytes(reply.data[:2], "big") for reply in (replies[0], replies[-1]))
        if len(replies) > 1:
            if (last - first) % 65536 > self._format.torn_frames:
                self._counters.torn += 1
                return None
            replies = replies[:-1]
        data = b"".join(reply.data for reply in replies)[4:]
        values = np.frombuffer(data, dtype=">u2").astype(np.float64)
        if values.max() > MOST_COUNTS:
            self._counters.impossible += 1
            return None
        return Frame(values, replies[0].address, index=first, ticks=replies[0].ticks, asked=have[0][1])


def write_request(question: Question) -> bytes:
    """Write the request to read registers, or to set them to the question's data."""
    command = WRITE if question.data else READ
    head = bytes([question.address, 100, question.id, command, question.register, question.count])
    return b"".join((HEADERS[0], head, question.data, b"\xff", FOOTER))


def parse_request(request: bytes) -> Question:
    """Read a request that `write_request` wrote. Raises CodecError for any other bytes."""
    if len(request) >= 15:
        address, _, number, _, register, count = request[4:10]
        question = Question(address, number, register, count, request[10:-5])
        if len(question.data) in (0, count) and request == write_request(question):
            return question
    raise CodecError(f"{request[:32].hex(' ')} is no request to read or set a SingleTact")


def write_reply(reply: Reply) -> bytes:
    """Write an answer as the Arduino bridge would. Raises CodecError if its data are too long."""
    if len(reply.data) > MOST_READ:
        raise CodecError(f"an answer holds at most {MOST_READ} bytes, not {len(reply.data)}")
    head = struct.pack(">BBBIB", reply.address, reply.timed_out, reply.id, reply.ticks, len(reply.data))
    return b"".join((HEADERS[0], head, reply.data, FOOTER))


def _answers(reply: Reply, question: Question) -> bool:
    expected = 0 if question.data else question.count
    return (reply.address, reply.id, len(reply.data)) == (question.address, question.id, expected)
