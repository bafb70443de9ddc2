"""`fields`: frames of a fixed layout that a device file describes, for devices whose owner knows theirs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, BeforeValidator, Field, PlainSerializer, model_validator

from tactsim.core.counters import Counters
from tactsim.core.poses import FloatArray
from tactsim.hardware.codecs.checksums import CHECKSUMS
from tactsim.hardware.codecs.codec import STRICT, Codec, CodecFormat, Dialogue, Frame, Listening

LONGEST_FRAME = 1 << 16  # bytes


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
FixedBytes = Annotated[Bytes, Field(min_length=1, max_length=64)]
Size = Literal[1, 2, 4]


class _Item(BaseModel):
    model_config = STRICT


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


class Skip(_Item):
    """Bytes that mean nothing here."""

    is_: Literal["skip"] = Field(alias="is")
    size: int = Field(ge=1, le=4096, description="bytes that mean nothing here")


class Taxels(_Item):
    """The measurements, `bits` each, packed without gaps and filled up to a whole byte.

    Packed 10 and 12 bits fill each byte from its high bit if the format is big-endian, else from its low.
    """

    is_: Literal["taxels"] = Field(alias="is")
    count: int = Field(ge=1, le=10_000, description="how many values a frame has")
    bits: Literal[8, 10, 12, 16] = Field(16, description="of each value, packed without gaps")
    signed: bool = Field(False, description="whether values may be negative (two's complement)")

    @property
    def size(self) -> int:
        """Count the bytes."""
        return (self.count * self.bits + 7) // 8


class Checksum(_Item):
    """A checksum of all bytes before it, but for the first `skip`."""

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


Item = Annotated[Fixed | Length | Number | Clock | Skip | Taxels | Checksum, Field(discriminator="is_")]


class FieldsFormat(CodecFormat):
    """The table `[codec]` of a device file with `kind = "fields"`.

    pressure in kPa = (value - zero) * kpa_per_count.
    """

    kind: Literal["fields"]
    layout: tuple[Item, ...] = Field(max_length=64, description="what a frame is made of, in its order")
    endian: Literal["big", "little"] = Field("big", description="which byte of a number comes first")
    zero: float = Field(0.0, description="value of an unloaded taxel")
    kpa_per_count: float = Field(description="kPa of one count; kPa = (value - zero) * kpa_per_count")
    start: Bytes = Field(b"", max_length=256, description="bytes that make the device speak, sent once")
    request: Bytes = Field(b"", max_length=256, description="bytes that ask for one frame")
    request_every_s: float = Field(
        0.0,
        ge=0,
        le=60,
        description="s from one request to the next, at least: no less than the device measures in",
    )

    @model_validator(mode="after")
    def _makes_sense(self) -> FieldsFormat:
        kinds = [item.is_ for item in self.layout]
        if not kinds or kinds[0] != "header":
            raise ValueError("the layout must begin with a header: without one no frame can be found")
        for kind in ("header", "footer", "taxels", "address", "index", "clock", "checksum"):
            if kinds.count(kind) > 1:
                raise ValueError(f"the layout has {kinds.count(kind)} items {kind!r}; one is allowed")
        if "taxels" not in kinds:
            raise ValueError("the layout has no item 'taxels'")
        if "footer" in kinds and kinds[-1] != "footer":
            raise ValueError("the footer must be the last item of the layout")
        if not self.kpa_per_count:
            raise ValueError("kpa_per_count must not be 0")
        if sum(_size(item) for item in self.layout) > LONGEST_FRAME:
            raise ValueError(f"a frame may have at most {LONGEST_FRAME} bytes")
        for item, at in _places(self.layout):
            if isinstance(item, Length) and not 0 <= _length(item, at, self.layout) < 256**item.size:
                raise ValueError(f"a length of {_length(item, at, self.layout)} does not fit its field")
            if isinstance(item, Checksum) and item.skip >= at:
                raise ValueError(f"the checksum skips {item.skip} bytes, but only {at} stand before it")
        return self

    def build(self) -> FieldsCodec:
        """Make the codec."""
        return FieldsCodec(self)


def _size(item: Item) -> int:
    return len(item.bytes) if isinstance(item, Fixed) else item.size


def _places(layout: tuple[Item, ...]) -> Iterator[tuple[Item, int]]:
    """List the items of a layout with the byte at which each begins."""
    at = 0
    for item in layout:
        yield item, at
        at += _size(item)


def _length(item: Length, at: int, layout: tuple[Item, ...]) -> int:
    """Compute what a length at byte `at` has to say."""
    total = sum(_size(each) for each in layout)
    taxels = next(each for each in layout if isinstance(each, Taxels))
    lengths = {
        "frame": total,
        "after": total - at - item.size,
        "taxels": taxels.count,
        "data": taxels.size,
    }
    return lengths[item.of] + item.plus


class FieldsCodec(Codec[Frame]):
    """Read and write frames of one described layout."""

    def __init__(self, form: FieldsFormat) -> None:
        self.format = form
        self._endian: Literal["big", "little"] = form.endian
        self._fixed: list[tuple[int, bytes]] = []  # behind the header; lengths are fixed bytes too
        self._spans: dict[str, slice] = {}
        self._checksum: Checksum | None = None
        for item, at in _places(form.layout):
            span = slice(at, at + _size(item))
            if isinstance(item, Fixed):
                self._fixed.append((at, item.bytes))
            elif isinstance(item, Length):
                expected = _length(item, at, form.layout)
                self._fixed.append((at, expected.to_bytes(item.size, self._endian)))
            else:
                self._spans[item.is_] = span
            if isinstance(item, Taxels):
                self._values, self.taxels = item, item.count
            if isinstance(item, Clock):
                self.tick_s, self.tick_wrap = item.tick_s, 256**item.size
            if isinstance(item, Number) and item.is_ == "index":
                self.index_wrap, self.index_common = 256**item.size, True
            if isinstance(item, Checksum):
                self._checksum = item
        self._header = self._fixed.pop(0)[1]
        # What each bit of a packed value counts, in the order in which the bits come.
        ascending = 1 << np.arange(self._values.bits, dtype=np.int64)
        self._weights = ascending[::-1] if self._endian == "big" else ascending
        self.size = sum(_size(item) for item in form.layout)
        self.speaks = not form.request
        # Without checksum and footer a header inside of garbage looks like a frame; then a frame counts
        # only if another header follows it. A device that is asked waits, so nothing follows.
        trailer = {"checksum", "footer"} & {item.is_ for item in form.layout}
        self._followed = self.speaks and not trailer
        self.longest = self.size + (len(self._header) if self._followed else 0)

    def decode(self, buffer: bytes | bytearray, start: int = 0) -> tuple[int, Frame | None]:
        """Look for a frame at `start`; see `Codec.decode`."""
        at = buffer.find(self._header, start)
        if at < 0:
            return len(buffer) - start - _beginning(buffer, start, self._header), None
        if at > start:
            return at - start, None
        if len(buffer) - start < self.longest:
            return 0, None
        frame = bytes(buffer[start : start + self.size])
        if not self._agrees(frame) or (
            self._followed and not buffer.startswith(self._header, start + self.size)
        ):
            return 1, None
        return self.size, Frame(
            self._read_values(frame[self._spans["taxels"]]).astype(np.float64),
            self._number(frame, "address") or 0,
            self._number(frame, "index"),
            self._number(frame, "clock"),
        )

    def encode(self, frame: Frame) -> bytes:
        """Write a frame as the device would; values are rounded and kept within their bits."""
        parts = bytearray(self.size)
        parts[: len(self._header)] = self._header
        for at, content in self._fixed:
            parts[at : at + len(content)] = content
        numbers = {"address": frame.address, "index": frame.index or 0, "clock": int(frame.ticks or 0)}
        for name, number in numbers.items():
            if name in self._spans:
                span = self._spans[name]
                size = span.stop - span.start
                parts[span] = (number % 256**size).to_bytes(size, self._endian)
        parts[self._spans["taxels"]] = self._write_values(frame.values)
        if self._checksum is not None:
            parts[self._spans["checksum"]] = self._sum(parts)
        return bytes(parts)

    def to_kpa(self, values: FloatArray) -> FloatArray:
        """Turn values into kPa by the format's zero and scale."""
        return (values - self.format.zero) * self.format.kpa_per_count

    def from_kpa(self, pressures: FloatArray) -> FloatArray:
        """Turn kPa into the nearest values that fit the taxels' bits."""
        low, high = self._range()
        return np.clip(np.round(pressures / self.format.kpa_per_count + self.format.zero), low, high)

    def dialogue(self, addresses: tuple[int, ...], counters: Counters) -> Dialogue:
        """Listen, or ask for each frame if the format says how."""
        form = self.format
        return Listening(counters, form.start, form.request, form.request_every_s)

    def fails_checksum(self, buffer: bytes | bytearray, start: int) -> bool:
        """Tell whether header, lengths and fixed bytes of a frame agree at `start`, and the checksum does not."""
        frame = bytes(buffer[start : start + self.size])
        whole = len(frame) == self.size and frame.startswith(self._header) and self._fixed_agree(frame)
        return whole and not self._sum_agrees(frame)

    def _agrees(self, frame: bytes) -> bool:
        """Check what is known of a frame besides its header."""
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

    def _range(self) -> tuple[int, int]:
        bits = self._values.bits
        return (-(1 << bits - 1), (1 << bits - 1) - 1) if self._values.signed else (0, (1 << bits) - 1)

    def _read_values(self, data: bytes) -> NDArray[np.int64]:
        bits, order = self._values.bits, ">" if self._endian == "big" else "<"
        if bits in (8, 16):
            kind = "i" if self._values.signed else "u"
            return np.frombuffer(data, dtype=f"{order}{kind}{bits // 8}").astype(np.int64)
        bit_order: Literal["big", "little"] = self._endian
        stream = np.unpackbits(np.frombuffer(data, np.uint8), bitorder=bit_order)
        words = stream[: self.taxels * bits].reshape(self.taxels, bits).astype(np.int64)
        values = words @ self._weights
        return np.where(values > self._range()[1], values - (1 << bits), values)

    def _write_values(self, values: FloatArray) -> bytes:
        low, high = self._range()
        whole = np.clip(np.round(values), low, high).astype(np.int64) % (1 << self._values.bits)
        bits, order = self._values.bits, ">" if self._endian == "big" else "<"
        if bits in (8, 16):
            return whole.astype(f"{order}u{bits // 8}").tobytes()
        words = (whole[:, None] // self._weights) % 2
        bit_order: Literal["big", "little"] = self._endian
        return np.packbits(words.astype(np.uint8).ravel(), bitorder=bit_order).tobytes()


def _beginning(buffer: bytes | bytearray, start: int, header: bytes) -> int:
    """Count the bytes at the buffer's end that could be the beginning of a header."""
    for length in range(min(len(header) - 1, len(buffer) - start), 0, -1):
        if buffer.endswith(header[:length]):
            return length
    return 0
