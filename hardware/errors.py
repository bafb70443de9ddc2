"""What can go wrong between a device and a reading; each is an `InputError`, said in one line."""

from __future__ import annotations

from tactsim.core.errors import InputError


class CodecError(InputError):
    """Bytes or a description of bytes that a codec cannot work with."""


class SourceError(InputError):
    """A source of readings that cannot be opened or has stopped."""


class NoReading(SourceError):
    """No reading came within the time allowed; the next read may succeed."""


class SourceEnded(SourceError):
    """A source with an end, such as a recording, has no more readings."""
