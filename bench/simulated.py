"""The simulated pad as a source of readings, like a port or a recording."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from tactsim.bench.presses import parse_pose, press_table, scan_options_for, sensing
from tactsim.core.reading import Reading
from tactsim.hardware.counters import Counters
from tactsim.hardware.device import Device
from tactsim.hardware.errors import SourceError
from tactsim.hardware.sources import Log, Source
from tactsim.press import ScanOptions

_RATE = 100.0  # readings a second of device time; they are given out as fast as they are asked for


class SimulatedSource(Source):
    """Readings of a letter that lies still on the simulated pad."""

    def __init__(self, letter: str, pose: str, device: Device, seed: int = 0) -> None:
        """Press `letter` at `pose` (x,y,theta). Raises InputError for an unknown letter or a bad pose."""
        rng = np.random.default_rng(seed)
        options = scan_options_for(device, ScanOptions())
        table = press_table(letter, parse_pose(pose)[None], options, rng)
        self._sense = sensing(lambda now: table[0], options, rng)
        self.pad, self.taxel_xy, self.counters = device.pad, device.pad.taxel_xy, Counters()
        self._closed = False

    def read(self, timeout: float | None = None) -> Reading:
        """Return the next reading at once; see `Source.read`."""
        if self._closed:
            raise SourceError("the simulated pad was closed")
        index = self.counters.readings
        self.counters.readings += 1
        return Reading(self._sense(index / _RATE), time.monotonic(), index / _RATE, index)

    def close(self) -> None:
        """Stop giving readings."""
        self._closed = True


def open_source(places: Sequence[str], device: Device, log: Log | None) -> Source:
    """Press a letter that lies still on the simulated pad: simulated:LETTER@x,y,theta."""
    if len(places) != 1:
        raise SourceError(f"the simulated pad is one source; {len(places)} were given")
    letter, _, pose = places[0].partition("@")
    return SimulatedSource(letter or "A", pose or "0,0,0", device)
