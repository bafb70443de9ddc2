"""The best bins of a grid, found without looking at bins that cannot be among them (branch and bound)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray
from tactsim.estimators.field.field import LikelihoodField
from tactsim.estimators.filters.bin_maxima import bin_maxima, blank_ceiling
from tactsim.estimators.filters.bin_sums import pick
from tactsim.estimators.filters.binned import BinnedBelief
from tactsim.estimators.filters.bounding import lower
from tactsim.estimators.filters.grid import StateGrid
from tactsim.estimators.filters.raising import block_tops, raise_to

# Nats by which rounding may move the bound of a block of bins.
_ROUNDING = 1e-6


class RankedBins(BinnedBelief):
    """The log-belief of all bins, of which only the best are brought up to date.

    A block of bins waits while its upper bound is below the bins that are asked for. The bound is that of the last
    time its bins were up to date, plus what any state may have gained since; if that is not enough, plus the tables'
    maxima over the block.

    evaluated, bounds: how many times a bin and a block took in a reading since this was made.
    """

    def __init__(self, field: LikelihoodField, grid: StateGrid, skip: bool) -> None:
        super().__init__(field, grid)
        if skip:
            x, y, _ = grid.centres
            self._maxima = bin_maxima(field.tables, np.array([x[0], y[0]]))
            self._ceiling = blank_ceiling(self._belief)
        self._skip = skip
        self._ranked = -math.inf
        self.evaluated = self.bounds = 0

    def reset(self) -> None:
        """Make all bins of all letters equally probable."""
        super().reset()
        if self._skip:
            self._ceiling.since[:] = -1
        self._ranked = -math.inf

    def rank(self, count: int) -> tuple[NDArray[np.int64], FloatArray]:
        """List the bins that are as good as the best `count` and one more after the field's last reading.

        Returns flat indices into (letters, angles, rows, columns), and log-beliefs.
        """
        terms, readings = self._field.terms, len(self._field)
        if readings == 1 or not self._skip:
            # A first reading tells too little for a bound to be worth its time.
            self._raise_to(-math.inf, bounding=False)
        else:
            # What was among the best before this reading sets a limit that few others reach.
            self._raise_to(
                self._ranked + float(terms.upper[readings] - terms.upper[readings - 1]), bounding=False
            )
            self._raise_to(self._limit(count), bounding=True)
        self._ranked = self._limit(count)
        return self._pick(self._ranked)

    def above(self, least: float) -> tuple[NDArray[np.int64], FloatArray]:
        """List the bins whose log-belief is at least `least`: flat indices and log-beliefs, as `rank`."""
        if self._skip and len(self._field) > 1:
            self._raise_to(least, bounding=True)
        return self._pick(least)

    def certificate(self) -> tuple[int, FloatArray, float]:
        """Give the letter and the middle [x, y, theta] of the best bin, and its lead over bins that were left alone.

        The lead is that over their upper bounds, nats; infinite if all bins are up to date.
        """
        belief, readings = self._belief, len(self._field)
        any_state, waits = float(self._field.terms.upper[readings]), belief.seen != readings
        flat, log_p = self._pick(float(belief.upper[~waits].max()) + any_state - _ROUNDING)
        letter, angle, row, column = np.unravel_index(
            flat[log_p.argmax()], (len(waits), self._grid.angle, self._grid.y, self._grid.x)
        )
        x, y, theta = self._grid.centres
        others = float(belief.upper[waits].max()) + any_state if waits.any() else -math.inf
        return int(letter), np.array([x[column], y[row], theta[angle]]), float(log_p.max()) - others

    def _raise_to(self, floor: float, *, bounding: bool) -> None:
        field, belief, turns, least = self._field, self._belief, self._turns, floor - _ROUNDING
        terms, readings, longest = field.terms, len(field), field.longest
        if bounding and self._skip:
            self.bounds += lower(belief, self._ceiling, self._maxima, terms, turns, readings, longest, least)
        self.evaluated += raise_to(belief, self._bins, terms, turns, readings, longest, least)

    def _limit(self, count: int) -> float:
        """Find the log-belief of the best bin but `count`, of those that are up to date; -inf if there is none."""
        readings = len(self._field)
        tops = block_tops(self._belief, readings) + float(self._field.terms.upper[readings])
        # A block that is up to date has a bin as high as its bound: as many bins as blocks are not lower.
        enough = (
            np.partition(tops, len(tops) - count - 1)[len(tops) - count - 1]
            if len(tops) > count
            else -math.inf
        )
        _, log_p = self._pick(enough)
        return (
            float(np.partition(log_p, len(log_p) - count - 1)[len(log_p) - count - 1])
            if len(log_p) > count
            else -math.inf
        )

    def _pick(self, least: float) -> tuple[NDArray[np.int64], FloatArray]:
        readings = len(self._field)
        flat, log_p = self._room
        any_state = float(self._field.terms.upper[readings])
        found = pick(self._belief, any_state, readings, least, flat, log_p)
        return flat[:found].copy(), log_p[:found].copy()
