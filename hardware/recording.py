"""Recordings: everything that came from a device, in a file that can be read however the program ended.

The format, version 1. Numbers are little-endian.

    file      magic (12 bytes) | version u16 | records
    record    kind u8 | link u8 | 0 u16 | length u32 | time f64 | payload (length bytes) | CRC-32 u32

The CRC covers the record's header and payload. `time` is the host's monotonic clock in s. Kinds:

    1 segment    JSON: device file, calibration, urls, date, program version, what for. The first
                 record; another one begins where a session was taken up again
    2 received   bytes from a link          4 lost     a link was lost; what was half received is void
    3 sent       bytes to a link            5 mark     JSON: what a person or the program noted
    6 end        JSON: the counters. A recording without it was cut short
    7 reading    f64 device time or NaN, i64 index or -1, f64 pressures in kPa: of a source that has
                 no bytes to record

Records are only ever appended, each with one write. A reader stops before the first record that is
not whole, so what was written before a crash is read, and the recording is known as unfinished.
"""

from __future__ import annotations

import json
import math
import os
import struct
import zlib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from enum import IntEnum
from io import BufferedReader
from pathlib import Path
from threading import Lock
from types import TracebackType
from typing import Any

import numpy as np

from tactsim.core.documents import parse_json
from tactsim.core.errors import InputError
from tactsim.core.files import open_regular
from tactsim.core.reading import Reading

MAGIC = b"\x89TACTREC\r\n\x1a\n"
VERSION = 1
SUFFIX = ".tactrec"
LARGEST_PAYLOAD = 1 << 22  # bytes; a segment of a large pad is the largest record

_START = struct.Struct("<12sH")
_HEADER = struct.Struct("<BBHId")
_CRC = struct.Struct("<I")
_READING = struct.Struct("<dq")


class Kind(IntEnum):
    """What a record holds."""

    SEGMENT = 1
    RECEIVED = 2
    SENT = 3
    LOST = 4
    MARK = 5
    END = 6
    READING = 7


@dataclass(frozen=True)
class Record:
    """One record as it stands in the file."""

    kind: Kind
    link: int
    time: float
    payload: bytes

    @property
    def size(self) -> int:
        """Count the bytes that the record takes in the file."""
        return _HEADER.size + len(self.payload) + _CRC.size

    def json(self) -> dict[str, Any]:
        """Parse the payload of a segment, mark or end. Raises InputError if it is no JSON object."""
        return parse_json(self.payload, f"a record {self.kind.name.lower()}")

    def reading(self) -> Reading:
        """Unpack the payload of a reading. Raises InputError if it holds no whole reading."""
        size = len(self.payload) - _READING.size
        if size <= 0 or size % 8:
            raise InputError(f"a reading of {len(self.payload)} bytes is not whole")
        device_time, index = _READING.unpack_from(self.payload)
        pressures = np.frombuffer(self.payload, dtype="<f8", offset=_READING.size).copy()
        return Reading(
            pressures,
            self.time,
            None if math.isnan(device_time) else device_time,
            None if index < 0 else index,
        )


class Recorder:
    """Append to a recording. Each record reaches the operating system before the call returns."""

    def __init__(self, path: str | Path, append: bool = False) -> None:
        """Begin a new recording, or, with `append`, go on behind the whole part of one that exists.

        Raises InputError if `path` cannot be written, exists (without `append`) or is no recording.
        """
        self.path, self._lock = Path(path), Lock()
        self._file, self._begun = -1, append  # a new one has begun with its first record
        whole = check_whole(self.path).whole_bytes if append else 0
        flags = os.O_WRONLY | (0 if append else os.O_CREAT | os.O_EXCL)
        try:
            self._made = [folder for folder in self.path.parents if not folder.exists()]  # the deepest first
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = os.open(self.path, flags, 0o666)
            if append:
                os.ftruncate(self._file, whole)
                os.lseek(self._file, whole, os.SEEK_SET)
            else:
                self._put(_START.pack(MAGIC, VERSION))
        except FileExistsError:
            raise InputError(f"{self.path} exists; name another file") from None
        except OSError as error:
            if self._file >= 0 and not append:
                self.discard()
            raise InputError(f"cannot write {self.path}: {error.strerror or error}") from error

    def segment(self, content: Mapping[str, Any], time: float) -> None:
        """Say what follows: how the bytes are to be read."""
        self._json(Kind.SEGMENT, content, time)

    def received(self, link: int, data: bytes, time: float) -> None:
        """Record bytes that came from a link."""
        self.write(Kind.RECEIVED, link, time, data)

    def sent(self, link: int, data: bytes, time: float) -> None:
        """Record bytes that were sent to a link."""
        self.write(Kind.SENT, link, time, data)

    def lost(self, link: int, time: float) -> None:
        """Record that a link was lost."""
        self.write(Kind.LOST, link, time, b"")

    def reading(self, reading: Reading) -> None:
        """Record a reading of a source that has no bytes."""
        device_time = math.nan if reading.device_time is None else reading.device_time
        index = -1 if reading.index is None else reading.index
        content = _READING.pack(device_time, index) + reading.pressures.astype("<f8").tobytes()
        self.write(Kind.READING, 0, reading.host_time, content)

    def mark(self, content: Mapping[str, Any], time: float) -> None:
        """Record a note, and make sure that all so far is on the disk."""
        self._json(Kind.MARK, content, time)
        os.fsync(self._file)

    def end(self, counters: Mapping[str, int], time: float) -> None:
        """Mark the recording as finished and close it."""
        self._json(Kind.END, {"counters": dict(counters)}, time)
        os.fsync(self._file)
        self.close()

    def close(self) -> None:
        """Close the file; without `end` before, the recording is an unfinished one."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def discard(self) -> None:
        """Close and remove a recording that was begun in vain, with the folders that were made for it.

        So its name is free for another try.
        """
        self.close()
        self.path.unlink(missing_ok=True)
        for folder in self._made:
            with suppress(OSError):  # something else is in it
                folder.rmdir()

    def __enter__(self) -> Recorder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _json(self, kind: Kind, content: Mapping[str, Any], time: float) -> None:
        self.write(kind, 0, time, json.dumps(content, allow_nan=False).encode())

    def write(self, kind: Kind, link: int, time: float, payload: bytes) -> None:
        """Append one record of any kind.

        Raises InputError if it is too large or cannot be written; a recording whose first record cannot is removed.
        """
        if len(payload) > LARGEST_PAYLOAD:
            raise InputError(f"a record of {len(payload):,} bytes; at most {LARGEST_PAYLOAD:,} are allowed")
        body = _HEADER.pack(kind, link, 0, len(payload), time) + payload
        try:
            self._put(body + _CRC.pack(zlib.crc32(body)))
            self._begun = True
        except OSError as error:
            if not self._begun:
                self.discard()
            raise InputError(f"cannot write {self.path}: {error.strerror or error}") from error

    def _put(self, content: bytes) -> None:
        view = memoryview(content)
        with self._lock:  # a person's commands come in another thread than the readings
            while view:  # a write to a file is short only when the disk is nearly full
                view = view[os.write(self._file, view) :]


@dataclass(frozen=True)
class Whole:
    """How much of a recording is whole.

    whole_bytes, records: up to where it is. finished: whether it ends with the record that says so.
    fault: why reading stopped before the end of the file, or None.
    """

    whole_bytes: int
    records: int
    finished: bool
    fault: str | None


class RecordReader:
    """Read a recording's records in order, from byte `at` on; after the last one, `whole` says how the file ended."""

    def __init__(self, path: str | Path, at: int = 0) -> None:
        self.path = Path(path)
        self.whole = Whole(at, 0, False, None)

    def __iter__(self) -> Iterator[Record]:
        """Give the whole records. Raises InputError if the file cannot be read or is no recording."""
        try:
            with open_regular(self.path) as stream:
                size = os.fstat(stream.fileno()).st_size
                start = stream.read(_START.size)
                if len(start) < _START.size or not start.startswith(MAGIC):
                    raise InputError(
                        "it is no recording of `bench record`, and no text; of arrays write a table with a line a "
                        "frame, 'time [s],t0,t1,...', or give `bench import` a folder of them, a press each"
                    )
                version = _START.unpack(start)[1]
                if version != VERSION:
                    raise InputError(f"it has format version {version}; this program reads version {VERSION}")
                yield from self._records(stream, size)
        except OSError as error:
            raise InputError(f"cannot read recording {self.path}: {error.strerror or error}") from error
        except InputError as error:
            raise InputError(f"cannot read recording {self.path}: {error}") from error

    def _records(self, stream: BufferedReader, size: int) -> Iterator[Record]:
        at, records, finished = max(self.whole.whole_bytes, _START.size), 0, False
        fault = None
        stream.seek(at)
        while at < size:
            record = _read_record(stream, size - at)
            if isinstance(record, str):
                fault = f"record {records} at byte {at:,} {record}"
                break
            at += record.size
            records += 1
            finished = record.kind is Kind.END
            self.whole = Whole(at, records, finished, None)
            yield record
        self.whole = Whole(at, records, finished and fault is None, fault)


class Tail:
    """Follow a recording while another program writes it."""

    def __init__(self, path: str | Path) -> None:
        self._path, self._at = Path(path), 0

    def poll(self) -> list[Record]:
        """Return the records that have become whole since the last call; none while there is no file."""
        if not self._path.exists() or self._path.stat().st_size < _START.size:
            return []
        reader = RecordReader(self._path, self._at)
        records = list(reader)
        self._at = reader.whole.whole_bytes
        return records


def check_whole(path: str | Path) -> Whole:
    """Read a recording through and say how much of it is whole. Raises InputError if it is no recording."""
    reader = RecordReader(path)
    for _ in reader:
        pass
    return reader.whole


def _read_record(stream: BufferedReader, left: int) -> Record | str:
    """Read one record of at most `left` bytes; returns what is wrong with it if it is not whole."""
    header = stream.read(_HEADER.size)
    if len(header) < _HEADER.size:
        return "is cut short"
    kind, link, zero, length, time = _HEADER.unpack(header)
    if kind not in Kind._value2member_map_ or zero or not math.isfinite(time):
        return "is damaged"
    if length > LARGEST_PAYLOAD:
        return f"claims {length:,} bytes; at most {LARGEST_PAYLOAD:,} are allowed"
    if _HEADER.size + length + _CRC.size > left:
        return "is cut short"
    payload = stream.read(length)
    crc = stream.read(_CRC.size)
    if len(crc) < _CRC.size or _CRC.unpack(crc)[0] != zlib.crc32(payload, zlib.crc32(header)):
        return "is damaged"
    return Record(Kind(kind), link, time, payload)
