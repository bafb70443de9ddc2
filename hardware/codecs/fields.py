"""`fields`: frames of a fixed layout that a device file describes, for devices whose owner knows theirs.

How a frame is found, so that none is invented from the remains of two:

- It begins with the header. If neither a checksum nor a footer ends it, a header follows; or, where a question
  called for it, it does not end with the beginning of a header, which may be that of the next answer.
- Without a header, it stands between two footers.
- With neither, it is right by its CRC, and so are as many bytes before it, the frame before.
- Without a checksum no other such mark begins within it: where bytes were lost, the next frame's would. Only if both
  marks come again at the frame's length, three times, is it a picture in whose data the mark stands. The same holds
  with a checksum of one byte, unless the mark has but one byte, too, and so stands in the data too often.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, Field, model_validator

from tactsim.core.counters import Counters
from tactsim.core.finite import LARGEST
from tactsim.core.poses import FloatArray
from tactsim.hardware.codecs.codec import (
    CHECKSUMS,
    PATIENCE,
    STRICT,
    Bytes,
    CountsCodec,
    CountsFormat,
    Dialogue,
    Frame,
    Listening,
    mark_begun,
)

LONGEST_FRAME = 1 << 16  # bytes
_FEWEST_PACKETS = 4  # by which SLIP and COBS are told
# Checksums by which a frame may be found. The others are right by chance too often, or right for a run of zeros.
FINDING = ("crc16-modbus", "crc16-ccitt", "crc32")


FixedBytes = Annotated[Bytes, Field(min_length=1, max_length=64)]
Size = Literal[1, 2, 4]


class _Item(BaseModel):
    model_config = STRICT

    is_: str = Field(alias="is")


class Fixed(_Item):
    """Bytes that are the same in every frame; `header` comes first, `footer` last."""

    is_: Literal["header", "footer", "fixed"] = Field(alias="is")
    bytes: FixedBytes = Field(description="the same in every frame; the header comes first, the footer last")


class Length(_Item):
    """A number that says how long the frame is: checked, since the layout says it already."""

    is_: Literal["length"] = Field(alias="is")
    size: Size = Field(1, description="bytes of the number")
    of: Literal["frame", "after", "taxels", "data"] = Field(
        description="bytes of the whole frame; bytes behind this number; how many taxels; bytes of the taxels"
    )
    plus: int = Field(0, ge=-LONGEST_FRAME, le=LONGEST_FRAME, description="what the device adds to that")


class Number(_Item):
    """A number: `address` says which device of several it is, `index` counts the frames."""

    is_: Literal["address", "index"] = Field(alias="is")
    size: Size = Field(
        1, description="bytes of the number: which part it is; the frame's, which all parts count alike"
    )


class Clock(_Item):
    """The device's clock."""

    is_: Literal["clock"] = Field(alias="is")
    size: Size = Field(4, description="bytes of the number")
    tick_s: float = Field(gt=0, le=3600, description="s a tick")


class PacketNumber(_Item):
    """Which packet it is of a frame that comes in several, each of them with the whole layout."""

    is_: Literal["packet"] = Field(alias="is")
    size: Size = Field(1, description="bytes of the number")
    of: int = Field(ge=2, le=1000, description="packets of a frame; each has `count` of its taxels, in order")
    first: int = Field(0, ge=0, le=255, description="the number of a frame's first packet")


class Skip(_Item):
    """Bytes that mean nothing here."""

    is_: Literal["skip"] = Field(alias="is")
    size: int = Field(ge=1, le=4096, description="bytes that mean nothing here")


class Taxels(_Item):
    """The measurements, `bits` each, packed without gaps and filled up to a whole byte.

    Packed 10 and 12 bits fill each byte from its high bit if the format is big-endian, else from its low.
    """

    is_: Literal["taxels"] = Field(alias="is")
    count: int = Field(ge=1, le=10_000, description="how many taxels")
    bits: Literal[8, 10, 12, 16, 32] = Field(16, description="of each value, packed without gaps")
    signed: bool = Field(False, description="whether values may be negative (two's complement)")
    float: bool = Field(False, description="whether values are IEEE 754 floats, of 32 bits")
    axes: int = Field(
        1, ge=1, le=16, description="values of each taxel; all but one are kept in recordings only"
    )
    normal: int = Field(0, ge=0, le=15, description="which of them is read, from 0: the normal force")

    @model_validator(mode="after")
    def _makes_sense(self) -> Taxels:
        if self.float and self.bits != 32:
            raise ValueError(f"a float has 32 bits, not {self.bits}: give bits = 32")
        if self.float and self.signed:
            raise ValueError("floats have their own sign: leave out signed")
        if self.normal >= self.axes:
            raise ValueError(f"the normal axis {self.normal} is none of {self.axes}: count from 0")
        return self

    @property
    def size(self) -> int:
        """Count the bytes."""
        return (self.count * self.axes * self.bits + 7) // 8


class Checksum(_Item):
    """A checksum of all bytes before it, but for the first `skip`; the taxels are among them."""

    is_: Literal["checksum"] = Field(alias="is")
    kind: str = Field(description="how it is worked out, from all bytes before it")
    skip: int = Field(0, ge=0, le=4096, description="bytes at the frame's beginning that it leaves out")
    endian: Literal["big", "little"] | None = Field(
        None,
        description="its order of bytes; none: that of the frame's other numbers (Modbus RTU has `little`)",
    )

    @model_validator(mode="after")
    def _known(self) -> Checksum:
        if self.kind not in CHECKSUMS:
            raise ValueError(f"unknown checksum {self.kind!r}; known are {', '.join(CHECKSUMS)}")
        return self

    @property
    def size(self) -> int:
        """Count the bytes."""
        return CHECKSUMS[self.kind][0]


Item = Annotated[
    Fixed | Length | Number | Clock | PacketNumber | Skip | Taxels | Checksum, Field(discriminator="is_")
]
Layout = tuple[Item, ...]
Kind = TypeVar("Kind", bound=_Item)


def size_of(item: Item) -> int:
    """Count the bytes of an item."""
    return len(item.bytes) if isinstance(item, Fixed) else item.size


def places(layout: Layout) -> Iterator[tuple[Item, int]]:
    """List the items of a layout with the byte at which each begins."""
    at = 0
    for item in layout:
        yield item, at
        at += size_of(item)


def only(layout: Layout, kind: type[Kind], name: str | None = None) -> Kind | None:
    """Find the item of that class, and of that name if one is given; None if there is none."""
    found = (item for item in layout if isinstance(item, kind) and name in (None, item.is_))
    return next(found, None)


def length_value(item: Length, at: int, layout: Layout) -> int:
    """Compute what a length at byte `at` has to say."""
    total = sum(map(size_of, layout))
    taxels = only(layout, Taxels)
    assert taxels is not None
    lengths = {"frame": total, "after": total - at - item.size, "taxels": taxels.count, "data": taxels.size}
    return lengths[item.of] + item.plus


def check_layout(layout: Layout) -> None:
    """Raise ValueError if a layout makes no sense, or if nothing tells where its frames begin."""
    kinds = [item.is_ for item in layout]
    for kind in ("header", "footer", "taxels", "address", "index", "clock", "packet", "checksum"):
        if kinds.count(kind) > 1:
            raise ValueError(f"the layout has {kinds.count(kind)} items {kind!r}; one is allowed")
    if "taxels" not in kinds:
        raise ValueError("the layout has no item 'taxels'")
    if "header" in kinds and kinds[0] != "header":
        raise ValueError("the header must be the first item of the layout")
    if "footer" in kinds and kinds[-1] != "footer":
        raise ValueError("the footer must be the last item of the layout")
    checksum = only(layout, Checksum)
    if not {"header", "footer"} & set(kinds) and (checksum is None or checksum.kind not in FINDING):
        raise ValueError(
            "no frame can be found: the layout must begin with a header, end with a footer, or have a checksum "
            f"of {', '.join(FINDING)}"
        )
    if "packet" in kinds and "index" not in kinds:
        raise ValueError(
            "a frame of several packets needs an 'index': without it packets of two frames are told apart by nothing"
        )
    if sum(map(size_of, layout)) > LONGEST_FRAME:
        raise ValueError(f"a frame may have at most {LONGEST_FRAME} bytes")
    for item, at in places(layout):
        if isinstance(item, Length) and not 0 <= length_value(item, at, layout) < 256**item.size:
            raise ValueError(f"a length of {length_value(item, at, layout)} does not fit its field")
        if isinstance(item, PacketNumber) and item.first + item.of > 256**item.size:
            raise ValueError(
                f"{item.of} packets from {item.first} on do not fit a number of {item.size} bytes"
            )
        if isinstance(item, Checksum) and item.skip >= at:
            raise ValueError(f"the checksum skips {item.skip} bytes, but only {at} stand before it")
    if checksum is not None:
        starts = {item.is_: at for item, at in places(layout)}
        if not checksum.skip <= starts["taxels"] < starts["checksum"]:
            raise ValueError(
                "the checksum does not cover the taxels: let it stand behind them and skip none of them, "
                "or give its bytes as an item 'skip'"
            )


Endian = Literal["big", "little"]

_STEADY = 3  # times that a mark within a frame has to come again at the same place, to be part of the data


class FieldsFormat(CountsFormat):
    """The table `[codec]` of a device file with `kind = "fields"`."""

    kind: Literal["fields"]
    layout: tuple[Item, ...] = Field(
        max_length=64,
        description="what a frame is made of, in its order",
        examples=[[{"is": "header", "bytes": "AA 55"}, {"is": "taxels", "count": 16}]],
    )
    endian: Endian = Field("big", description="which byte of a number comes first")

    @model_validator(mode="after")
    def _makes_sense(self) -> FieldsFormat:
        check_layout(self.layout)
        return self

    def build(self) -> FieldsCodec:
        """Make the codec."""
        return FieldsCodec(self)


class FieldsCodec(CountsCodec):
    """Read and write frames of one described layout."""

    def __init__(self, form: FieldsFormat) -> None:
        super().__init__(form)
        self.format = form
        self._endian: Endian = form.endian
        self._fixed: list[tuple[int, bytes]] = []  # lengths are fixed bytes too
        self._spans: dict[str, slice] = {}
        for item, at in places(form.layout):
            if isinstance(item, Fixed):
                self._fixed.append((at, item.bytes))
            elif isinstance(item, Length):
                expected = length_value(item, at, form.layout)
                self._fixed.append((at, expected.to_bytes(item.size, self._endian)))
            else:
                self._spans[item.is_] = slice(at, at + item.size)
            if isinstance(item, Taxels):
                self._values = item
            if isinstance(item, Clock):
                self.tick_s, self.tick_wrap = item.tick_s, 256**item.size
            if isinstance(item, Number) and item.is_ == "index":
                self.index_wrap, self.index_common = 256**item.size, True
        self._checksum = only(form.layout, Checksum)
        self._checksum_size = 0 if self._checksum is None else self._checksum.size
        self._packet = only(form.layout, PacketNumber)
        self.packets = 1 if self._packet is None else self._packet.of
        self.taxels = self._values.count * self.packets
        self.size = sum(map(size_of, form.layout))
        header, footer = (only(form.layout, Fixed, name) for name in ("header", "footer"))
        # What is looked for: a frame's beginning, or the end of the frame before.
        self.mark = header.bytes if header else footer.bytes if footer else b""
        self.before = 0 if header else len(self.mark) if footer else self.size
        unchecked = self._checksum is None
        self._lone = unchecked or (len(self.mark) > 1 and self._checksum_size == 1)
        self._open_ended = header is not None and footer is None and unchecked
        self._followed = self._open_ended and self.speaks
        # Bytes that show a frame, and those that show whether a mark within it is part of the data.
        self._shown = self.before + self.size + (len(self.mark) if self._followed else 0)
        steady = (_STEADY + 1) * self.size + len(self.mark)
        self.longest = steady if self._lone and self.mark else self._shown

    def decode(self, buffer: bytes | bytearray, start: int = 0) -> tuple[int, Frame | None]:
        """Look for a frame at `start`; see `Codec.decode`."""
        have, mark = len(buffer) - start, self.mark
        if mark:
            at = buffer.find(mark, start)
            if at < 0:
                return have - mark_begun(buffer, start, mark), None
            if at > start:
                return at - start, None
            if self._lone and (inner := self._mark_within(buffer, start)):
                steady = self._is_steady(buffer, start, inner)
                if not steady:
                    return (0 if steady is None else inner), None
        if have < self._shown:
            return 0, None
        first = start + self.before
        frame = bytes(buffer[first : first + self.size])
        if self._followed:
            ends = buffer.startswith(mark, first + self.size)
        else:
            ends = not (self._open_ended and mark_begun(frame, 0, mark))
        # Without any mark, the frame before must be right, too.
        follows = bool(mark) or self._agrees(bytes(buffer[start:first]))
        if not (ends and follows and self._agrees(frame)):
            return 1, None
        values = _read_values(frame[self._spans["taxels"]], self._values, self._endian)
        packet = self._number(frame, "packet")
        if self._packet is not None and packet is not None:
            packet -= self._packet.first
        sensible = (np.abs(self.to_kpa(values)) <= LARGEST).all()  # which the bits of a float need not be
        if not sensible or (packet is not None and not 0 <= packet < self.packets):
            return 1, None
        return self.size, Frame(
            values,
            self._number(frame, "address") or 0,
            self._number(frame, "index"),
            self._number(frame, "clock"),
            packet,
        )

    def encode(self, frame: Frame) -> bytes:
        """Write a frame as the device would, with all its packets; values are rounded and kept within their bits."""
        count = self._values.count
        return b"".join(
            self._encode(frame, frame.values[at * count : (at + 1) * count], at) for at in range(self.packets)
        )

    def from_kpa(self, pressures: FloatArray) -> FloatArray:
        """Turn kPa into the nearest values that fit the taxels' bits."""
        values = super().from_kpa(pressures)
        return np.clip(values if self._values.float else np.round(values), *_value_range(self._values))

    def dialogue(self, addresses: tuple[int, ...], counters: Counters) -> Dialogue:
        """Listen, or ask for each frame if the format says how; join frames that come in several packets."""
        if self.packets == 1:
            return super().dialogue(addresses, counters)
        return Joining(self.packets, counters, self.start, self.request, self.request_every_s)

    def fails_checksum(self, buffer: bytes | bytearray, start: int) -> bool:
        """Tell whether marks, lengths and fixed bytes of a frame agree at `start`, and the checksum does not."""
        if not self.mark or not buffer.startswith(self.mark, start):
            return False
        first = start + self.before
        frame = bytes(buffer[first : first + self.size])
        return len(frame) == self.size and self._fixed_agree(frame) and not self._sum_agrees(frame)

    def _mark_within(self, buffer: bytes | bytearray, start: int) -> int:
        """Find a mark behind that at `start` which is not the next frame's: returns how far, 0 if there is none."""
        # The next mark is due where the frame ends: a header behind it, or the footer that is its last bytes.
        due = start + self.size
        at = buffer.find(self.mark, start + 1, due + len(self.mark) - 1)
        return at - start if at >= 0 else 0

    def _is_steady(self, buffer: bytes | bytearray, start: int, inner: int) -> bool | None:
        """Tell whether a frame's mark and that `inner` bytes behind it come again; None if more bytes must tell."""
        for frame in range(1, _STEADY + 1):
            for at in (start + frame * self.size, start + frame * self.size + inner):
                if len(buffer) < at + len(self.mark):
                    return None
                if not buffer.startswith(self.mark, at):
                    return False
        return True

    def _encode(self, frame: Frame, values: FloatArray, packet: int) -> bytes:
        parts = bytearray(self.size)
        for at, content in self._fixed:
            parts[at : at + len(content)] = content
        numbers = {"address": frame.address, "index": frame.index or 0, "clock": int(frame.ticks or 0)}
        numbers["packet"] = packet + (0 if self._packet is None else self._packet.first)
        for name in numbers.keys() & self._spans.keys():
            span = self._spans[name]
            size = span.stop - span.start
            parts[span] = (numbers[name] % 256**size).to_bytes(size, self._endian)
        parts[self._spans["taxels"]] = _write_values(values, self._values, self._endian)
        if self._checksum is not None:
            parts[self._spans["checksum"]] = self._sum(parts)
        return bytes(parts)

    def _agrees(self, frame: bytes) -> bool:
        """Check what is known of a frame."""
        return self._fixed_agree(frame) and self._sum_agrees(frame)

    def _fixed_agree(self, frame: bytes) -> bool:
        return all(frame.startswith(content, at) for at, content in self._fixed)

    def _sum_agrees(self, frame: bytes) -> bool:
        return self._checksum is None or frame[self._spans["checksum"]] == self._sum(frame)

    def _sum(self, frame: bytes | bytearray) -> bytes:
        assert self._checksum is not None
        size, function = CHECKSUMS[self._checksum.kind]
        covered = bytes(frame[self._checksum.skip : self._spans["checksum"].start])
        return function(covered).to_bytes(size, self._checksum.endian or self._endian)

    def _number(self, frame: bytes, name: str) -> int | None:
        span = self._spans.get(name)
        return None if span is None else int.from_bytes(frame[span], self._endian)


class Joining(Listening):
    """A device whose frames come in several packets, in order and each with the frame's counter.

    A packet that is not the next one of its frame, or comes too late, voids what came before it.
    """

    def __init__(self, packets: int, *listening: Any) -> None:
        super().__init__(*listening)
        self._packets = packets
        # By address: packets so far, and when they came.
        self._open: dict[int, list[tuple[Frame, float]]] = {}

    def take(self, packet: Frame, began: float) -> Frame | None:
        """Keep a packet; returns its frame when it was the last one."""
        have = self._open.pop(packet.address, [])
        if have:
            first = have[0][0]
            in_time = began - have[-1][1] < PATIENCE
            if packet.packet != len(have) or packet.index != first.index or not in_time:
                self._counters.torn += 1
                have = []
        if packet.packet != len(have):
            return None
        have.append((packet, began))
        if len(have) < self._packets:
            self._open[packet.address] = have
            return None
        values = np.concatenate([part.values for part, _ in have])
        return super().take(replace(have[0][0], values=values, packet=None), have[0][1])

    def reset(self) -> None:
        """Forget the open question and the frames that are not complete."""
        super().reset()
        self._open.clear()


def _value_range(form: Taxels) -> tuple[float, float]:
    """Give the least and the greatest value that fits the bits."""
    if form.float:
        limit = float(np.finfo(np.float32).max)
        return -limit, limit
    if form.signed:
        return -(1 << form.bits - 1), (1 << form.bits - 1) - 1
    return 0, (1 << form.bits) - 1


def _read_values(data: bytes, form: Taxels, endian: Endian) -> FloatArray:
    """Read the normal value of each taxel: (count,)."""
    if form.bits in (8, 16, 32):
        values = np.frombuffer(data, dtype=_dtype(form, endian))
    else:
        stream = np.unpackbits(np.frombuffer(data, np.uint8), bitorder=endian)
        count = form.count * form.axes
        words = stream[: count * form.bits].reshape(count, form.bits).astype(np.int64)
        values = words @ _weights(form, endian)
        values = np.where(values > _value_range(form)[1], values - (1 << form.bits), values)
    return values.reshape(form.count, form.axes)[:, form.normal].astype(np.float64)


def _write_values(normal: FloatArray, form: Taxels, endian: Endian) -> bytes:
    """Write the normal value of each taxel, (count,), rounded and kept within its bits; other axes are 0."""
    values = np.zeros((form.count, form.axes))
    values[:, form.normal] = np.clip(normal if form.float else np.round(normal), *_value_range(form))
    if form.bits in (8, 16, 32):
        return values.astype(_dtype(form, endian)).tobytes()
    whole = values.reshape(-1, 1).astype(np.int64) % (1 << form.bits)
    bits = (whole // _weights(form, endian) % 2).astype(np.uint8)
    return np.packbits(bits.ravel(), bitorder=endian).tobytes()


def _dtype(form: Taxels, endian: Endian) -> str:
    kind = "f" if form.float else "i" if form.signed else "u"
    return f"{'>' if endian == 'big' else '<'}{kind}{form.bits // 8}"


def _weights(form: Taxels, endian: Endian) -> np.ndarray:
    """Say what each bit of a value counts, in the order in which the bits come."""
    ascending = 1 << np.arange(form.bits, dtype=np.int64)
    return ascending[::-1] if endian == "big" else ascending


def packing_of(data: bytes) -> str | None:
    """Tell whether bytes are packets of one length in SLIP (RFC 1055) or COBS, which no layout describes; None if not.

    SLIP ends a packet by C0, and writes C0 and DB in it as DB DC and DB DD. COBS ends it by 0, and each 0 in it is the
    count of bytes to the next one.
    """
    slip = [packet for packet in data.split(b"\xc0")[1:-1] if packet]
    plain = [packet.replace(b"\xdb\xdc", b"\xc0").replace(b"\xdb\xdd", b"\xdb") for packet in slip]
    escaped = any(len(bare) < len(packet) for bare, packet in zip(plain, slip, strict=True))
    if escaped and _alike(plain) and not any(re.search(rb"\xdb(?![\xdc\xdd])", packet) for packet in slip):
        return f"SLIP (C0 behind each), {len(plain[0])} bytes long"
    cobs = [packet for packet in data.split(b"\0")[1:-1] if packet]
    if not _alike(cobs):
        return None
    for packet in cobs:
        at = 0
        while at < len(packet):
            at += packet[at]
        if at != len(packet):
            return None
    return f"COBS (00 behind each), {len(cobs[0]) - 1} bytes long"


def _alike(packets: Sequence[bytes]) -> bool:
    return len(packets) >= _FEWEST_PACKETS and len({*map(len, packets)}) == 1 and len(packets[0]) > 2
