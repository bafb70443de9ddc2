"""Device files: which codec, which pad, and how the parts of a pad are wired."""

from __future__ import annotations

import json
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, model_validator

from tactsim.core.checking import checked
from tactsim.core.documents import parse_toml, read_toml
from tactsim.core.errors import InputError, unknown
from tactsim.core.matrix import mixed, unmixed
from tactsim.core.pad import Pad
from tactsim.core.poses import FloatArray
from tactsim.hardware.codecs.codec import STRICT, Codec, CodecError
from tactsim.hardware.codecs.codec_registry import Format

UNREAD = -1
_NEARLY_SHORT = 0.999  # of the full reading: what a cell reads at most


class Part(BaseModel):
    """One of the devices that together make a pad."""

    model_config = STRICT

    port: int = Field(0, ge=0, le=15, description="which of the ports given, from 0")
    address: int | None = Field(
        None,
        ge=0,
        description="which device on the port; none: the codec's usual one (singletact 4, others 0)",
    )
    taxels: tuple[int, ...] | None = Field(
        None,
        max_length=10_000,
        description="for each value of the device the pad's taxel, or -1 if it is not read; none: all in order",
    )
    first_row: Literal["bottom", "top"] = Field(
        "bottom", description="which row of the pad the device sends first, if `taxels` are not given"
    )

    first_column: Literal["left", "right"] = Field(
        "right",
        description="which column, seen from above the pad, the device sends first, if `taxels` are not given",
    )

    @model_validator(mode="after")
    def _one_order(self) -> Part:
        if self.taxels is not None and (self.first_row, self.first_column) != ("bottom", "right"):
            raise ValueError("taxels say the order already: leave out first_row and first_column")
        return self


class Matrix(BaseModel):
    """A resistive sheet between rows and columns of wire without guards, whose cross-talk is taken out of readings.

    A row is driven and a column is read. With `idle = "free"` all other wires hang free, as behind two multiplexers;
    with "ground" the other rows are at ground and every column has a resistor to ground, as on the pins of a
    microcontroller.
    """

    model_config = STRICT

    idle: Literal["free", "ground"] = Field(
        "free", description="where rows are that are not driven; with ground each column has its own resistor"
    )
    full_kpa: float | None = Field(
        None,
        gt=0,
        le=1e9,
        description="kPa that a short circuit reads, where a resistor to ground measures; none: currents are measured",
    )
    least_kpa: float = Field(
        0.1, gt=0, le=1e4, description="kPa: no cell conducts less than one that reads this alone"
    )

    @model_validator(mode="after")
    def _measurable(self) -> Matrix:
        if self.idle == "ground" and self.full_kpa is None:
            raise ValueError(
                "idle rows at ground matter only where resistors measure: state full_kpa, or leave [matrix] out"
            )
        return self

    def cells(self, read: FloatArray) -> FloatArray:
        """Find what each cell would read alone, from what is read of all, (rows, columns) kPa; see `core.matrix`."""
        if self.full_kpa is not None:  # V / V0 = Y R / (1 + Y R) of a conductance Y over a resistor R
            # With rows at ground Y in the denominator is that of the whole column, whose readings' sum gives it.
            whole = read.sum(axis=0) if self.idle == "ground" else read
            read = read / (1 - np.clip(whole / self.full_kpa, 0, _NEARLY_SHORT))
        return np.maximum(read, self.least_kpa) if self.idle == "ground" else unmixed(read, self.least_kpa)

    def read(self, cells: FloatArray) -> FloatArray:
        """Undo `cells`: what is read of cells (rows, columns) that would read this alone, kPa."""
        cells = np.maximum(cells, self.least_kpa)
        read = cells if self.idle == "ground" else mixed(cells)
        if self.full_kpa is None:
            return read
        return read / (1 + (read.sum(axis=0) if self.idle == "ground" else read) / self.full_kpa)


class Device(BaseModel):
    """A pad and the way its readings come: the content of a device file (TOML)."""

    model_config = STRICT

    name: str = Field(min_length=1, max_length=200, description="how messages call the device")
    baud: int = Field(115_200, ge=50, le=20_000_000, description="bits a second of a serial port")
    settle: float = Field(
        0.0, ge=0, le=120, description="s after opening in which the device starts and its bytes mean nothing"
    )
    deadline: float = Field(1.0, gt=0, le=600, description="s within which a reading must come")
    touch_kpa: float = Field(2.0, gt=0, le=1e4, description="kPa above which a taxel is touched")
    largest_offset_kpa: float = Field(
        10.0, gt=0, le=1e5, description="kPa that an unloaded taxel may read before the tare"
    )
    pair_within_s: float | None = Field(
        None,
        gt=0,
        le=10,
        description="s within which the parts' frames of one reading are measured; none: their counters are equal",
    )
    codec: Format | None = None
    pad: Pad = Field(default_factory=Pad)
    matrix: Matrix | None = Field(None, exclude_if=lambda matrix: matrix is None)
    part: tuple[Part, ...] = Field((Part(),), min_length=1, max_length=64)

    @model_validator(mode="after")
    def _wired(self) -> Device:
        owner: dict[int, int] = {}
        codec = None if self.codec is None else self.build_codec()
        for number, part in enumerate(self.part):
            taxels = self.wiring(part)
            if codec is not None and len(taxels) != codec.taxels:
                raise ValueError(
                    f"part {number} lists {len(taxels)} taxels, but the codec's frames have {codec.taxels}"
                )
            for taxel in taxels.tolist():
                if taxel == UNREAD:
                    continue
                if not 0 <= taxel < self.pad.taxels:
                    raise ValueError(
                        f"part {number}: taxel {taxel} is not on the pad; use 0 to {self.pad.taxels - 1}, "
                        "or -1 for one that is not read"
                    )
                if taxel in owner:
                    raise ValueError(f"taxel {taxel} of the pad is in parts {owner[taxel]} and {number}")
                owner[taxel] = number
        if self.matrix is not None and codec is None:
            raise ValueError(
                "[matrix] takes cross-talk out of what a [codec] reads; an installed source does it by itself, with "
                "tactsim.core.matrix"
            )
        missing = sorted(set(range(self.pad.taxels)) - set(owner))
        if missing:
            raise ValueError(f"taxel {missing[0]} of the pad is in no part")
        places = [self.place(part) for part in self.part]
        if len(set(places)) < len(places):
            raise ValueError("two parts have the same port and address")
        if sorted({part.port for part in self.part}) != list(range(self.ports)):
            raise ValueError("ports must be numbered 0, 1, 2 ... without a gap")
        counted = codec is None or (codec.index_common and (codec.index_wrap or 0) > 256)
        if len(self.part) > 1 and self.pair_within_s is None and not counted:
            raise ValueError(
                f"the pad has {len(self.part)} parts, and their frames have no counter of two bytes or more that they "
                "share: state pair_within_s, the s within which the frames of one reading are measured"
            )
        if codec is not None and len(self.part) > 1 and codec.packets > 1 and self.pair_within_s is not None:
            raise ValueError(
                "frames in several packets have no one time; those of several parts are joined by their counter: "
                "leave out pair_within_s"
            )
        return self

    @property
    def ports(self) -> int:
        """Count the ports that the pad needs."""
        return 1 + max(part.port for part in self.part)

    def build_codec(self) -> Codec[Any]:
        """Make the codec. Raises CodecError if the device has none, since an installed source brings its readings."""
        if self.codec is None:
            raise CodecError(
                f"{self.name!r} has no [codec]: its readings come from an installed source, not from a port"
            )
        return self.codec.build()

    def read_by(self) -> str:
        """Give a digest of what turns values into pressures of taxels: a tare holds for no other."""
        said = {name: value for name, value in self.as_json().items() if name in ("codec", "matrix", "part")}
        said |= {"rows": self.pad.rows, "columns": self.pad.columns}
        return sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()[:16]

    def as_json(self) -> dict[str, Any]:
        """Describe the device as a device file does, for a recording."""
        return self.model_dump(mode="json", by_alias=True)

    def cells(self, read: FloatArray) -> FloatArray:
        """Take a matrix's cross-talk, if the pad is one, out of a reading of all taxels (taxels,) kPa."""
        if self.matrix is None:
            return read
        return self.matrix.cells(read.reshape(self.pad.rows, self.pad.columns)).ravel()

    def place(self, part: Part) -> tuple[int, int]:
        """Give the port and the address of a part."""
        usual = 0 if self.codec is None else self.codec.usual_address
        return part.port, usual if part.address is None else part.address

    def taxel_names(self) -> list[str]:
        """Name the pad's taxels; where the device has another order, with its value that each is: 7 (value 2)."""
        names, several = list(map(str, range(self.pad.taxels))), len(self.part) > 1
        wired = [self.wiring(part).tolist() for part in self.part]
        if wired == [list(range(self.pad.taxels))]:
            return names
        for number, taxels in enumerate(wired):
            for value, taxel in enumerate(taxels):
                if taxel != UNREAD:
                    names[taxel] = f"{taxel} (value {value}" + (f" of part {number})" if several else ")")
        return names

    def called(self, *taxels: int) -> str:
        """List taxels of the pad by their names."""
        return ", ".join(map(self.taxel_names().__getitem__, taxels))

    def wiring(self, part: Part) -> NDArray[np.int64]:
        """List for each taxel of a part the pad's taxel that it is, or -1."""
        if part.taxels is None:
            rows = np.arange(self.pad.taxels).reshape(self.pad.rows, self.pad.columns)
            rows = rows[::-1] if part.first_row == "top" else rows
            return (rows[:, ::-1] if part.first_column == "left" else rows).ravel()  # +x is to the left
        return np.array(part.taxels, dtype=np.int64)


def built_in_devices() -> tuple[str, ...]:
    """List the device files that come with the project."""
    folder = files("tactsim.hardware") / "devices"
    return tuple(sorted(entry.name[:-5] for entry in folder.iterdir() if entry.name.endswith(".toml")))


def load_device(name: str | Path) -> Device:
    """Read a device file (TOML), or one of the built-in ones by its name: what `--pad` takes everywhere.

    A file with a pad's measures alone (`Pad.load`) is a device without a codec, called after the file.
    Raises InputError if there is none, or with the first value in it that is wrong.
    """
    path = Path(name)
    if path.suffix != ".toml":
        if str(name) == "paper":
            raise InputError("unknown device 'paper': the paper's pad is called 'emulated'")
        if str(name) not in built_in_devices():
            raise unknown("device", str(name), (*built_in_devices(), "FILE.toml"))
        content = (files("tactsim.hardware") / "devices" / f"{name}.toml").read_bytes()
        return checked(Device, parse_toml(content, f"device {name}"), f"device {name}")
    table = read_toml(path, "device file")
    if "tare" in table:
        raise InputError(f"{path} is a calibration, and no device file: give it with --calibration")
    if table.keys() & {"no_seam", *Pad.model_fields}:
        return Device(name=path.stem, pad=checked(Pad, table, f"pad {path}"))
    return checked(Device, table, f"device file {path}")
