"""`Source`: a stream of readings from a port, a recording, the simulated pad or a plug-in.

Every room that provides readings implements `Source`. A room that uses readings needs nothing else.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from types import TracebackType
from typing import Any, Protocol, Self

from tactsim.core.counters import Counters
from tactsim.core.errors import InputError
from tactsim.core.pad import Pad
from tactsim.core.poses import FloatArray
from tactsim.core.reading import Reading


class SourceError(InputError):
    """A source cannot be opened, or it has stopped."""


class NoReading(SourceError):
    """No reading came within the time allowed; the next read may succeed."""


class SourceEnded(SourceError):
    """A source that has an end, such as a recording, has no more readings."""


class HasPad(Protocol):
    """Anything that has a pad, such as the description of a device that is not open yet."""

    @property
    def pad(self) -> Pad:
        """Give the pad."""


class Log(Protocol):
    """A listener to all bytes that pass over a source's links; a recorder is one."""

    def received(self, link: int, data: bytes, time: float) -> None:
        """Note bytes that came from `link` at `time`, s."""

    def sent(self, link: int, data: bytes, time: float) -> None:
        """Note bytes that were sent to `link` at `time`, s."""

    def lost(self, link: int, time: float) -> None:
        """Note that `link` was lost at `time`, s."""


class Source(ABC):
    """A stream of readings of one pad. Close it, or use it in a `with`; iterate to read it to its end.

    pad: the geometry. taxel_xy: (taxels, 2) mm, the centres of the taxels in its readings. unit: of its readings.
    counters: what has happened since it was opened. calibrated: whether the last reading is already corrected.
    has_bytes: whether it reports the bytes on its links to the `Log` that it was opened with; if not, a recording
    holds its readings instead.
    """

    pad: Pad
    taxel_xy: FloatArray
    counters: Counters
    unit: str = "kPa"
    calibrated: bool = False
    has_bytes: bool = False

    @abstractmethod
    def read(self, timeout: float | None = None) -> Reading:
        """Return the next reading.

        timeout: s, None for the device's own deadline. Raises NoReading if none came in that time
        (the next call may succeed), SourceEnded at the end of a recording, SourceError if the source
        is broken. A source never invents a reading.
        """

    @abstractmethod
    def close(self) -> None:
        """Release the device; a closed source cannot be read."""

    def summary(self) -> list[str]:
        """Describe in lines of text what has been read so far; most sources return no line."""
        return []

    def __iter__(self) -> Iterator[Reading]:
        try:
            while True:
                yield self.read()
        except SourceEnded:
            return

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _of_inner(name: str) -> Any:
    """Make the property of a `Wrapper` that asks its inner source for `name`."""
    return property(lambda wrapper: getattr(wrapper.inner, name), doc=f"Give the inner source's `{name}`.")


class Wrapper(Source):
    """A source that passes on the readings of another source, `inner`, with something added.

    Whatever a subclass does not override is asked of `inner` each time and never copied, because a
    source may replace its counters or become calibrated while it is read.
    """

    def __init__(self, inner: Source) -> None:
        self.inner = inner

    pad, taxel_xy, unit = _of_inner("pad"), _of_inner("taxel_xy"), _of_inner("unit")
    counters, calibrated, has_bytes = _of_inner("counters"), _of_inner("calibrated"), _of_inner("has_bytes")

    def read(self, timeout: float | None = None) -> Reading:
        """Return the inner source's next reading; see `Source.read`."""
        return self.inner.read(timeout)

    def close(self) -> None:
        """Close the inner source."""
        self.inner.close()

    def summary(self) -> list[str]:
        """Describe what has been read from the inner source."""
        return self.inner.summary()
