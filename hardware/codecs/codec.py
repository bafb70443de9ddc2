"""Codecs: from the bytes of a device to frames of taxels, and how a stream of bytes is cut into them."""

from __future__ import annotations

import binascii
import zlib
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import reduce
from operator import xor
from typing import Annotated, Any, ClassVar, Generic, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PlainSerializer, field_validator

from tactsim.core.counters import Counters
from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray


def _crc_table(polynomial: int) -> tuple[int, ...]:
    """Tabulate a reflected CRC's 256 steps."""

    def step(value: int) -> int:
        for _ in range(8):
            value = (value >> 1) ^ (polynomial if value & 1 else 0)
        return value

    return tuple(step(byte) for byte in range(256))


_MODBUS = _crc_table(0xA001)  # x^16 + x^15 + x^2 + 1, reflected


def crc16_modbus(data: bytes) -> int:
    """Compute CRC-16/MODBUS: reflected 0x8005 from 0xFFFF."""
    crc = 0xFFFF
    for byte in data:
        crc = (crc >> 8) ^ _MODBUS[(crc ^ byte) & 0xFF]
    return crc


# name: (bytes that it takes, function)
CHECKSUMS: dict[str, tuple[int, Callable[[bytes], int]]] = {
    "sum8": (1, lambda data: sum(data) & 0xFF),
    "xor8": (1, lambda data: reduce(xor, data, 0)),
    "lrc8": (1, lambda data: -sum(data) & 0xFF),  # of Modbus ASCII: all bytes and it sum to 0
    "sum16": (2, lambda data: sum(data) & 0xFFFF),
    "crc16-modbus": (2, crc16_modbus),
    "crc16-ccitt": (2, lambda data: binascii.crc_hqx(data, 0xFFFF)),
    "crc16-xmodem": (2, lambda data: binascii.crc_hqx(data, 0)),
    "crc32": (4, lambda data: zlib.crc32(data)),
}


Packet = TypeVar("Packet")

PATIENCE = 0.25  # s until a question is asked again; more than any device here takes to answer

STRICT = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


def _from_hex(value: object) -> object:
    """Read bytes written as hexadecimal digits, with or without blanks: "AA 55"."""
    if not isinstance(value, str):
        return value
    try:
        return bytes.fromhex(value)
    except ValueError:
        raise ValueError(f"bytes are written as hexadecimal digits like 'AA 55', not {value!r}") from None


Bytes = Annotated[
    bytes, BeforeValidator(_from_hex), PlainSerializer(lambda value: value.hex(" "), when_used="json")
]


class CodecError(InputError):
    """Bytes, or a description of bytes, that a codec cannot work with."""


@dataclass(frozen=True, eq=False)
class Frame:
    """One measurement of all taxels of one device.

    values: (taxels,) in the device's own units and order. address: which device on the link.
    index: its frame counter, ticks: its clock, both as sent, or None. packet: which packet it is of a frame that
    comes in several, or None. asked: s, the host's time when it was asked for; None if the device spoke
    unasked. seconds: its clock without overflows, which a codec leaves out.
    """

    values: FloatArray
    address: int = 0
    index: int | None = None
    ticks: float | None = None
    packet: int | None = None
    asked: float | None = None
    seconds: float | None = None


class Codec(ABC, Generic[Packet]):
    """Decode what one kind of device says, and for an emulator encode it.

    taxels: values in a frame. longest: bytes of the longest packet; with that many bytes `decode` always moves on, so a
    buffer never grows beyond it. before: bytes at a packet's beginning that end the one before, so its own bytes lie
    that much further on. tick_s: s, one tick of the device's clock. tick_wrap: ticks after which the clock starts
    again, or None. index_wrap: the same of the frame counter. speaks: whether the device sends every frame unasked, so
    that a gap in the frame counter means lost frames. index_common: whether the parts of a pad may count their frames
    together, so that equal counters mean one moment. clock_common: whether all devices on a link tell the time of one
    clock. packets: in how many packets a frame comes. start: bytes that make the device speak, sent once; request:
    bytes that ask for one frame; request_every_s: s from one request to the next, at least. title: what the device says
    before its first frame. mark: bytes that every frame begins or ends with.
    """

    taxels: int
    longest: int
    before: int = 0
    tick_s: float = 1.0
    tick_wrap: int | None = None
    index_wrap: int | None = None
    speaks: bool = True
    index_common: bool = False
    clock_common: bool = False
    packets: int = 1
    start: bytes = b""
    request: bytes = b""
    request_every_s: float = 0.0
    title: bytes = b""
    mark: bytes = b""

    @abstractmethod
    def decode(self, buffer: bytes | bytearray, start: int = 0) -> tuple[int, Packet | None]:
        """Look for a packet at `start`: returns (used, packet).

        (n, packet): the next n bytes were that packet. (n, None): the next n bytes are in no packet.
        (0, None): more bytes are needed. Nothing is remembered between calls, and no bytes raise an error.
        """

    def fails_checksum(self, buffer: bytes | bytearray, start: int) -> bool:
        """Tell whether a whole packet stands at `start` whose checksum alone is wrong."""
        return False

    @abstractmethod
    def to_kpa(self, values: FloatArray) -> FloatArray:
        """Turn a frame's values (taxels,) into kPa."""

    @abstractmethod
    def from_kpa(self, pressures: FloatArray) -> FloatArray:
        """Turn kPa (taxels,) into the nearest values that the device can say."""

    def encode(self, frame: Frame) -> bytes:
        """Write a frame as the device would; its values are rounded to what the device can say.

        Raises CodecError if this codec is for reading only.
        """
        raise CodecError(f"codec {type(self).__name__} writes no frames, so its device cannot be emulated")

    def dialogue(self, addresses: tuple[int, ...], counters: Counters) -> Dialogue:
        """Start the conversation with the devices at these addresses on one link."""
        return Listening(counters, self.start, self.request, self.request_every_s)


class Dialogue:
    """What to ask a device, and how its packets make frames.

    Only `sent`, `take` and `reset` change its state. A recording holds what was sent, received and lost,
    so its replay makes the same frames.
    """

    def greeting(self) -> bytes:
        """Give the bytes that are sent once after the link was opened."""
        return b""

    def request(self, now: float) -> bytes:
        """Give the bytes to send at `now` (s): b"" while an answer is awaited or nothing is to be asked."""
        return b""

    def sent(self, request: bytes, now: float) -> None:
        """Note that these bytes were sent."""

    def take(self, packet: Any, began: float) -> Frame | None:
        """Take in a packet whose first byte came at `began` (s); returns a frame when one is complete."""
        raise NotImplementedError

    def reset(self) -> None:
        """Forget what was asked: the link was lost."""


class Listening(Dialogue):
    """A device whose packets are frames; it speaks unasked, or says one frame for each `question`.

    pause: s from one question to the next, at least.
    """

    def __init__(
        self, counters: Counters, start: bytes = b"", question: bytes = b"", pause: float = 0.0
    ) -> None:
        self._counters, self._start, self._question, self._pause = counters, start, question, pause
        self._asked: float | None = None
        self._first = 0.0  # when the first of the open questions was asked
        self._next = float("-inf")  # when the next question is due

    def greeting(self) -> bytes:
        """Give the command that makes the device speak, if it needs one."""
        return self._start

    def request(self, now: float) -> bytes:
        """Ask again when the answer came or is overdue."""
        awaited = self._asked is not None and now - self._asked < PATIENCE
        return b"" if awaited or now < self._next else self._question

    def sent(self, request: bytes, now: float) -> None:
        """Note when the question was asked; one that is still open was not answered in time."""
        if self._question and request == self._question:
            self._counters.timeouts += self._asked is not None
            self._first = now if self._asked is None else self._first
            self._asked, self._next = now, now + self._pause

    def take(self, packet: Frame, began: float) -> Frame | None:
        """Pass the frame on, with the time of its question: of the first, since its answer may only be late."""
        asked, self._asked = self._asked, None
        return packet if asked is None else replace(packet, asked=self._first)

    def reset(self) -> None:
        """Forget the open question."""
        self._asked = None


def mark_begun(buffer: bytes | bytearray, start: int, *marks: bytes) -> int:
    """Count the bytes at the buffer's end, behind `start`, that could be the beginning of one of the marks."""
    lengths = range(1, min(max(map(len, marks)), len(buffer) - start + 1))
    return max(
        (n for n in lengths if any(buffer.endswith(mark[:n]) for mark in marks if n < len(mark))), default=0
    )


class CodecFormat(BaseModel, ABC):
    """The table `[codec]` of a device file: which codec, and what it has to know.

    A subclass adds a field for each key of the table. One that must be given has an example (`Field(examples=...)`),
    from which tests build the codec. usual_address: of a part whose address is not given.
    """

    model_config = STRICT
    usual_address: ClassVar[int] = 0

    kind: str

    @property
    def reading_unit(self) -> str:
        """Give the unit of the readings, as a scan states it."""
        return "kPa"

    @abstractmethod
    def build(self) -> Codec[Any]:
        """Make the codec."""


class CountsFormat(CodecFormat):
    """The keys of a device whose values are counts, and which may have to be started or asked.

    pressure in kPa = (value - zero) * kpa_per_count.
    """

    zero: float = Field(0.0, description="value of an unloaded taxel")
    kpa_per_count: float = Field(
        description="kPa of one count; kPa = (value - zero) * kpa_per_count", examples=[0.1]
    )
    start: Bytes = Field(b"", max_length=256, description="bytes that make the device speak, sent once")
    request: Bytes = Field(b"", max_length=256, description="bytes that ask for one frame")
    request_every_s: float = Field(
        0.0,
        ge=0,
        le=60,
        description="s from one request to the next, at least: no less than the device measures in",
    )

    @field_validator("kpa_per_count")
    @classmethod
    def _is_not_0(cls, value: float) -> float:
        if not value:
            raise ValueError("kpa_per_count must not be 0")
        return value


class CountsCodec(Codec[Frame]):
    """Read and write the frames of such a device."""

    def __init__(self, form: CountsFormat) -> None:
        self.zero, self.kpa_per_count = form.zero, form.kpa_per_count
        self.start, self.request, self.request_every_s = form.start, form.request, form.request_every_s
        self.speaks = not form.request

    def to_kpa(self, values: FloatArray) -> FloatArray:
        """Turn values into kPa by the format's zero and scale."""
        return (values - self.zero) * self.kpa_per_count

    def from_kpa(self, pressures: FloatArray) -> FloatArray:
        """Turn kPa into values."""
        return pressures / self.kpa_per_count + self.zero


LARGEST_CHUNK = 1 << 16  # bytes; behind a smaller one nothing was left to read when it came


@dataclass(frozen=True)
class Arrived(Generic[Packet]):
    """A packet and when it came, s: its first byte at `began`, its last at `ended`, and none before or at `after`."""

    packet: Packet
    began: float
    after: float
    ended: float


class Framer(Generic[Packet]):
    """Give a codec what has come so far; the buffer never holds more than one chunk and an unfinished packet."""

    def __init__(self, codec: Codec[Packet], counters: Counters) -> None:
        self._codec, self._counters = codec, counters
        self._buffer = bytearray()
        self._in_garbage = False
        self._last = float("-inf")  # when all that had come was last read
        self._chunks: deque[tuple[int, float, float]] = deque()  # (end in the buffer, came, not before or at)

    def feed(self, data: bytes, now: float) -> list[Arrived[Packet]]:
        """Take in bytes that came at `now` (s) and return the packets that they complete.

        No bytes say that nothing came until `now`. Raises CodecError if the codec asks for more bytes though
        it has `longest` of them: that is its bug, and the buffer would grow without end.
        """
        buffer, packets, at = self._buffer, [], 0
        buffer += data
        if data:
            self._chunks.append((len(buffer), now, self._last))
        if len(data) < LARGEST_CHUNK:
            self._last = max(self._last, now)
        self._counters.bytes += len(data)
        while at < len(buffer):
            used, packet = self._codec.decode(buffer, at)
            if used == 0:
                if len(buffer) - at >= self._codec.longest:
                    raise CodecError(
                        f"codec {type(self._codec).__name__} waits for more than the {self._codec.longest} "
                        "bytes that it calls its longest packet"
                    )
                break
            if packet is not None:
                first = at + self._codec.before
                while self._chunks[0][0] <= first:
                    self._chunks.popleft()
                ended = next((came for end, came, _ in self._chunks if end >= first + used), now)
                packets.append(Arrived(packet, *self._chunks[0][1:], ended))
                self._in_garbage = False
            else:
                self._counters.garbage_bytes += used
                self._counters.resyncs += not self._in_garbage
                self._counters.bad_checksums += self._codec.fails_checksum(buffer, at)
                self._in_garbage = True
            at += used
        del buffer[:at]
        self._chunks = deque((end - at, came, before) for end, came, before in self._chunks if end > at)
        return packets

    def reset(self) -> None:
        """Forget the beginning of a packet: its rest will not come."""
        self._counters.garbage_bytes += len(self._buffer)
        self._buffer.clear()
        self._chunks.clear()
        self._last = float("-inf")
        self._in_garbage = False
