"""Scan matching: the pose of each letter that fits all readings best, found by branch and bound with a proof."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import Estimate, Options, probabilities
from tactsim.estimators.field.kernels import Sampled, replay
from tactsim.estimators.field.tables import Tables
from tactsim.estimators.filters.map_filter import GridFilter
from tactsim.estimators.filters.states import WeightedStates, Weights
from tactsim.estimators.options import MODELS, FilterOptions

# mm, about the side of the largest blocks, whose bounds are kept for all readings.
_LARGEST = 4.0
# Blocks that are cut in four together: so many that the arithmetic is in the kernel, so few that the best come first.
_AT_ONCE = 1024
# Nats below the best letter from which it does not matter how well another fits: its probability is below 1e-21.
_HOPELESS = 50.0


@dataclass(frozen=True, eq=False)
class Level:
    """What a block of `side` x `side` bins, given by the place of its first bin, may reach at most.

    sampled: as `field.replay` takes it. Interpolated at the first bin's place, it is not below what any bin of the
    block looks up. With a side of 1 it is the tables.
    """

    side: int
    sampled: Sampled


@dataclass(frozen=True, eq=False)
class Certificate:
    """The best bin of a grid, whichever letter's, and the proof that it is.

    label: its letter. robot_in_object: its middle, [x, y, theta]. lead: nats that it is above the upper bound of
    every bin that was left alone, infinite if none was. It is not negative: no bin of the grid is better.
    """

    label: str
    robot_in_object: FloatArray
    lead: float


class ScanMatchingOptions(FilterOptions):
    """Options of the scan matcher."""

    likelihood: str = Field("calibrated", description=MODELS)
    bins: int = Field(300_000, description="poses of each letter among which the best is found")
    split: str | None = Field(None, description="bins in x, y and angle such as 80x80x180, instead of bins")
    motion: Literal["off"] = Field("off", description="all readings are matched with one pose: nothing moves")
    skip: bool = Field(True, description="leave bins alone that cannot be the best; the answer is the same")


class ScanMatching(GridFilter):
    """Match all readings so far with the map of each letter, over a fine grid of poses (Olson 2009).

    The score of a pose is the log-likelihood of the readings, log p(z_1 ... z_n | letter, T_R^O). The best bin is found
    by branch and bound (Hess et al. 2016): for every angle the plane is cut into blocks, whose upper bounds are looked
    up in a pyramid of maxima, the most promising are cut in four, and a block whose bound is not above the best bin
    that is known of its letter is left alone.

    No belief is kept: a letter counts as its best pose alone. So its probability is a softmax of the letters' scores,
    the posterior if each letter had but this one pose. How many other poses fit nearly as well is forgotten, hence it
    is sure too early.
    """

    options_type: type[Options] = ScanMatchingOptions
    options: ScanMatchingOptions

    def __init__(self, options: ScanMatchingOptions) -> None:
        super().__init__(options, options.bins, options.split)
        self._bounds = self._skipped = 0

    def _fit(self) -> None:
        size = max(_LARGEST / min(self.grid.spacing[:2]), 1)
        self._levels = pyramid(self.field.tables, 2 ** round(math.log2(size)) if self.options.skip else 1)
        side = self._levels[-1].side
        rows, columns = np.arange(0, self.grid.y, side), np.arange(0, self.grid.x, side)
        letters, angles = np.arange(len(self.labels)), np.arange(self.grid.angle)
        blocks = np.meshgrid(letters, angles, rows, columns, indexing="ij")
        # Blocks, as everywhere below: (4, n) letter and angle, row and column of the first bin.
        self._largest = np.stack([index.ravel() for index in blocks])
        self._largest_bounds = np.empty(self._largest.shape[1])
        self._best = np.empty((4, len(letters)), dtype=np.int64)
        self._scores = np.empty(len(letters))

    def _reset(self, rng: np.random.Generator) -> None:
        """Before the first reading every bin is the best; the middle one is named."""
        self._largest_bounds[:] = 0
        self._scores[:] = 0
        middle = [[self.grid.angle // 2], [self.grid.y // 2], [self.grid.x // 2]]
        self._best[0], self._best[1:] = np.arange(len(self.labels)), middle
        self._left_alone = -math.inf

    def measure(self) -> None:
        """Find the best pose of each letter for all readings so far."""
        last = len(self.field) - 1
        # A place to start from: what was best of each letter before this reading.
        self._add(self._scores, self._levels[0], self._best, last)
        self._add(self._largest_bounds, self._levels[-1], self._largest, last)
        self._left_alone = -math.inf
        self._skipped += len(self.labels) * self.grid.bins
        self._search(len(self._levels) - 1, self._largest, self._largest_bounds)

    def _search(self, level: int, blocks: NDArray[np.int64], bounds: FloatArray) -> None:
        """Find the best bins within blocks (4, n) of a level, whose bounds are (n,), and note what was left alone."""
        if level == 0:
            self._skipped -= len(bounds)
            for letter in np.unique(blocks[0]):
                of_letter = np.flatnonzero(blocks[0] == letter)
                best = of_letter[bounds[of_letter].argmax()]
                if bounds[best] > self._scores[letter]:
                    self._scores[letter], self._best[:, letter] = bounds[best], blocks[:, best]
            return
        order = np.argsort(-bounds, kind="stable")
        for first in range(0, len(order), _AT_ONCE):
            # A block that was worth a look may not be any more, now that better bins are known.
            limit = np.maximum(self._scores, self._scores.max() - _HOPELESS)
            rest = order[first:]
            worth = bounds[rest] > limit[blocks[0, rest]]
            if not worth.any():
                self._left_alone = max(self._left_alone, float(bounds[rest[0]]))
                return
            chosen, left = rest[:_AT_ONCE][worth[:_AT_ONCE]], rest[:_AT_ONCE][~worth[:_AT_ONCE]]
            self._left_alone = max(self._left_alone, float(bounds[left].max(initial=-math.inf)))
            parts = self._quarters(blocks[:, chosen], self._levels[level - 1].side)
            part_bounds = np.zeros(parts.shape[1])
            self._add(part_bounds, self._levels[level - 1], parts, 0)
            self._search(level - 1, parts, part_bounds)

    def _quarters(self, blocks: NDArray[np.int64], side: int) -> NDArray[np.int64]:
        """Cut blocks (4, n) into those of half the side, `side`; what lies beyond the grid is dropped."""
        parts = np.repeat(blocks, 4, axis=1)
        parts[2] += np.tile([0, 0, side, side], blocks.shape[1])
        parts[3] += np.tile([0, side, 0, side], blocks.shape[1])
        return parts[:, (parts[2] < self.grid.y) & (parts[3] < self.grid.x)]

    def _add(self, scores: FloatArray, level: Level, blocks: NDArray[np.int64], first: int) -> None:
        """Add to scores (n,) the log-likelihood of the readings from `first` on, or its bounds, of blocks (4, n)."""
        letter, angle, row, column = blocks
        x, y, theta = self.grid.centres
        state = np.stack([x[column], y[row], theta[angle]])
        count = len(self.field)
        replay(scores, state, np.ascontiguousarray(letter), self.field.terms, first, count, level.sampled)
        if level.side == 1:
            self._evaluated += len(scores) * (count - first)
        else:
            self._bounds += len(scores) * (count - first)

    def _states(self) -> FloatArray:
        """Give the best T_R^O of each letter (3, letters), mm, mm, rad."""
        x, y, theta = self.grid.centres
        _, angle, row, column = self._best
        return np.stack([x[column], y[row], theta[angle]])

    def own_estimate(self) -> Estimate:
        """Compare the letters by their best poses."""
        best, p = self.likeliest(np.exp(self._scores - self._scores.max()))
        return Estimate(self.labels[best], probabilities(self.labels, p), self._states()[:, best])

    def certificate(self) -> Certificate:
        """Give the best bin, and how far below it the bins that were left alone are at least.

        The lead is not negative: no bin of the grid, whichever letter's, is better. It is 0 where another is as good.
        """
        best = int(self._scores.argmax())
        lead = float(self._scores[best]) - self._left_alone
        return Certificate(self.labels[best], self._states()[:, best], lead)

    def own_states(self) -> WeightedStates:
        """Give the best pose of each letter."""
        return WeightedStates(np.arange(len(self.labels)), self._states(), Weights(self._scores))

    @property
    def work(self) -> dict[str, Any]:
        """Count evaluations, a bin or a block with a reading each, made and skipped since the estimator was made.

        bound_evaluations: of blocks of bins, made in order to skip bins. skipped: bins left alone, at every reading.
        """
        return {
            "likelihood_evaluations": self._evaluated,
            "bound_evaluations": self._bounds,
            "skipped": {"bins": self._skipped},
        }


def pyramid(tables: Tables, side: int) -> list[Level]:
    """Make the levels of blocks of 1, 2, 4, ..., `side` bins; the first is the tables themselves.

    A node becomes the maximum of the nodes that the bins of a block beginning there may look up, as in the precomputed
    grids of Hess et al. (2016). One node more is taken in on every side, so that it does not matter how places are
    rounded. Where not all of these nodes are equal, one unit is added: interpolation may round up by less.
    """
    levels = [Level(1, tables.sampled)]
    while levels[-1].side < side:
        levels.append(_level(tables, 2 * levels[-1].side))
    return levels


def _level(tables: Tables, side: int) -> Level:
    from scipy.ndimage import maximum_filter1d, minimum_filter1d  # imported here: only a fit needs it

    highest = lowest = tables.nodes
    low = []  # nodes that the lattice grows by before the first, in y and x
    for axis, phases in zip((2, 3), tables.phases, strict=True):
        span = (side - 1) * phases + 3
        frame = [(0, 0)] * 4
        frame[axis] = (span, 2)
        # Output [i] is of the nodes [i - 1 : i + span - 1]; beyond the lattice they are 0.
        where = {"size": span, "axis": axis, "origin": 1 - (span - span // 2), "mode": "constant"}
        highest = maximum_filter1d(np.pad(highest, frame), **where)
        lowest = minimum_filter1d(np.pad(lowest, frame), **where)
        low.append(span)
    highest += highest > lowest
    lattice = tables.sampled.lattice
    lattice[:2] -= np.array(low[::-1]) * lattice[2:]
    return Level(side, tables.sampled._replace(nodes=highest, lattice=lattice))
