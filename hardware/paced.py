"""A recording played at the speed at which it was recorded."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

from tactsim.core.reading import Reading
from tactsim.core.source import Source, Wrapper

_LONGEST_PAUSE = 1.0  # s: a longer one, as between two segments, is cut short


class Paced(Wrapper):
    """Another source whose readings come when they are due by their host times.

    The host time of a reading is the one at which it is given, so it is like that of a pad that is read now.
    """

    def __init__(
        self,
        inner: Source,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        super().__init__(inner)
        self._clock, self._sleep = clock, sleep
        self._recorded: float | None = None  # host time in the recording, and now, of the reading before
        self._given = 0.0

    def read(self, timeout: float | None = None) -> Reading:
        """Return the next reading when it is due; see `Source.read`."""
        reading = self.inner.read(timeout)
        if self._recorded is None:
            self._given = self._clock()
        else:
            pause = min(max(reading.host_time - self._recorded, 0.0), _LONGEST_PAUSE)
            self._given += pause
            wait = self._given - self._clock()
            if wait > 0:
                self._sleep(wait)
            elif wait < -_LONGEST_PAUSE:  # who reads it was away: it goes on from here, and does not catch up
                self._given = self._clock()
        self._recorded = reading.host_time
        return replace(reading, host_time=self._given)
