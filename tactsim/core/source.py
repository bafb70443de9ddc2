"""`Source`: a stream of readings, be it of a port, a recording, the simulated pad or a plug-in.

Every room that gives readings implements it, and every room that takes them needs nothing else.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from types import TracebackType
from typing import Protocol, Self

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
    """What a source may need to know of a device before it is opened: the pad."""

    @property
    def pad(self) -> Pad:
        """Give the pad that the device is."""


class Log(Protocol):
    """What is told of everything that goes over a source's links; a recorder is one."""

    def received(self, link: int, data: bytes, time: float) -> None:
        """Note bytes that came from `link` at `time`, s."""

    def sent(self, link: int, data: bytes, time: float) -> None:
        """Note bytes that were sent to `link` at `time`, s."""

    def lost(self, link: int, time: float) -> None:
        """Note that `link` was lost at `time`, s."""


class Source(ABC):
    """A stream of readings of one pad. Close it, or use it in a `with`; iterate to read till its end.

    pad: the geometry. taxel_xy: (taxels, 2) mm, where the taxels lie that its readings hold.
    counters: what has happened since it was opened. calibrated: whether the reading given last is
    corrected already. has_bytes: whether it tells the `Log` that it was opened with what its links say;
    if not, its readings have to be recorded instead.
    """

    pad: Pad
    taxel_xy: FloatArray
    counters: Counters
    calibrated: bool = False
    has_bytes: bool = False

    @abstractmethod
    def read(self, timeout: float | None = None) -> Reading:
        """Return the next reading.

        timeout: s, None for the device's own deadline. Raises NoReading if none came in that time
        (the next call may succeed), SourceEnded at the end of a recording, SourceError if the source
        is broken. It never makes a reading up.
        """

    @abstractmethod
    def close(self) -> None:
        """Give the device back; a closed source cannot be read."""

    def summary(self) -> list[str]:
        """Say in lines of text what the source is of, as far as it was read; most have nothing to say."""
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


class Wrapper(Source):
    """Another source, `inner`, with something added to its readings.

    All that is not overridden is asked of `inner` at the moment when it is wanted, never copied: a
    source may count in new counters, or begin to be calibrated, while it is read.
    """

    def __init__(self, inner: Source) -> None:
        self.inner = inner

    # Plain attributes of a source, which drivers assign, are answers here: a type checker minds that.
    @property
    def pad(self) -> Pad:  # type: ignore[override]
        """Give the inner source's pad."""
        return self.inner.pad

    @property
    def taxel_xy(self) -> FloatArray:  # type: ignore[override]
        """Tell where the taxels of a reading lie, (taxels, 2) mm."""
        return self.inner.taxel_xy

    @property
    def counters(self) -> Counters:  # type: ignore[override]
        """Count what has happened in the inner source."""
        return self.inner.counters

    @property
    def calibrated(self) -> bool:  # type: ignore[override]
        """Tell whether the reading given last is corrected."""
        return self.inner.calibrated

    @property
    def has_bytes(self) -> bool:  # type: ignore[override]
        """Tell whether what was opened with a `Log` told it everything."""
        return self.inner.has_bytes

    def read(self, timeout: float | None = None) -> Reading:
        """Return the inner source's next reading; see `Source.read`."""
        return self.inner.read(timeout)

    def close(self) -> None:
        """Close the inner source."""
        self.inner.close()

    def summary(self) -> list[str]:
        """Say what the inner source is of."""
        return self.inner.summary()
