"""Follow a recording reading by reading: the moments of each press, and taxels that are wrong while nothing presses."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tactsim.core.errors import InputError
from tactsim.core.moments import moments_of, plateau
from tactsim.core.poses import FloatArray
from tactsim.hardware.calibration import LEAST_FRAMES, find_stuck

# Readings that are remembered: of what came since the last press, and of the idle pad.
_SINCE, _IDLE = 20_000, 2000
# A pad is idle while less than this share of a press is felt, above the least that is felt.
_RESTING = 0.1
# A taxel that reads this share of the highest of a press while the pad is idle is always loaded.
_LOADED = 0.25
# More than this share of the taxels are not always loaded: then the pad has no tare.
_MOST_LOADED = 0.25


@dataclass
class Follower:
    """Take the readings of a recording in their order.

    windows: first and last place of each press in the recording, such as times or numbers, rising. shares: of the
    plateau's load at which images are wanted; None: none are. moments: by number of the window, which
    of the shares there are (m,), and their images (m, taxels).
    """

    windows: Sequence[tuple[float, float]]
    shares: FloatArray | None = None
    moments: dict[int, tuple[NDArray[np.bool_], FloatArray]] = field(default_factory=dict)
    _since: deque[FloatArray] = field(default_factory=lambda: deque(maxlen=_SINCE))
    _idle: list[FloatArray] = field(default_factory=list)
    _every: int = 1
    _seen: int = 0
    _within: int = 0
    _next: int = 0

    def __post_init__(self) -> None:
        self._order = sorted(range(len(self.windows)), key=lambda number: self.windows[number])

    def take(self, at: float, pressures: FloatArray) -> None:
        """Take in the reading (taxels,) at a place of the recording."""
        while self._next < len(self._order) and self.windows[self._order[self._next]][1] < at:
            self._end_press()
        inside = self._next < len(self._order) and self.windows[self._order[self._next]][0] <= at
        self._within += inside
        if self.shares is not None:
            self._since.append(np.array(pressures, dtype=float))
        if not inside:
            self._rest(pressures)

    def end(self) -> None:
        """Take it that nothing comes any more."""
        while self._next < len(self._order):
            self._end_press()

    def wrong_taxels(self, presses: FloatArray) -> tuple[dict[int, str], FloatArray]:
        """Find the taxels that are wrong while nothing presses: {number: why}, and what all read then, (taxels,).

        presses: (n, taxels) the readings of the presses. A taxel is stuck if it never changes, neither idle nor
        pressed, though the others do; it is always loaded if it reads a quarter of the highest taxel of a press while
        the pad is idle. Without 40 idle readings nothing is known of any.
        """
        idle = np.array(self._idle).reshape(-1, presses.shape[1])
        felt = idle.sum(axis=1)
        if len(idle) >= LEAST_FRAMES:
            least = np.quantile(felt, 0.05)
            idle = idle[felt <= least + _RESTING * max(float(np.median(presses.sum(axis=1))) - least, 0.0)]
        if len(idle) < LEAST_FRAMES:
            return {}, np.zeros(presses.shape[1])
        level = np.median(idle, axis=0)
        if (idle == level).all() and (presses == level).all():
            raise InputError("every taxel of the recording is stuck: none changes when something presses")
        zero = float(np.median(level))
        wrong = {
            int(taxel): f"stuck at {level[taxel]:.4g}"
            for taxel in find_stuck(idle)
            if (presses[:, taxel] == level[taxel]).all()
        }
        highest = float(np.median(presses.max(axis=1))) - zero
        loaded = np.flatnonzero(np.abs(level - zero) > _LOADED * highest)
        if highest > 0 and len(loaded) <= _MOST_LOADED * len(level):
            wrong |= {
                int(taxel): f"always loaded: it reads {level[taxel]:.4g} while nothing presses"
                for taxel in loaded
                if int(taxel) not in wrong
            }
        if len(wrong) == len(level):
            raise InputError(
                "every taxel of the recording is stuck or always loaded; nothing is left to read"
            )
        return dict(sorted(wrong.items())), level

    def _rest(self, pressures: FloatArray) -> None:
        if self._seen % self._every == 0:
            self._idle.append(np.array(pressures, dtype=float))
            if len(self._idle) > _IDLE:
                self._idle, self._every = self._idle[::2], 2 * self._every
        self._seen += 1

    def _end_press(self) -> None:
        """Find the moments of the press that is over: of what came since the one before, only its own rise counts."""
        number, within = self._order[self._next], self._within
        self._next, self._within = self._next + 1, 0
        images = np.array(self._since)
        self._since.clear()
        if self.shares is None or not within:
            return
        felt = images.sum(axis=1)
        load = felt - np.quantile(felt, 0.05)
        held = plateau(load[-within:])
        if held is None:
            return
        begin = len(load) - within + held.start
        light = np.flatnonzero(load[:begin] <= _RESTING * np.median(load[-within:][held]))
        own = slice(int(light[-1]) if len(light) else 0, None)
        found, taken = moments_of(images[own], self.shares, load[own])
        if found.any():
            self.moments[number] = found, taken
