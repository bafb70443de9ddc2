"""A serial port, pty or socket: bytes in, bytes out, and plain words when it fails. Only here is pyserial used."""

from __future__ import annotations

import select
import time
from collections.abc import Iterable
from contextlib import suppress
from typing import Any

from tactsim.core.source import SourceError
from tactsim.hardware.framing import LARGEST_CHUNK

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
