"""A device's clock made continuous."""

from __future__ import annotations


class DeviceClock:
    """Turn the ticks of a clock that starts again after `wrap` ticks into seconds that never fall.

    tick_s: s. wrap: ticks, None for a clock that does not start again. restarts: how often it was reset.

    A clock may have started again several times between two frames. The number taken is the one that
    agrees best with the host's clock, so that long pauses do no harm. A clock that runs backwards all
    the same was reset; time then goes on by as much as the host's clock says.
    """

    def __init__(self, tick_s: float, wrap: int | None) -> None:
        self._tick_s, self._wrap = tick_s, wrap
        self._ticks = self._host = self._seconds = 0.0
        self._started = False
        self.restarts = 0

    def seconds(self, ticks: float, host_time: float) -> float:
        """Return the device's time in s for a frame that came at `host_time`."""
        if not self._started:
            self._started, self._seconds = True, ticks * self._tick_s
        else:
            elapsed = host_time - self._host
            advance = ticks - self._ticks
            if self._wrap is not None:
                advance %= self._wrap
                advance += self._wrap * round((elapsed / self._tick_s - advance) / self._wrap)
            if advance < 0:
                self.restarts += 1
                self._seconds += max(elapsed, 0.0)
            else:
                self._seconds += advance * self._tick_s
        self._ticks, self._host = ticks, host_time
        return self._seconds
