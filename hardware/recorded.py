"""Recordings as sources: the same bytes through the same codec give the same readings."""

from __future__ import annotations

import gzip
import re
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
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
from tactsim.hardware.codecs.codec import Frame
from tactsim.hardware.codecs.lines import LinesFormat, is_text, numbers_in, split_line
from tactsim.hardware.codecs.pps_csv import CsvFormat, read_table
from tactsim.hardware.device import Device, load_device
from tactsim.hardware.recording import MAGIC, SUFFIX, Kind, Record, RecordReader, Whole
from tactsim.hardware.stream import DeviceClock, Stream
from tactsim.hardware.text_tables import check_taxel_names, frames_of_text

_HEAD = 4096  # bytes of a file, which tell whether it is a text
_HALF_DAY = 43_200  # s, after which a clock of twelve hours starts again
# A time of day before a line, as terminals note it: `12:00:01.123 -> `, `[2026-11-27 12:00:01]`, `Nov 27 12:00:01`.
_STAMP = re.compile(
    r"(?:\x1b\[[\d;]*m)?[\[(\s\"]*(?:[\w/.-]{1,12}[ T]){0,4}"
    r"(\d?\d):(\d\d):(\d\d(?:[.:]\d{1,9}|,\d{3}(?=[ \]]))?)(?:Z| ?[AaPp][Mm])?(?: \d{4}(?=\]))?[\])]? *(?:->|>)?"
)


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
        self.calibration: Calibration | None = None  # that corrects
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
        urls = ", ".join(map(str, first.get("urls", ())))
        lines += [f"{first.get('device', {}).get('name')} at {urls}, {first.get('started')}"]
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
                reading = record.reading()
                if len(reading.pressures) != self.pad.taxels:
                    raise InputError(
                        f"a reading of {len(reading.pressures)} taxels; the pad has {self.pad.taxels}"
                    )
                self._give([reading])
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
        self._correction = self.calibration = None
        if self.calibrated:
            self.calibration = checked(Calibration, content, "calibration of a segment")
            self._correction = Correction(self.calibration, self.pad)
        taxel_xy = self.pad.taxel_xy if self._correction is None else self._correction.taxel_xy
        if self.segments and not np.array_equal(taxel_xy, self.taxel_xy):
            raise InputError("its segments leave out different taxels; `bench replay --scan` can join them")
        self.taxel_xy = taxel_xy

    def _give(self, readings: list[Reading]) -> None:
        correction = self._correction
        self._ready.extend(readings if correction is None else map(correction.apply, readings))
        self._given += len(readings)

    def _note(self, kind: Kind, content: dict[str, Any]) -> None:
        self.marks += kind is Kind.MARK
        if kind is Kind.MARK and "calibration" in content:  # a tare that was taken in the session
            self._correct(content["calibration"])
        if self._on_note is not None:
            self._on_note(kind, content, self._given)


class CsvReplay(Source):
    """The readings of a text: of the vendor's tool, or of lines as the device printed them and a terminal kept them.

    Their host time is the device's, or where a time of day stands before lines, the terminal's.
    """

    def __init__(self, path: str | Path, device: Device, log: Log | None = None) -> None:
        """Open the file, which may be packed by gzip. Raises InputError if it has another number of taxels."""
        self.path, self.device, self._log = Path(path), device, log
        self.pad, self.taxel_xy = device.pad, device.pad.taxel_xy
        if len(device.part) > 1:
            raise SourceError(
                f"{self.path}: a text is of a pad in one part, and {device.name!r} has {len(device.part)}: name the "
                "device file of its pad, --device FILE.toml"
            )
        self.has_bytes = isinstance(device.codec, LinesFormat)
        self._stream = Stream(device)
        self.counters = self._stream.counters
        self.unit = "kPa" if device.codec is None else device.codec.reading_unit
        self._remark: str | None = None
        self._out, self._first_out = 0, ""
        self._texts = open_text(self.path)
        try:
            if isinstance(device.codec, LinesFormat):
                self._readings = self._of_lines(device.codec)
            elif isinstance(device.codec, CsvFormat):
                names, frames, self._remark = read_table(self._texts, device.codec.unit)
                if device.part[0].taxels is None:  # which would say the order
                    check_taxel_names(names, device.codec.unit)
                if len(names) != device.codec.taxels:
                    raise SourceError(
                        f"it has {len(names)} taxels, {device.name!r} has {device.codec.taxels}"
                    )
                self._readings = self._of_table(frames)
            else:
                raise SourceError(
                    "it needs a device file with the codec kind 'pps-csv', or 'csv' for lines as a device prints them; "
                    f"`bench probe --port recording:{self.path}` says which lines these are"
                )
        except (InputError, OSError, EOFError) as error:
            self._texts.close()
            raise SourceError(f"cannot read recording {self.path}: {error}") from error

    def read(self, timeout: float | None = None) -> Reading:
        """Return the next reading at once; see `Source.read`."""
        try:
            reading = None if self._texts.closed else next(self._readings, None)
        except (OSError, EOFError) as error:
            raise SourceError(f"{self.path}: {error}") from error
        if reading is None:
            raise SourceEnded(f"{self.path} has no more readings")
        return reading

    def summary(self) -> list[str]:
        """Say how the time was read where its title does not say it, and which lines were no readings."""
        left = f"{counted(self._out, 'line')} left out as no reading, the first {short(self._first_out)}"
        return [*filter(None, [self._remark]), *([left] if self._out else [])]

    def close(self) -> None:
        """Close the file."""
        self._texts.close()

    def _leave_out(self, text: str) -> None:
        self._out += 1
        self._first_out = self._first_out or text.strip()

    def _of_table(self, frames: Iterator[Frame | str]) -> Iterator[Reading]:
        self._stream.clock, (_, address) = DeviceClock(1.0, None), self.device.place(self.device.part[0])
        for frame in frames:
            if isinstance(frame, str):
                self.counters.resyncs += 1
                self._leave_out(frame)
            elif reading := self._stream.join(0, replace(frame, address=address), 0.0, 0.0, 0.0):
                yield replace(reading, host_time=reading.device_time or 0.0)

    def _of_lines(self, codec: LinesFormat) -> Iterator[Reading]:
        """Read lines as they came; times before them are the terminal's unless the device file skips a column.

        The first line may be the rest of one. It is taken for whole where neither terminal nor device note a time, as
        in a file that begins with its first frame.
        """
        clock, now, begin, waiting = DeviceClock(1.0, _HALF_DAY), None, b"\n", ""
        for text in _ended(self._texts):
            garbage, restarts, stamp = self.counters.garbage_bytes, clock.restarts, _STAMP.match(text)
            if stamp:
                hours, minutes, seconds = (float(re.sub("[:,]", ".", part)) for part in stamp.groups())
                now = clock.seconds(3600 * hours + 60 * minutes + seconds, 0.0)
                if clock.restarts > restarts:
                    self._stream.lost(0, now)
            line = text[stamp.end() if stamp and "skip" not in codec.before else 0 :].encode()
            fields = split_line(line, codec.decimal) if begin else []
            of_rows = 0 < len(fields) < codec.taxels and numbers_in(fields, codec.base) is not None
            line, begin = (b"" if codec.before or stamp else begin * (1 + of_rows)) + line, b""
            if self._log is not None:
                self._log.received(0, line, now or 0.0)
            received = self._stream.received(0, line, now or 0.0)
            for reading in received:
                if now is None and reading.device_time is None:
                    self._remark = "no time stands before its lines, and none in them"
                yield reading if now is not None else replace(reading, host_time=reading.device_time or 0.0)
            if text.strip() and self.counters.garbage_bytes > garbage:
                self._leave_out(waiting if received and waiting else text)
            # Of a line of words the next one tells whether it begins the rows of a frame.
            waiting = "" if received or self.counters.garbage_bytes > garbage else text
        if not self.counters.readings and not codec.before and now is None:
            yield from self._of_rows(codec.taxels)

    def _of_rows(self, taxels: int) -> Iterator[Reading]:
        """Read frames of several lines with nothing but other numbers between them, or of a column each."""
        try:
            with open_text(self.path) as text:
                frames = frames_of_text(text.read(), taxels, ahead=0)
        except InputError:  # which lines are no readings is said anyway
            return
        address = self.device.place(self.device.part[0])[1]
        self._out = self.counters.garbage_bytes = self.counters.resyncs = 0
        self._remark = f"{counted(len(frames), 'frame')} of several lines or of a column each, without times"
        for values in frames:
            reading = self._stream.join(0, Frame(values, address=address), 0.0, 0.0, 0.0)
            if reading is not None:
                yield replace(reading, host_time=0.0)


def _ended(texts: Iterable[str]) -> Iterator[str]:
    """Give lines, and behind the last one that is whole an empty one, which ends the rows of a frame."""
    text = ""
    for text in texts:
        yield text
    if text.endswith("\n") and text.strip():
        yield "\n"


def open_text(path: str | Path) -> TextIOWrapper:
    """Open a text, which may be packed by gzip, in UTF-8, or UTF-16 with its mark. Raises SourceError."""
    try:
        with ExitStack() as opened:
            file = opened.enter_context(open_regular(path))
            packed = file.peek(2)[:2] == b"\x1f\x8b"
            lines = BufferedReader(gzip.GzipFile(fileobj=file)) if packed else file
            encoding = encoding_of(lines.peek(2))
            opened.pop_all()
            return TextIOWrapper(lines, encoding, errors="replace")
    except (InputError, OSError, EOFError) as error:
        raise SourceError(f"cannot read recording {path}: {error}") from error


def open_source(places: Sequence[str], device: Device, log: Log | None) -> Source:
    """Open a recording; one of this program brings its own device along, and refuses one that reads otherwise."""
    if len(places) != 1:
        raise SourceError(f"a recording is one file; {len(places)} were given")
    head = b""
    with suppress(InputError), open_regular(places[0]) as file:
        head = file.read(_HEAD)
    if head.startswith(MAGIC) or places[0].endswith(SUFFIX):
        replay = Replay(places[0])
        said, given = replay.device.as_json(), device.as_json()
        apart = [name for name in ("codec", "matrix", "part", "pad") if said.get(name) != given.get(name)]
        if apart and device != load_device("emulated"):  # which is what nobody named
            raise SourceError(
                f"{places[0]} is read by the device file that it was recorded with; {device.name!r} says another "
                f"[{'], ['.join(apart)}]: leave it out, or record anew"
            )
        return replay
    if b"ASCII_DATA @@" in head:
        raise SourceError(
            f"{places[0]} is a movie of Tekscan's I-Scan (ASF), whose frames state no times; write a table of it, "
            "'time [s], t0, t1, ...' and a line a frame, SECONDS_PER_FRAME apart"
        )
    packed = head.startswith(b"\x1f\x8b")
    windows = head.replace(b"\xa0", b" ")  # as it writes blanks between thousands
    of_text = packed or is_text(head) or is_text(windows)
    return CsvReplay(places[0], device, log) if of_text else Replay(places[0])
