import numpy as np
import pytest

from tactsim.hardware.stream import DeviceClock


@pytest.mark.parametrize("wrap", [1 << 16, 1 << 32])
def test_a_clock_that_wraps_goes_on(wrap):
    clock = DeviceClock(1e-3, wrap)
    times = wrap * 1e-3 - 0.05 + np.arange(100) * 0.01
    got = [clock.seconds(round(time / 1e-3) % wrap, time + 7) for time in times]
    assert np.allclose(np.diff(got), 0.01)
    assert clock.restarts == 0


def test_a_pause_of_several_wraps_is_told_by_the_hosts_clock():
    clock = DeviceClock(1e-3, 1 << 16)  # wraps every 65.5 s
    first = clock.seconds(1000, 0.0)
    later = clock.seconds((1000 + 300_000) % 65536, 300.2)
    assert later - first == pytest.approx(300.0)


def test_a_clock_that_restarts_follows_the_host():
    clock = DeviceClock(1e-4, 1 << 32)
    first = clock.seconds(5_000_000, 10.0)
    again = clock.seconds(20, 12.5)
    assert again - first == pytest.approx(2.5)
    assert clock.restarts == 1
    assert clock.seconds(1020, 12.6) - again == pytest.approx(0.1)
