"""Presses in the readings of recordings: what each reads, at its load and on the way there; taxels that are wrong."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactsim.core.errors import InputError
from tactsim.core.moments import moments_of, plateau, shares_of
from tactsim.core.pad import Pad
from tactsim.core.poses import FloatArray
from tactsim.core.scan import Scan, check_pose_units
from tactsim.hardware.calibration import LEAST_FRAMES, find_stuck

Moments = int | Literal["auto", "found"]

# Readings that are remembered: of what came since the last press, and of the idle pad.
_SINCE, _IDLE = 20_000, 2000
# A pad is idle while less than this share of a press is felt, above the least that is felt.
_RESTING = 0.1
# A taxel that reads this share of the highest of a press while the pad is idle is always loaded.
_LOADED = 0.25
# More than this share of the taxels are not always loaded: then the pad has no tare.
_MOST_LOADED = 0.25


class Window(NamedTuple):
    """What was pressed, and the first and the last place of the press in its recording, such as times or numbers."""

    first: float
    last: float
    label: str
    split: str
    pose: tuple[float, float, float]


class _Row(NamedTuple):
    """A reading of the scan. press: a number of its own. share: of the press's load. image: (taxels,)."""

    press: int
    share: float
    image: FloatArray
    window: Window


@dataclass
class PressReadings:
    """Collects the presses of recordings, their moments, and the taxels that are wrong in one of them.

    moments: how many of each training press are wanted, "auto", or "found": auto, and none where no press shows a rise.
    at_load: the share of their load at which test presses are taken. spreads: of each press with several readings their
    standard deviation, (taxels,).
    """

    pad: Pad
    taxel_xy: FloatArray
    moments: Moments | None = None
    at_load: float = 1.0
    spreads: list[FloatArray] = field(default_factory=list)
    _rows: list[_Row] = field(default_factory=list)
    _wrong: dict[int, str] = field(default_factory=dict)
    _presses: int = 0
    _tests: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        if not 0 < self.at_load <= 1:
            raise InputError(
                f"test presses are asked for at {self.at_load:g} of their load; give a share above 0, at most 1"
            )
        count = "auto" if self.moments == "found" else self.moments
        self._of_training = np.ones(1) if count is None else shares_of(count)
        self._shares = np.union1d(self._of_training, self.at_load)  # at which images are wanted

    def take(self, readings: Iterable[tuple[float, FloatArray]], windows: Sequence[Window]) -> list[Window]:
        """Take in a recording: its readings (place, pressures (taxels,)), places rising, and what was pressed in it.

        A press's reading is the mean of those in its window. A test press that does not show the share of its load that
        is asked for is left out. Returns the windows without a reading.
        """
        idle = _IdleReadings()
        means: dict[int, FloatArray] = {}
        moments: dict[int, tuple[NDArray[np.bool_], FloatArray]] = {}
        for number, before, held in _presses_of(readings, windows, idle):
            means[number] = held.mean(axis=0)
            if len(held) > 1:
                self.spreads.append(held.std(axis=0, ddof=1))
            if self._shares[0] < 1:
                found, images = _on_the_way(before, held, self._shares)
                if found.any():
                    moments[number] = found, images
        wanted = {"train": self._of_training, "test": np.array([self.at_load])}
        # A rise is an image below the whole load that training asks for.
        lower = np.isin(self._shares, self._of_training) & (self._shares < 1)
        if self.moments == "found" and not any(found[lower].any() for found, _ in moments.values()):
            wanted = {"test": wanted["test"]} if self.at_load < 1 else {}
        for number in sorted(means):
            window, of_press = windows[number], list[tuple[float, FloatArray]]()
            self._tests[window.label] += window.split == "test"
            if window.split in wanted and number in moments:
                found, images = moments[number]
                chosen = found & np.isin(self._shares, wanted[window.split])
                of_press = list(zip(self._shares[chosen].tolist(), images[chosen], strict=True))
            elif window.split == "train" or self.at_load == 1:
                of_press = [(1.0, means[number])]
            self._rows += [_Row(self._presses, share, image, window) for share, image in of_press]
            self._presses += bool(of_press)
        if means:
            self._wrong |= wrong_taxels(idle.rows, np.array(list(means.values())))
        return [window for number, window in enumerate(windows) if number not in means]

    def scan(self, meta: dict[str, Any]) -> Scan:
        """Make the scan, without the taxels that are wrong.

        Raises InputError if no taxel is left, or moments or a lower load are wanted and none is found.
        """
        kept = np.setdiff1d(np.arange(len(self.taxel_xy)), list(self._wrong))
        if not len(kept):
            raise InputError(
                "every taxel is stuck or always loaded in one of the recordings; nothing is left to read"
            )
        if self._wrong:
            of_pad = [int(np.abs(self.pad.taxel_xy - xy).sum(axis=1).argmin()) for xy in self.taxel_xy]
            left_out = {str(of_pad[taxel]): why for taxel, why in sorted(self._wrong.items())}
            meta = {**meta, "left_out": left_out}
        rows = self._rows
        if self.moments in ("auto", "found"):
            rows = _without_seldom_shares(rows)
        if self.moments is not None:
            lower = [row for row in rows if row.window.split == "train" and row.share < 1]
            if lower:
                shares = sorted({row.share for row in rows if row.window.split == "train"})
                presses = len({row.press for row in lower})
                told = {"shares": shares, "of": "felt", "split": "train", "presses": presses}
                meta = {**meta, "moments": told}
            elif self.moments != "found":
                raise InputError(
                    "no press of the recording shows a plateau and images on the way there, so there are no moments to "
                    "take; record whole presses with more images a second, or leave out --moments"
                )
        if self.at_load < 1:
            if all(row.window.split == "train" for row in rows):
                raise InputError(
                    f"no test press shows {self.at_load:.0%} of its load on the way to a plateau; record whole presses "
                    "with more images a second, or leave out --at-load"
                )
            tests = {(row.window.label, row.press) for row in rows if row.window.split == "test"}
            shown = Counter(label for label, _ in tests)
            missing = {label: [count - shown[label], count] for label, count in sorted(self._tests.items())}
            told = {label: counts for label, counts in missing.items() if counts[0]}
            meta = {**meta, "test_load": self.at_load, "test_load_missing": told}
        apart = any(row.share < 1 for row in rows)
        poses = np.array([row.window.pose for row in rows])
        check_pose_units(poses, self.taxel_xy)
        return Scan(
            np.array([row.image for row in rows])[:, kept],
            poses,
            np.array([row.window.label for row in rows]),
            np.array([row.window.split for row in rows]),
            self.taxel_xy[kept],
            meta,
            presses=np.array([row.press for row in rows]) if apart else None,
            moments=np.array([row.share for row in rows]) if apart else None,
        )


def wrong_taxels(idle: Sequence[FloatArray], presses: FloatArray) -> dict[int, str]:
    """Find the taxels that are wrong while nothing presses: {number: why}.

    idle: readings (taxels,) between presses. presses: (n, taxels) the readings of the presses. A taxel is stuck if it
    never changes, neither idle nor pressed, though the others do; it is always loaded if it reads a quarter of the
    highest taxel of a press while the pad is idle. Without 40 idle readings nothing is known of any. Raises InputError
    if none ever changes.
    """
    rested = np.array(idle).reshape(-1, presses.shape[1])
    felt = rested.sum(axis=1)
    if len(rested) >= LEAST_FRAMES:
        least = np.quantile(felt, 0.05)
        rested = rested[felt <= least + _RESTING * max(float(np.median(presses.sum(axis=1))) - least, 0.0)]
    if len(rested) < LEAST_FRAMES:
        return {}
    level = np.median(rested, axis=0)
    if (rested == level).all() and (presses == level).all():
        raise InputError("every taxel of the recording is stuck: none changes when something presses")
    zero = float(np.median(level))
    wrong = {
        int(taxel): f"stuck at {level[taxel]:.4g}"
        for taxel in find_stuck(rested)
        if (presses[:, taxel] == level[taxel]).all()
    }
    highest = float(np.median(presses.max(axis=1))) - zero
    loaded = np.flatnonzero(np.abs(level - zero) > _LOADED * highest)
    if highest > 0 and len(loaded) <= _MOST_LOADED * len(level):
        for taxel in loaded.tolist():
            wrong.setdefault(taxel, f"always loaded: it reads {level[taxel]:.4g} while nothing presses")
    return wrong


@dataclass
class _IdleReadings:
    """Evenly some of the readings of an idle pad, at most 2,000. rows: (taxels,) each."""

    rows: list[FloatArray] = field(default_factory=list)
    _every: int = 1
    _seen: int = 0

    def add(self, pressures: FloatArray) -> None:
        """Take in one more."""
        if self._seen % self._every == 0:
            self.rows.append(pressures)
            if len(self.rows) > _IDLE:
                self.rows, self._every = self.rows[::2], 2 * self._every
        self._seen += 1


def _presses_of(
    readings: Iterable[tuple[float, FloatArray]], windows: Sequence[Window], idle: _IdleReadings
) -> Iterator[tuple[int, FloatArray, FloatArray]]:
    """Split readings (place, pressures) into presses, one after the other.

    Gives of each the number of its window, what was read since the press before, (k, taxels), and within it, (m,
    taxels); `idle` takes what lies in none. Nothing is given of a window without a reading.
    """
    coming = deque(sorted(range(len(windows)), key=lambda number: windows[number]))
    before: deque[FloatArray] = deque(maxlen=_SINCE)
    held: list[tuple[float, FloatArray]] = []
    for place, pressures in chain(readings, [(np.inf, np.zeros(0))]):
        while coming and windows[coming[0]].last < place:
            number = coming.popleft()
            own = [values for at, values in held if at <= windows[number].last]
            if own:
                yield number, np.array(before).reshape(-1, len(own[0])), np.array(own)
            before.clear()
            # What two windows have in common is read in both.
            held = [one for one in held if coming and windows[coming[0]].first <= one[0]]
        if np.isinf(place):
            return
        values = np.array(pressures, dtype=float)
        if coming and windows[coming[0]].first <= place:
            held.append((place, values))
        else:
            before.append(values)
            idle.add(values)


def _on_the_way(
    before: FloatArray, held: FloatArray, shares: FloatArray
) -> tuple[NDArray[np.bool_], FloatArray]:
    """Find the moments of a press in what was read before it and within it, of its own rise alone; see `moments_of`."""
    images = np.concatenate([before, held])
    felt = images.sum(axis=1)
    load = felt - np.quantile(felt, 0.05)
    still = plateau(load[len(before) :])
    if still is None:
        return np.zeros(len(shares), dtype=bool), np.zeros((len(shares), images.shape[1]))
    begin = len(before) + still.start
    light = np.flatnonzero(load[:begin] <= _RESTING * np.median(load[len(before) :][still]))
    own = slice(int(light[-1]) if len(light) else 0, None)
    return moments_of(images[own], shares, load[own])


def _without_seldom_shares(rows: Sequence[_Row]) -> list[_Row]:
    """Leave out training readings at a share of the load that fewer than half as many presses show as any other."""
    counts = Counter(row.share for row in rows if row.window.split == "train" and row.share < 1)
    seldom = {share for share, count in counts.items() if count < max(counts.values()) / 2}
    return [row for row in rows if row.window.split != "train" or row.share not in seldom]
