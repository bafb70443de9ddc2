"""A recording that is played takes as long as it took; a clock and a sleep of the test's own say so exactly."""

import numpy as np

from tactsim.core.counters import Counters
from tactsim.core.reading import Reading
from tactsim.core.source import Source, SourceEnded
from tactsim.hardware.sources import Paced


class Listed(Source):
    def __init__(self, times):
        self._times = list(times)
        self.counters = Counters()

    def read(self, timeout=None):
        if not self._times:
            raise SourceEnded("over")
        return Reading(np.zeros(1), self._times.pop(0))

    def close(self):
        pass


class Clock:
    def __init__(self):
        self.now = 100.0

    def sleep(self, seconds):
        self.now += seconds


def played(times, busy=0.0):
    clock = Clock()
    given = []
    for reading in Paced(Listed(times), lambda: clock.now, clock.sleep):
        given.append((reading.host_time - 100.0, clock.now - 100.0))
        clock.now += busy
    return np.array(given)


def test_readings_come_when_they_did():
    times = [5.0, 5.1, 5.15, 5.9]
    np.testing.assert_allclose(played(times, busy=0.01), np.array([times, times]).T - 5.0)


def test_long_pauses_and_clocks_that_go_back_are_cut_short():
    np.testing.assert_allclose(played([5.0, 500.0, 3.0])[:, 1], [0.0, 1.0, 1.0])


def test_a_reader_that_was_away_does_not_make_it_hurry():
    given = played(np.arange(0, 6, 0.1), busy=1.6)
    assert (np.diff(given[:, 1]) >= 1.6 - 1e-9).all()
    assert (given[:, 1] - given[:, 0] <= 1.0 + 1.6).all()
