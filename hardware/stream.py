"""From the bytes of a pad's links to readings: a function of what is fed to it, without a port or a clock.

The values of a reading come from one moment of the device: frames of all parts are paired. Where
that cannot be known, there is no reading.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from tactsim.core.counters import Counters
from tactsim.core.poses import FloatArray
from tactsim.core.reading import Reading
from tactsim.hardware.codecs.codec import Frame, Framer
from tactsim.hardware.device import UNREAD, Device


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


Place = tuple[int, int]  # port, address
Moment = dict[Place, Frame]  # the frames of all parts

_MOST_VALUES = 1 << 17  # taxels' values that wait for other parts: more than a port gives in one read


class ByIndex:
    """Pair frames whose counters are equal.

    A part sends its frames in order. So when one with a later counter comes, the part's frame that an
    earlier moment still lacks was lost, and that moment is dropped. A moment that is not complete
    `patience` s after its first frame is dropped, too: the counter starts again after `wrap` frames.
    """

    def __init__(
        self, places: Iterable[Place], wrap: int, patience: float, taxels: int, counters: Counters
    ) -> None:
        self._parts, self._wrap, self._patience = len(set(places)), wrap, patience
        self._most = min(max(4, _MOST_VALUES // taxels), wrap // 4)
        self._counters = counters
        # By counter, in the order in which they began: since when, s, and what has come.
        self._moments: dict[int, tuple[float, Moment]] = {}

    def add(self, place: Place, frame: Frame, earliest: float, latest: float) -> Moment | None:
        """Take in a frame that came at `latest`, s; returns the moment that it completes, or None."""
        index = frame.index
        assert index is not None
        while self._moments:
            first, (since, frames) = next(iter(self._moments.items()))
            passed = place not in frames and 0 < (index - first) % self._wrap <= self._wrap // 2
            if not passed and latest - since <= self._patience and len(self._moments) <= self._most:
                break
            self._counters.unpaired += len(frames)
            del self._moments[first]
        _, frames = self._moments.setdefault(index, (latest, {}))
        self._counters.unpaired += place in frames
        frames[place] = frame
        if len(frames) < self._parts:
            return None
        del self._moments[index]
        return frames

    def forget(self) -> None:
        """Drop what waits."""
        self._counters.unpaired += sum(len(frames) for _, frames in self._moments.values())
        self._moments.clear()


class ByTime:
    """Pair frames that were measured within `within` s of each other, whatever is not known of their times.

    When a frame was measured is known to lie between two times. Frames are paired only if the earliest
    and the latest of all are at most `within` apart; a frame that began too long before the latest is dropped.
    Which of them comes first says nothing: some are known as frames only when the next one begins.
    """

    def __init__(self, places: Iterable[Place], within: float, counters: Counters) -> None:
        self._parts, self._within, self._counters = len(set(places)), within, counters
        self._held: dict[Place, tuple[Frame, float, float]] = {}  # each part's newest frame, and its times

    def add(self, place: Place, frame: Frame, earliest: float, latest: float) -> Moment | None:
        """Take in a frame that was measured between two times, s; returns the moment that it completes, or None."""
        before = len(self._held) + 1
        self._held[place] = frame, earliest, latest
        last = max(held[2] for held in self._held.values())
        self._held = {part: held for part, held in self._held.items() if last - held[1] <= self._within}
        self._counters.unpaired += before - len(self._held)
        if len(self._held) < self._parts:
            return None
        moment = {part: held[0] for part, held in self._held.items()}
        self._held = {}
        return moment

    def forget(self) -> None:
        """Drop what waits."""
        self._counters.unpaired += len(self._held)
        self._held.clear()


Pairing = ByIndex | ByTime


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
