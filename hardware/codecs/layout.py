"""What a frame of `fields` is made of: its items in their order, where each begins, and what makes no sense."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal, TypeVar

from pydantic import BaseModel, Field, model_validator

from tactsim.hardware.codecs.checksums import CHECKSUMS
from tactsim.hardware.codecs.codec import STRICT, Bytes

LONGEST_FRAME = 1 << 16  # bytes
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
