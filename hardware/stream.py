"""From the bytes of a pad's links to readings: a function of what is fed to it, without a port or a clock.

The values of a reading come from one moment of the device. Where that cannot be known, there is no reading.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from tactsim.core.counters import Counters
from tactsim.core.poses import FloatArray
from tactsim.core.reading import Reading
from tactsim.hardware.clock import DeviceClock
from tactsim.hardware.codecs.codec import Frame
from tactsim.hardware.device import UNREAD, Device
from tactsim.hardware.framing import Framer
from tactsim.hardware.pairing import ByIndex, ByTime, Moment, Pairing


class Stream:
    """Decode what a device's links say and join the frames of all parts to readings.

    A live port and the replay of a recording feed the same events in the same order, `sent`,
    `received` and `lost`, and get the same readings, bit for bit. clock: of the frames' ticks.
    """

    def __init__(self, device: Device, counters: Counters | None = None) -> None:
        """Begin with nothing received or asked. Counts on in `counters`, or from 0 if none are given."""
        self.counters = Counters() if counters is None else counters
        self._codec = device.build_codec()
        self._taxels, self._cells = device.pad.taxels, device.cells
        self._framers: list[Framer[Any]] = [Framer(self._codec, self.counters) for _ in range(device.ports)]
        places = [device.place(part) for part in device.part]
        self._dialogues = [
            self._codec.dialogue(tuple(address for at, address in places if at == port), self.counters)
            for port in range(device.ports)
        ]
        # For each part: which of its taxels are read, and which taxels of the pad they are.
        self._wires = {}
        for part in device.part:
            wiring = device.wiring(part)
            read = np.flatnonzero(wiring != UNREAD)
            self._wires[device.place(part)] = (read, wiring[read])
        self.clock = DeviceClock(self._codec.tick_s, self._codec.tick_wrap)
        self._first = device.place(device.part[0])  # its clock and counter are the pad's
        self._one_clock = self._codec.clock_common and device.ports == 1
        self._last_index: dict[tuple[int, int], int] = {}
        self._pairing: Pairing | None = None
        if len(self._wires) > 1 and device.pair_within_s is not None:
            self._pairing = ByTime(self._wires, device.pair_within_s, self.counters)
        elif len(self._wires) > 1:
            wrap = self._codec.index_wrap
            assert wrap is not None  # `Device` sees to it
            self._pairing = ByIndex(self._wires, wrap, device.deadline, self._codec.taxels, self.counters)
        self.by_arrival = isinstance(self._pairing, ByTime) and not self._one_clock
        self._after_loss = False
        self._deadline, self._last_now = device.deadline, np.inf  # s: of the last reading; there was none
        self.heard = dict.fromkeys(self._wires, 0)  # frames of each part (port, address)

    def greeting(self, link: int) -> bytes:
        """Give the bytes to send once after `link` was opened."""
        return self._dialogues[link].greeting()

    def request(self, link: int, now: float) -> bytes:
        """Give the bytes to send on `link` at `now` (s), if any."""
        return self._dialogues[link].request(now)

    def sent(self, link: int, data: bytes, now: float) -> None:
        """Note what was sent. Raises CodecError for what the codec would never send."""
        self._dialogues[link].sent(data, now)

    def received(self, link: int, data: bytes, now: float) -> list[Reading]:
        """Take in the bytes that came at `now` (s); returns the readings that they complete.

        No bytes mean that nothing came until `now`, which is worth saying where frames are paired `by_arrival`.
        """
        frames = []
        for arrived in self._framers[link].feed(data, now):
            if (frame := self._dialogues[link].take(arrived.packet, arrived.began)) is not None:
                earliest = arrived.after if frame.asked is None else max(arrived.after, frame.asked)
                frames.append((frame, earliest, arrived.ended))
        # Several frames of one part in one go: the reader was late, whatever it knows of when it waited.
        if self.by_arrival and len({frame.address for frame, _, _ in frames}) < len(frames):
            frames = [(frame, float("-inf"), latest) for frame, _, latest in frames]
        readings = [self.join(link, frame, earliest, latest, now) for frame, earliest, latest in frames]
        return [reading for reading in readings if reading is not None]

    def lost(self, link: int, now: float) -> None:
        """Note that `link` was lost at `now`: what was half received, was asked or waits for other parts is void."""
        self.counters.reconnects += 1
        self._framers[link].reset()
        self._dialogues[link].reset()
        for place in [place for place in self._last_index if place[0] == link]:
            del self._last_index[place]
        self._begin_anew()

    def _begin_anew(self) -> None:
        """Let nothing that came before be joined or averaged with what comes now."""
        self._after_loss = True
        if self._pairing is not None:
            self._pairing.forget()

    def join(self, link: int, frame: Frame, earliest: float, latest: float, now: float) -> Reading | None:
        """Take in a frame that was measured between `earliest` and `latest` (s); returns the reading it completes."""
        place = (link, frame.address)
        if place not in self._wires:
            self.counters.strays += 1
            return None
        self.counters.frames += 1
        self.heard[place] += 1
        if not self._is_new(place, frame):
            self.counters.repeats += 1
            return None
        if place == self._first or (self._one_clock and link == self._first[0]):
            frame = self._timed(frame, now)
        if self._pairing is None:
            moment: Moment | None = {place: frame}
        elif self._one_clock and frame.seconds is not None:  # the link's own clock is better than the host's
            moment = self._pairing.add(place, frame, frame.seconds, frame.seconds)
        else:
            moment = self._pairing.add(place, frame, earliest, latest)
        return None if moment is None else self._reading(moment, now)

    def _reading(self, moment: Moment, now: float) -> Reading:
        pressures: FloatArray = np.empty(self._taxels)
        for part, (read, taxels) in self._wires.items():
            pressures[taxels] = self._codec.to_kpa(moment[part].values)[read]
        first = moment[self._first]
        # A pad that was silent may have been lost behind a port that stayed open.
        after_loss = self._after_loss or now - self._last_now > self._deadline
        self._after_loss, self._last_now = False, now
        self.counters.readings += 1
        return Reading(self._cells(pressures), now, first.seconds, first.index, after_loss)

    def _is_new(self, place: tuple[int, int], frame: Frame) -> bool:
        """Tell by its counter whether a frame is another than the last, and count what lies between them."""
        wrap = self._codec.index_wrap
        if frame.index is None or wrap is None:
            return True
        step = (frame.index - self._last_index.get(place, frame.index - 1)) % wrap
        self._last_index[place] = frame.index
        if step > wrap // 2:  # the device began anew, and nothing can be said about what was lost
            self._begin_anew()
        elif self._codec.speaks and step > 1:
            self.counters.missed += step - 1
        return step != 0

    def _timed(self, frame: Frame, now: float) -> Frame:
        """Add the device's time, which goes on where its clock starts again."""
        if frame.ticks is None:
            return frame
        restarts = self.clock.restarts
        seconds = self.clock.seconds(frame.ticks, now)
        if self.clock.restarts > restarts:
            self.counters.clock_restarts += 1
            self._begin_anew()
        return replace(frame, seconds=seconds)
