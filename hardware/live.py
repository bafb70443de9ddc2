"""A pad on its ports: polling, deadlines, and links that are lost and come back. Only here is pyserial used."""

from __future__ import annotations

import select
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from tactsim.core.errors import counted
from tactsim.core.reading import Reading
from tactsim.core.source import Log, NoReading, Source, SourceError
from tactsim.hardware.codecs.codec import LARGEST_CHUNK, PATIENCE, CodecError
from tactsim.hardware.codecs.lines import is_text
from tactsim.hardware.device import Device
from tactsim.hardware.stream import Stream

_FIRST_RETRY, _LAST_RETRY = 0.1, 0.5  # s between attempts to open a lost port; each is twice the last
_REMEMBERED = 4096  # bytes, to say what came if it is no frame
_NAP = 0.05  # s after which links are looked at again: questions that are overdue, ports to reopen


class DeviceMismatch(SourceError):
    """What answers is not the device that the device file describes; to open its port again does not help."""


@dataclass
class _Link:
    """One port of the pad: open, or lost and to be tried again."""

    url: str
    port: Port | None = None
    speaks_from: float = 0.0  # until then the device starts, and its bytes mean nothing
    quiet_until: float = 0.0  # nothing came before that is not read yet
    greeted: bool = False
    retry_at: float = 0.0
    retry_after: float = _FIRST_RETRY
    trouble: str = ""


class LiveSource(Source):
    """Readings of a pad on one or several ports.

    Everything that is sent, received or lost goes to the `log`, if there is one, and through the same
    `Stream` that a replay uses. clock: s, monotonic.
    """

    def __init__(
        self,
        urls: Sequence[str],
        device: Device,
        log: Log | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Open all ports. Raises SourceError if there are too few or many, or one cannot be opened."""
        if len(urls) != device.ports:
            raise SourceError(f"{device.name} has {counted(device.ports, 'port')}; {len(urls)} were given")
        self.device, self.pad, self.taxel_xy = device, device.pad, device.pad.taxel_xy
        self.has_bytes = True
        self._log, self._clock = log, clock
        self._stream = Stream(device)
        self.counters = self._stream.counters
        self._ready: deque[Reading] = deque()
        self._heard_at, self._last_bytes = self._clock(), b""  # when bytes came last, and which
        self._links = [_Link(url) for url in urls]
        self._closed = False
        try:
            for link in self._links:
                self._open(link)
        except SourceError:
            self.close()
            raise

    def read(self, timeout: float | None = None) -> Reading:
        """Return the next reading; see `Source.read`. A lost port is reopened while there is time."""
        if self._closed:
            raise SourceError(f"{self._where} was closed")
        timeout = self.device.deadline if timeout is None else timeout
        before, heard = self.counters.as_dict(), dict(self._stream.heard)
        begun = self._clock()
        while not self._ready:
            # A device that starts has its time to do so before it can be late, also after its port was lost.
            deadline = max([begun, *(link.speaks_from for link in self._links if link.port)]) + timeout
            now = self._clock()
            for number, link in enumerate(self._links):
                self._serve(number, link, now)
            if self._ready:
                break
            left = deadline - self._clock()
            if left <= 0:
                raise NoReading(self._why(timeout, before, heard))
            ports = [link.port for link in self._links if link.port is not None]
            if wait_any(ports, min(left, _NAP)):
                woken = self._clock()
                for link in self._links:
                    link.quiet_until = woken
        return self._ready.popleft()

    def close(self) -> None:
        """Close all ports."""
        self._closed = True
        for link in self._links:
            if link.port is not None:
                link.port.close()
                link.port = None

    @property
    def _where(self) -> str:
        return " and ".join(link.url for link in self._links)

    def _open(self, link: _Link) -> None:
        link.port = Port(link.url, self.device.baud)
        link.speaks_from = self._clock() + self.device.settle
        link.greeted = False
        link.retry_after, link.trouble = _FIRST_RETRY, ""

    def _serve(self, number: int, link: _Link, now: float) -> None:
        """Read what a link has to say, then ask it the next question; or try to open it again."""
        if link.port is None:
            if now >= link.retry_at:
                try:
                    self._open(link)
                except SourceError as error:
                    self._try_later(link, now, str(error))
            return
        try:
            data = link.port.read()
            if now < link.speaks_from:
                return
            if data:
                if self._stream.by_arrival:
                    self._received(number, b"", link.quiet_until)
                self._received(number, data, self._clock())
            else:
                link.quiet_until = now
            if not link.greeted:
                self._send(number, link.port, self._stream.greeting(number))
                link.greeted = True
            self._send(number, link.port, self._stream.request(number, self._clock()))
        except DeviceMismatch:
            raise
        except SourceError as error:
            link.port.close()
            link.port = None
            self._try_later(link, now, str(error))
            self._stream.lost(number, now)
            if self._log is not None:
                self._log.lost(number, now)

    def _received(self, number: int, data: bytes, now: float) -> None:
        self._heard_at = now
        self._last_bytes = (self._last_bytes + data)[-_REMEMBERED:]
        if self._log is not None:
            self._log.received(number, data, now)
        try:
            self._ready.extend(self._stream.received(number, data, now))
        except CodecError as error:  # the device is not what the device file says
            raise DeviceMismatch(f"{self._links[number].url}: {error}") from error

    def _send(self, number: int, port: Port, data: bytes) -> None:
        if not data:
            return
        now = self._clock()
        port.write(data)
        if self._log is not None:
            self._log.sent(number, data, now)
        self._stream.sent(number, data, now)

    def _try_later(self, link: _Link, now: float, trouble: str) -> None:
        link.trouble = trouble
        link.retry_at = now + link.retry_after
        link.retry_after = min(2 * link.retry_after, _LAST_RETRY)

    def _why(self, timeout: float, before: dict[str, int], heard: dict[tuple[int, int], int]) -> str:
        """Say why no reading came, from what happened since `before`, when parts had said `heard` frames."""
        late = f"no reading from {self._where} in {timeout:g} s"
        lost = [link for link in self._links if link.port is None]
        if lost:
            return f"{late}: {lost[0].trouble}"
        since = {name: count - before[name] for name, count in self.counters.as_dict().items()}
        if not since["bytes"]:
            return (
                f"{late}: not one byte came. Is the device on, is this its port, and does {self.device.name!r} "
                "say what the device waits for?"
            )
        quiet = self._clock() - self._heard_at
        if quiet > max(timeout / 2, 2 * PATIENCE):
            return f"{late}: the device fell silent {quiet:.1f} s ago. Check its power and its cable"
        return f"{late}: {self._trouble(since, heard)}"

    def _trouble(self, since: dict[str, int], heard: dict[tuple[int, int], int]) -> str:
        """Say what is wrong with the bytes of a device that speaks."""
        if since["torn"]:
            return (
                f"{since['torn']} frames changed while they were read. Let the sensor measure more slowly "
                "(accumulator in the device file), or allow torn_frames there"
            )
        if since["impossible"]:
            return f"{since['impossible']} frames had values that the device cannot say. Bytes change on the line"
        if since["stale"]:
            return "the bridge answers, but its sensor does not. Check the sensor's cable and address"
        if since["timeouts"] and since["strays"]:
            return (
                f"answers come more than {PATIENCE:g} s after their questions, too late to be taken. Is the line that "
                f"slow (baud {self.device.baud})?"
            )
        silent = [place for place, count in self._stream.heard.items() if count == heard[place]]
        if 0 < len(silent) < len(heard):
            port, address = silent[0]
            return f"nothing from the part at address {address} of {self._links[port].url}"
        if since["unpaired"]:
            how = (
                "the same counter" if self.device.pair_within_s is None else "the stated time (pair_within_s)"
            )
            return f"frames of all parts come, but not with {how}. Were the parts started together?"
        if since["repeats"]:
            return "the device says the same frame again and again. It hangs; restart it"
        if since["strays"]:
            return f"only frames that {self.device.name!r} does not list. Check the parts' addresses"
        if since["bad_checksums"]:
            return (
                f"{since['bad_checksums']} frames are right but for their checksum. Its kind, skip or endian in the "
                "device file is not the device's, or bytes change on the line"
            )
        if is_text(self._last_bytes):
            return (
                f"{since['bytes']:,} bytes of text came and no whole frame of {self.device.name!r} in them; "
                "`bench probe` shows them, and which lines they are"
            )
        mark, why = self.device.build_codec().mark, f"Wrong baud rate ({self.device.baud}), or another device"
        if len(mark) > 1 and self._last_bytes.count(mark) > 2:
            why = f"{mark.hex(' ')} comes, and not what is stated to follow it: length, taxels, checksum"
        came = f"{since['bytes']:,} bytes came and no whole frame of {self.device.name!r} in them"
        return f"{came}. {why}; `bench probe` shows the bytes"


_WRITE_TIMEOUT = 1.0  # s
_POLL = 0.001  # s between looks at a port that select cannot watch (rfc2217://, loop://)


class Port:
    """An open port. Its reads never block; `wait_any` does, for at most the time given."""

    def __init__(self, url: str, baud: int) -> None:
        """Open `url`, a device's name or a URL that pyserial knows, for this program alone.

        Raises SourceError if it is not there, in use, or not allowed.
        """
        import serial

        self.url = url
        try:
            self._serial: Any = serial.serial_for_url(
                url, baudrate=baud, timeout=0, write_timeout=_WRITE_TIMEOUT, exclusive=True
            )
        except (OSError, ValueError) as error:  # SerialException is an OSError
            reason = _reason(error)
            if len(url) == 1:  # a letter, as `bench live` recognises them
                reason += f"; did you mean simulated:{url}?"
            raise SourceError(f"cannot open {url}: {reason}") from error
        try:
            self.fileno: int | None = self._serial.fileno()
        except (OSError, AttributeError):
            self.fileno = None

    def read(self) -> bytes:
        """Return all that has come, up to `LARGEST_CHUNK` bytes, b"" if nothing.

        Raises SourceError if the port is gone; what came before is returned first.
        """
        data = b""
        try:
            while len(data) < LARGEST_CHUNK and (more := self._serial.read(LARGEST_CHUNK - len(data))):
                data += more
        except (OSError, TypeError) as error:  # TypeError: pyserial, of a port closed meanwhile
            if not data:
                raise SourceError(f"{self.url} is gone: {_reason(error)}") from error
        return data

    def write(self, data: bytes) -> None:
        """Send bytes. Raises SourceError if the port is gone or takes nothing for a second."""
        try:
            self._serial.write(data)
        except (OSError, TypeError) as error:
            raise SourceError(f"{self.url} is gone: {_reason(error)}") from error

    def close(self) -> None:
        """Close the port; closing one that is gone is no error."""
        with suppress(OSError):
            self._serial.close()


def wait_any(ports: Iterable[Port], timeout: float) -> bool:
    """Wait until one of the ports may have something to read, at most `timeout` s.

    Returns whether it is known that nothing came before it ended.
    """
    filenos = [port.fileno for port in ports]
    watched = [fileno for fileno in filenos if fileno is not None]
    if filenos and len(watched) == len(filenos):
        begun = time.monotonic()
        select.select(watched, [], [], max(0.0, timeout))
        return time.monotonic() - begun > _POLL  # otherwise something may have come before it began
    time.sleep(max(0.0, min(timeout, _POLL)))
    return False


def _reason(error: Exception) -> str:
    """Put pyserial's message into words that say what to do."""
    text = str(error)
    if "exclusively lock" in text:
        return "another program has it open; close that first"
    if "returned no data" in text:
        return "unplugged, or opened by two programs"
    if isinstance(error, PermissionError) or "Permission denied" in text or "Errno 13" in text:
        return "no permission; on Linux add yourself to the group that owns it (often 'dialout')"
    if "No such file" in text or "FileNotFound" in text:
        return "there is no such port; `bench devices` lists them"
    if "not a valid" in text or "invalid URL" in text:
        return f"{text}; write a device's name or socket://HOST:PORT"
    return text
