"""A pad on its ports: polling, deadlines, and links that are lost and come back."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from tactsim.core.reading import Reading
from tactsim.core.source import Log, NoReading, Source, SourceError
from tactsim.hardware.device import Device
from tactsim.hardware.port import Port, wait_any
from tactsim.hardware.stream import Stream

_FIRST_RETRY, _LAST_RETRY = 0.1, 5.0  # s between attempts to open a lost port; each is twice the last
_NAP = 0.05  # s after which links are looked at again: questions that are overdue, ports to reopen


@dataclass
class _Link:
    """One port of the pad: open, or lost and to be tried again."""

    url: str
    port: Port | None = None
    speaks_from: float = 0.0  # until then the device starts, and its bytes mean nothing
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
            raise SourceError(f"{device.name} has {device.ports} ports; {len(urls)} were given")
        self.device, self.pad, self.taxel_xy = device, device.pad, device.pad.taxel_xy
        self.has_bytes = True
        self._log, self._clock = log, clock
        self._stream = Stream(device)
        self.counters = self._stream.counters
        self._ready: deque[Reading] = deque()
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
        before = self.counters.as_dict()
        # A device that starts has its time to do so before it can be late.
        deadline = max([self._clock(), *(link.speaks_from for link in self._links if link.port)]) + timeout
        while not self._ready:
            now = self._clock()
            for number, link in enumerate(self._links):
                self._serve(number, link, now)
            if self._ready:
                break
            left = deadline - self._clock()
            if left <= 0:
                raise NoReading(self._why(timeout, before))
            wait_any([link.port for link in self._links if link.port is not None], min(left, _NAP))
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
                self._received(number, data)
            if not link.greeted:
                self._send(number, link.port, self._stream.greeting(number))
                link.greeted = True
            self._send(number, link.port, self._stream.request(number, self._clock()))
        except SourceError as error:
            link.port.close()
            link.port = None
            self._try_later(link, now, str(error))
            self._stream.lost(number, now)
            if self._log is not None:
                self._log.lost(number, now)

    def _received(self, number: int, data: bytes) -> None:
        now = self._clock()
        if self._log is not None:
            self._log.received(number, data, now)
        self._ready.extend(self._stream.received(number, data, now))

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

    def _why(self, timeout: float, before: dict[str, int]) -> str:
        """Say why no reading came, from what happened since `before`."""
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
        if since["torn"]:
            return (
                f"{late}: {since['torn']} frames changed while they were read. Let the sensor measure more "
                "slowly (its accumulator), or allow torn_frames in the device file"
            )
        if since["stale"]:
            return (
                f"{late}: the bridge answers, but its sensor does not. Check the sensor's cable and address"
            )
        if since["repeats"]:
            return f"{late}: the device says the same frame again and again. It hangs; restart it"
        silent = self._stream.silent_parts()
        if silent:
            port, address = silent[0]
            return f"{late}: nothing from the part at address {address} of {self._links[port].url}"
        if since["strays"]:
            return f"{late}: only frames that {self.device.name!r} does not list. Check the parts' addresses"
        return (
            f"{late}: {since['bytes']:,} bytes came and no whole frame of {self.device.name!r} in them. Wrong "
            f"baud rate ({self.device.baud}), or another device; `bench probe` shows the bytes"
        )


def open_source(places: Sequence[str], device: Device, log: Log | None) -> Source:
    """Open the ports of a pad."""
    return LiveSource(places, device, log)
