"""No reading is made up and memory stays flat under every fault: for seconds here, for half an hour by `make soak`."""

import gc
import sys
import threading
import time

import numpy as np
import pytest
from made_pads import serving, singletact

from tactsim.core.source import NoReading
from tactsim.hardware.device import load_device
from tactsim.hardware.emulator import Faults, emulate
from tactsim.hardware.live import LiveSource

MOMENTS = 4096  # what a device measures comes again after so many of its frames
FAULTS = Faults(drop=2e-4, flip=2e-4, torn=0.01, garbage=0.02, disconnect=2.0)


class Soaked:
    """Read an emulated device whose values tell which of its moments they are of; the counts are random numbers.

    changed: how many values of a reading may be others, where a changed byte cannot be seen.
    """

    def __init__(self, device, rate, on, link, kpa_per_count, zero, most, changed=0):
        self.device, self.rate, self.on, self.changed = device, rate, on, changed
        self.options = {"link": link} if on == "pty" else {}
        self.kpa_per_count, self.zero = kpa_per_count, zero
        self.counts = np.random.default_rng(1).integers(zero, most, (MOMENTS, device.pad.taxels))
        self.moments = {row.tobytes(): moment for moment, row in enumerate(self.counts)}
        self.readings, self.silences, self.made_up, self.counters, self.error = 0, 0, [], {}, ""

    def pressures(self, now):
        return self.kpa_per_count * (self.counts[round(now * self.rate) % MOMENTS] - self.zero)

    def read_until(self, enough):
        try:
            emulated = emulate(self.device, self.pressures, rate=self.rate)
            with (
                serving(emulated, on=self.on, faults=FAULTS, **self.options) as url,
                LiveSource([url], self.device) as source,
            ):
                last = None
                while not enough.is_set():
                    try:
                        reading = source.read(1.0)
                    except NoReading:
                        self.silences += 1
                        continue
                    counts = np.rint(reading.pressures / self.kpa_per_count + self.zero).astype(int)
                    moment = self.moments.get(counts.tobytes())
                    if moment is None and self.changed:
                        others = (self.counts != counts).sum(axis=1)
                        moment = int(others.argmin()) if others.min() <= self.changed else None
                    if moment is None or moment == last:
                        self.made_up.append((self.readings, moment))
                    last, self.readings = moment, self.readings + 1
                self.counters = source.counters.as_dict()
        except Exception as error:
            self.error = f"{type(error).__name__}: {error}"


def soak(seconds, link):
    """Read two devices at once; gives how many more blocks of memory Python has at the end than after a third."""
    arrays = Soaked(load_device("emulated"), 500.0, "pty", link, 0.7, 512, 4096)
    # The bridge's protocol has no checksum: of the bytes that are changed, one that is still a count stays unseen.
    bridge = Soaked(singletact(), 20.0, "tcp", None, 100 / 512, 255, 768, changed=1)
    enough = threading.Event()
    threads = [threading.Thread(target=one.read_until, args=(enough,)) for one in (arrays, bridge)]
    for thread in threads:
        thread.start()
    blocks = []
    for share in (1 / 3, 2 / 3):
        time.sleep(share * seconds)
        fewest = []
        for _ in range(20):  # what waits to be read comes and goes; what leaks is among the fewest
            time.sleep(0.02)
            gc.collect()
            fewest.append(sys.getallocatedblocks())
        blocks.append(min(fewest))
    enough.set()
    for thread in threads:
        thread.join()
    for one in (arrays, bridge):
        print(f"{one.readings:,} readings, {one.silences} silences, {one.counters}")
        assert (one.error, one.made_up) == ("", [])
        assert one.readings > one.rate * seconds / 5
        assert one.counters["reconnects"] >= seconds / 10
        assert one.counters["garbage_bytes"] > 0
    return blocks[1] - blocks[0]


@pytest.mark.long
def test_some_seconds_of_faults_make_no_reading_up(tmp_path):
    soak(6.0, tmp_path / "pad")


@pytest.mark.soak
def test_half_an_hour_of_faults_makes_no_reading_up(tmp_path, soak_minutes):
    assert soak(60.0 * soak_minutes, tmp_path / "pad") < 2000  # one a hundred readings would be six thousand
