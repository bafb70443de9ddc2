"""Recordings as sources: the same bytes through the same codec give the same readings."""

from __future__ import annotations

import gzip
import re
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from io import BufferedReader, TextIOWrapper
from pathlib import Path
from typing import Any

import numpy as np

from tactsim.core.checking import checked
from tactsim.core.counters import Counters
from tactsim.core.documents import encoding_of
from tactsim.core.errors import InputError, counted, short
from tactsim.core.files import open_regular
from tactsim.core.reading import Reading
from tactsim.core.source import Log, Source, SourceEnded, SourceError
from tactsim.hardware.calibration import Calibration, Correction
from tactsim.hardware.clock import DeviceClock
from tactsim.hardware.codecs.codec import Frame
from tactsim.hardware.codecs.pps_csv import CsvFormat, read_table
from tactsim.hardware.device import UNREAD, Device
from tactsim.hardware.recording import Kind, Record, RecordReader, Whole, is_recording
from tactsim.hardware.stream import Stream


class Replay(Source):
    """The readings of a recording, in the order in which they came, and its notes.

    corrected: whether by the calibration that was recorded, as they were seen then. read_as: the device by which
    the bytes are read instead of the recorded one, such as for another axis of each taxel; its pad must be the same.
    device: of the segment that is being read. segments: how many have begun. whole: how the file ended, once it was
    read through. on_note(kind, content, readings): called for every segment, mark and end with how many readings
    came before it.
    """

    def __init__(
        self,
        path: str | Path,
        corrected: bool = True,
        read_as: Device | None = None,
        on_note: Callable[[Kind, dict[str, Any], int], None] | None = None,
    ) -> None:
        """Open a recording and read its first segment.

        Raises InputError if it is no recording or its first segment makes no sense.
        """
        self.path = Path(path)
        self.counters = Counters()
        self.calibrated = False
        self.segments = self.marks = 0
        self._first: dict[str, Any] = {}
        self._corrected, self._read_as = corrected, read_as
        self._correction: Correction | None = None
        self._given = 0  # readings of all segments so far
        self._on_note = on_note
        self._reader = RecordReader(self.path)
        self._records: Iterator[Record] = iter(self._reader)
        self._ready: deque[Reading] = deque()
        first = next(self._records, None)
        if first is None or first.kind is not Kind.SEGMENT:
            raise SourceError(f"{self.path} is a recording without a beginning: nothing in it can be read")
        self._take(first)

    @property
    def whole(self) -> Whole:
        """Say how much of the file was whole, as far as it was read."""
        return self._reader.whole

    def read(self, timeout: float | None = None) -> Reading:
        """Return the next reading at once; see `Source.read`."""
        while not self._ready:
            record = next(self._records, None)
            if record is None:
                raise SourceEnded(f"{self.path} has no more readings")
            self._take(record)
        return self._ready.popleft()

    def summary(self) -> list[str]:
        """Say how much of the file is whole and what was recorded, as far as it was read."""
        first, whole = self._first, self._reader.whole
        state = "finished" if whole.finished else f"unfinished: {whole.fault or 'what wrote it was ended'}"
        lines = [f"{whole.records:,} records, {whole.whole_bytes:,} bytes, {state}"]
        lines += [f"{first.get('device', {}).get('name')} at {first.get('urls')}, {first.get('started')}"]
        if isinstance(plan := first.get("plan"), dict):
            poses = plan.get("poses")
            lines.append(
                f"a session of {plan.get('label')!r} ({plan.get('split')}): {self.marks} marks, "
                f"{len(poses) if isinstance(poses, list) else 0} presses planned"
            )
        if self.segments > 1:
            lines.append(f"{self.segments} segments")
        return lines

    def close(self) -> None:
        """Stop reading the file."""
        self._records = iter(())
        self._ready.clear()

    def _take(self, record: Record) -> None:
        try:
            if record.kind is Kind.SEGMENT:
                self._begin(record.json())
            elif record.kind in (Kind.MARK, Kind.END):
                self._note(record.kind, record.json())
            elif record.kind is Kind.READING:
                self.counters.readings += 1
                self._give([record.reading()])
            elif record.link >= self.device.ports:
                raise InputError(f"link {record.link} of a device with {self.device.ports}")
            elif self._stream is None:
                raise InputError("bytes of a device that has no [codec]")
            elif record.kind is Kind.SENT:
                self._stream.sent(record.link, record.payload, record.time)
            elif record.kind is Kind.LOST:
                self._stream.lost(record.link, record.time)
            else:
                self._give(self._stream.received(record.link, record.payload, record.time))
        except InputError as error:
            raise SourceError(f"{self.path}: {error}") from error

    def _begin(self, content: dict[str, Any]) -> None:
        device = checked(Device, content.get("device"), "device of a segment")
        if self._read_as is not None:
            if self._read_as.pad != device.pad:
                raise InputError(f"it was recorded with another pad than that of {self._read_as.name!r}")
            device = self._read_as
        if self.segments and device.pad != self.pad:
            raise InputError("its segments were recorded with different pads")
        self.device, self.pad = device, device.pad
        self._correct(content.get("calibration"))
        # Its clocks and frame counters begin anew. Without a codec its readings were recorded, not its bytes.
        self._stream = None if device.codec is None else Stream(device, self.counters)
        self.unit = "kPa" if device.codec is None else device.codec.reading_unit
        self._first = self._first or content
        self.segments += 1
        self._note(Kind.SEGMENT, content)

    def _correct(self, content: Any) -> None:
        """Correct what follows by the calibration that was recorded with it."""
        self.calibrated = self._corrected and content is not None
        self._correction = None
        if self.calibrated:
            calibration = checked(Calibration, content, "calibration of a segment")
            self._correction = Correction(calibration, self.pad)
        taxel_xy = self.pad.taxel_xy if self._correction is None else self._correction.taxel_xy
        if self.segments and not np.array_equal(taxel_xy, self.taxel_xy):
            raise InputError("its segments leave out different taxels; `bench replay --scan` can join them")
        self.taxel_xy = taxel_xy

    def _give(self, readings: list[Reading]) -> None:
        for reading in readings:
            if len(reading.pressures) != self.pad.taxels:
                raise InputError(
                    f"a reading of {len(reading.pressures)} taxels; the pad has {self.pad.taxels}"
                )
        correction = self._correction
        self._ready.extend(readings if correction is None else map(correction.apply, readings))
        self._given += len(readings)

    def _note(self, kind: Kind, content: dict[str, Any]) -> None:
        self.marks += kind is Kind.MARK
        if self._on_note is not None:
            self._on_note(kind, content, self._given)


class CsvReplay(Source):
    """The readings of a recording of the vendor's tool. Their host time is the device's: there is no other."""

    def __init__(self, path: str | Path, device: Device) -> None:
        """Open the file, which may be packed by gzip. Raises InputError if it has another number of taxels."""
        self.path, self.device = Path(path), device
        self.pad, self.taxel_xy = device.pad, device.pad.taxel_xy
        if not isinstance(device.codec, CsvFormat):
            raise SourceError(f"{self.path}: reading it needs a device file with the codec kind 'pps-csv'")
        if len(device.part) > 1:
            raise SourceError(f"{self.path}: {device.name!r} has {len(device.part)} parts; a CSV has one")
        self.unit = device.codec.reading_unit
        self.counters = Counters()
        self._codec, self._wiring = device.build_codec(), device.wiring(device.part[0])
        self._clock, self._first_out = DeviceClock(1.0, None), ""
        try:
            self._file = open_regular(self.path)
        except InputError as error:
            raise SourceError(f"cannot read recording {self.path}: {error}") from error
        try:
            packed = self._file.peek(2)[:2] == b"\x1f\x8b"
            lines = BufferedReader(gzip.GzipFile(fileobj=self._file)) if packed else self._file
            self._texts = TextIOWrapper(lines, encoding_of(lines.peek(2)), errors="replace")
            taxels, self._frames, self._remark = read_table(self._texts)
            if taxels != device.codec.taxels:
                raise SourceError(f"it has {taxels} taxels, {device.name!r} has {device.codec.taxels}")
        except (InputError, OSError, EOFError) as error:
            self._file.close()
            raise SourceError(f"cannot read recording {self.path}: {error}") from error

    def read(self, timeout: float | None = None) -> Reading:
        """Return the next reading at once; see `Source.read`."""
        try:
            for frame in () if self._file.closed else self._frames:
                if isinstance(frame, Frame):
                    return self._reading(frame)
                self.counters.resyncs += 1
                self._first_out = self._first_out or frame.strip()
        except (OSError, EOFError) as error:
            raise SourceError(f"{self.path}: {error}") from error
        raise SourceEnded(f"{self.path} has no more readings")

    def summary(self) -> list[str]:
        """Say how the time was read where its title does not say it, and which lines were no readings."""
        left = f"{counted(self.counters.resyncs, 'line')} left out as no reading, the first {short(self._first_out)}"
        return [*filter(None, [self._remark]), *([left] if self._first_out else [])]

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _reading(self, frame: Frame) -> Reading:
        assert frame.seconds is not None
        restarts = self._clock.restarts
        seconds = self._clock.seconds(frame.seconds, 0.0)
        read = self._wiring != UNREAD
        pressures = np.empty(self.pad.taxels)
        pressures[self._wiring[read]] = self._codec.to_kpa(frame.values)[read]
        self.counters.frames += 1
        self.counters.readings += 1
        after_loss = self._clock.restarts > restarts
        self.counters.clock_restarts += after_loss
        return Reading(self.device.cells(pressures), seconds, seconds, None, after_loss)


def open_source(places: Sequence[str], device: Device, log: Log | None) -> Source:
    """Open a recording; one of this program brings its own device along."""
    if len(places) != 1:
        raise SourceError(f"a recording is one file; {len(places)} were given")
    text = re.search(r"\.(csv|tsv|txt|asc|lvm)(\.gz)?$", places[0], re.IGNORECASE)
    return Replay(places[0]) if text is None or is_recording(places[0]) else CsvReplay(places[0], device)
