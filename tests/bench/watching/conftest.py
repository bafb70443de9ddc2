import queue
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest

from tactsim.bench import watching
from tactsim.core.counters import Counters
from tactsim.core.reading import Reading
from tactsim.core.source import NoReading, Source, SourceEnded
from tactsim.hardware.device import load_device


class HandFed(Source):
    """A source that gives what the test puts into it: pressures, or an error to raise."""

    def __init__(self, device):
        self.device, self.pad, self.taxel_xy = device, device.pad, device.pad.taxel_xy
        self.counters = Counters()
        self._fed = queue.SimpleQueue()
        self.given = 0

    def feed(self, *items):
        for item in items:
            self._fed.put(item)

    def read(self, timeout=None):
        try:
            item = self._fed.get(timeout=min(timeout, 0.05))
        except queue.Empty:
            raise NoReading("the cable is off") from None
        if isinstance(item, Exception):
            raise item
        self.counters.readings += 1
        self.given += 1
        return Reading(np.asarray(item, dtype=float), time.monotonic())

    def close(self):
        self.feed(SourceEnded("closed"))


@contextmanager
def _fed(source, frames):
    stop = threading.Event()

    def feed():
        for frame in frames:
            if stop.wait(0.005):
                return
            source.feed(frame)

    feeder = threading.Thread(target=feed)
    feeder.start()
    try:
        yield
    finally:
        stop.set()
        feeder.join()


@pytest.fixture(autouse=True)
def silence(monkeypatch):
    """Say how long a pad may be silent, s: as long as it likes, unless a test calls this."""

    def allow(seconds):
        monkeypatch.setattr(watching, "_SILENCE_S", seconds)

    allow(1000.0)
    return allow


@pytest.fixture(scope="session")
def fed():
    """Feed a source with frames, 200 in a second, as long as a `with` goes on."""
    return _fed


@pytest.fixture(scope="session")
def device():
    return load_device("emulated")


@pytest.fixture
def source(device):
    return HandFed(device)


@pytest.fixture
def eventually():
    """Wait until something is so; the longest wait is far longer than it should take."""

    def wait(condition, seconds=120.0):
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            if condition():
                return
            time.sleep(0.01)
        raise AssertionError("it did not come to be so")

    return wait
