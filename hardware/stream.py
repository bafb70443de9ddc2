"""From the bytes of a pad's links to readings: a function of what is fed to it, without a port or a clock."""

from __future__ import annotations

from typing import Any

import numpy as np

from tactsim.core.counters import Counters
from tactsim.core.poses import FloatArray
from tactsim.core.reading import Reading
from tactsim.hardware.clock import DeviceClock
from tactsim.hardware.codecs.codec import Dialogue, Frame
from tactsim.hardware.device import UNREAD, Device
from tactsim.hardware.framing import Framer


class Stream:
    """Decode what a device's links say and join the frames of all parts to readings.

    A live port and the replay of a recording feed the same events in the same order, `sent`,
    `received` and `lost`, and get the same readings, bit for bit.
    """

    def __init__(self, device: Device, counters: Counters | None = None) -> None:
        """Begin with nothing received or asked. Counts on in `counters`, or from 0 if none are given."""
        self.counters = Counters() if counters is None else counters
        self._codec = device.codec.build()
        self._taxels = device.pad.taxels
        self._links = [_Link(device, port, self._codec, self.counters) for port in range(device.ports)]
        # For each part: which of its taxels are read, and which taxels of the pad they are.
        self._wires = {}
        for part in device.part:
            wiring = device.wiring(part)
            read = np.flatnonzero(wiring != UNREAD)
            self._wires[device.place(part)] = (read, wiring[read])
        self._clock = DeviceClock(self._codec.tick_s, self._codec.tick_wrap)
        self._first = device.place(device.part[0])  # its clock and counter are the pad's
        self._waiting: dict[tuple[int, int], Frame] = {}
        self._last_index: dict[tuple[int, int], int] = {}

    def greeting(self, link: int) -> bytes:
        """Give the bytes to send once after `link` was opened."""
        return self._links[link].dialogue.greeting()

    def request(self, link: int, now: float) -> bytes:
        """Give the bytes to send on `link` at `now` (s), if any."""
        return self._links[link].dialogue.request(now)

    def sent(self, link: int, data: bytes, now: float) -> None:
        """Note what was sent. Raises CodecError for what the codec would never send."""
        self._links[link].dialogue.sent(data, now)

    def received(self, link: int, data: bytes, now: float) -> list[Reading]:
        """Take in the bytes that came at `now` (s); returns the readings that they complete."""
        readings = []
        for packet in self._links[link].framer.feed(data):
            frame = self._links[link].dialogue.take(packet, now)
            if frame is not None and (reading := self._join(link, frame, now)) is not None:
                readings.append(reading)
        return readings

    def lost(self, link: int, now: float) -> None:
        """Note that `link` was lost at `now`: what was half received or asked is forgotten."""
        self.counters.reconnects += 1
        self._links[link].framer.reset()
        self._links[link].dialogue.reset()
        for place in [place for place in self._last_index if place[0] == link]:
            del self._last_index[place]

    def silent_parts(self) -> list[tuple[int, int]]:
        """List (port, address) of the parts that hold up a reading, if others have spoken."""
        return [place for place in self._wires if place not in self._waiting] if self._waiting else []

    def waiting_bytes(self) -> int:
        """Count the bytes and values that are kept for later; it has a bound."""
        return sum(len(link.framer) for link in self._links) + sum(
            frame.values.nbytes for frame in self._waiting.values()
        )

    def _join(self, link: int, frame: Frame, now: float) -> Reading | None:
        place = (link, frame.address)
        if place not in self._wires:
            self.counters.strays += 1
            return None
        self.counters.frames += 1
        if not self._is_new(place, frame):
            self.counters.repeats += 1
            return None
        self.counters.unpaired += place in self._waiting
        self._waiting[place] = frame
        if len(self._waiting) < len(self._wires):
            return None
        pressures: FloatArray = np.empty(self._taxels)
        for part, (read, taxels) in self._wires.items():
            pressures[taxels] = self._codec.to_kpa(self._waiting[part].values)[read]
        first = self._waiting[self._first]
        self._waiting = {}
        self.counters.readings += 1
        return Reading(pressures, now, self._device_time(first, now), first.index)

    def _is_new(self, place: tuple[int, int], frame: Frame) -> bool:
        """Tell by its counter whether a frame is another than the last, and count what lies between them."""
        wrap = self._codec.index_wrap
        if frame.index is None or wrap is None:
            return True
        step = (frame.index - self._last_index.get(place, frame.index - 1)) % wrap
        self._last_index[place] = frame.index
        # A counter that seems to go back was reset; nothing can be said about what was lost.
        if self._codec.speaks and 1 < step <= wrap // 2:
            self.counters.missed += step - 1
        return step != 0

    def _device_time(self, frame: Frame, now: float) -> float | None:
        if frame.ticks is None:
            return None
        restarts = self._clock.restarts
        seconds = self._clock.seconds(frame.ticks, now)
        self.counters.clock_restarts += self._clock.restarts - restarts
        return seconds


class _Link:
    """What is kept for one link: the bytes of a packet's beginning, and the open question."""

    def __init__(self, device: Device, port: int, codec: Any, counters: Counters) -> None:
        addresses = tuple(address for at, address in map(device.place, device.part) if at == port)
        self.framer: Framer[Any] = Framer(codec, counters)
        self.dialogue: Dialogue = codec.dialogue(addresses, counters)
