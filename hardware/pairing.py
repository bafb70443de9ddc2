"""Find the frames that all parts of a pad measured at one moment; frames of different moments make no reading."""

from __future__ import annotations

from collections.abc import Iterable

from tactsim.core.counters import Counters
from tactsim.hardware.codecs.codec import Frame

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
