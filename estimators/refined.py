"""The coarse-to-fine histogram filter: the best bins are halved again and again, all readings replayed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from estimators.base import Estimate, Options, PlaneBelief
from estimators.grid import StateGrid
from estimators.histogram import HistogramFilter, HistogramOptions
from estimators.kernels import pick
from estimators.likelihood import Evidence
from estimators.open_set import OpenSetFilter, OpenSetOptions
from estimators.placement import mean_around
from estimators.resampling import systematic
from estimators.state_kernels import replay
from tactsim.poses import FloatArray

# Bins this many nats below the best bin are left out, unless they are split.
_NEGLIGIBLE = 40.0
# Nats that rounding may move the highest log-belief of a block of bins.
_ROUNDING = 1e-6


class RefinedOptions(HistogramOptions, OpenSetOptions):
    """Options of the coarse-to-fine histogram filter."""

    likelihood: str = Field("calibrated", description="the measurement model: paper, calibrated")
    bins: int = Field(5_000, description="coarse bins per letter; Table I's counts split as printed")
    split: str | None = Field(
        None, description="coarse bins in x, y and angle such as 16x16x36, instead of bins"
    )
    cells: int = Field(200, ge=1, le=100_000, description="how many of the best cells are halved, each time")
    halvings: int = Field(3, ge=0, le=8, description="how many times cells are halved in x, y and angle")
    skip: bool = Field(
        True, description="replay only the new reading in cells halved before; the answer is the same"
    )


@dataclass(frozen=True, eq=False)
class _Halved:
    """The cells that were halved once more: `cell` (n,) flat and ascending, log_p (n, 8) of their halves."""

    cell: NDArray[np.int64]
    log_p: FloatArray


@dataclass(frozen=True, eq=False)
class _Leaves:
    """The cells of one size that were not halved: flat index into the grid (n,) and log-belief (n,)."""

    grid: StateGrid
    cell: NDArray[np.int64]
    log_p: FloatArray
    log_volume: float

    @property
    def log_weight(self) -> FloatArray:
        """Log of what a cell holds of the belief, (n,), not normalised."""
        return self.log_p + self.log_volume


class RefinedFilter(OpenSetFilter, HistogramFilter):
    """Histogram filter over coarse bins, the best of which are split into smaller and smaller cells.

    After every reading the `cells` best of all bins, whichever letter's, are halved in x, y and angle, the
    `cells` best of these halves likewise, and so on, `halvings` times. The whole history is replayed in each
    new cell. The bins are ranked, and not compared with a limit: the longer the sequence, the less likely is
    the middle of the bin that holds the truth beside the truth itself.

    The belief is what the leaves hold: a cell's likelihood is that of its middle, times its volume. So a
    cell that was split is worth the mean of its parts. `log_belief` remains that of the coarse bins.
    """

    options_type: ClassVar[type[Options]] = RefinedOptions
    options: RefinedOptions

    def __init__(self, options: RefinedOptions) -> None:
        super().__init__(options)
        self._grids = [self.grid.halved(times) for times in range(options.halvings + 1)]
        self._unreplayed = 0

    def describe(self) -> str:
        """Say how the state space is split, in one line."""
        dx, dy, da = self._grids[-1].spacing
        return (
            f"{self.grid.describe()}; the {self.options.cells} best halved {self.options.halvings} times, "
            f"to {dx:.2g} mm x {dy:.2g} mm x {math.degrees(da):.2g} deg"
        )

    def prepare(self) -> None:
        """Tabulate the likelihood; bring the same nodes in an order for cells that lie anywhere."""
        super().prepare()
        # Ranking needs all bins, so none is left alone.
        self._margin = math.inf
        kinds, letters, phases_y, phases_x, rows, columns = self.tables.values.shape
        nodes = self.tables.values.transpose(0, 1, 4, 2, 5, 3)
        self._nodes = nodes.reshape(kinds, letters, rows * phases_y, columns * phases_x)
        self._lattice = np.concatenate([self.tables.origin, self.tables.step])
        every = np.arange(letters * self.grid.bins)
        self._prior = _Leaves(self.grid, every, np.zeros(len(every)), 0.0)
        self._picked = np.empty_like(every), np.empty(len(every))

    def restart(self, rng: np.random.Generator) -> None:
        """Make all bins of all letters equally probable."""
        super().restart(rng)
        self._halved: list[_Halved] = []
        self._leaves = [self._prior]

    def take(self, evidence: Evidence, sensor_in_robot: FloatArray) -> None:
        """Update the coarse bins (eq. 13), then split the best."""
        super().take(evidence, sensor_in_robot)
        before, self._halved, self._leaves = self._halved, [], []
        cell, log_p = self._best_bins()
        for times, grid in enumerate(self._grids[:-1]):
            chosen = _highest(log_p, self.options.cells)
            rest = np.ones(len(cell), dtype=bool)
            rest[chosen] = False
            self._leaves.append(_Leaves(grid, cell[rest], log_p[rest], -times * math.log(8)))
            halved = self._halve(times, np.sort(cell[chosen]), before[times] if before else None)
            self._halved.append(halved)
            cell, log_p = grid.halves(halved.cell).ravel(), halved.log_p.ravel()
        self._leaves.append(_Leaves(self._grids[-1], cell, log_p, -self.options.halvings * math.log(8)))

    def answer(self) -> Estimate:
        """Sum the belief of each letter (eq. 14); average the placement around the best letter's mode."""
        letter, state, log_weight, log_p = self._states()
        mass = np.bincount(letter, np.exp(log_weight), minlength=len(self.labels))
        best = int(mass.argmax())
        mine = np.flatnonzero(letter == best)
        probabilities = (mass / mass.sum()).tolist()
        return Estimate(
            label=self.labels[best],
            probabilities=dict(zip(self.labels, probabilities, strict=True)),
            robot_in_object=mean_around(state[:, mine], log_weight[mine], int(log_p[mine].argmax())),
        )

    def weighted_states(self) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
        """Give the belief as weighted states: letter (n,), T_R^O (3, n) mm, mm, rad, log-weight (n,).

        They are the middles of the cells, large and small, that hold the belief; the weights sum to 1.
        """
        letter, state, log_weight, _ = self._states()
        return letter, state, log_weight - math.log(np.exp(log_weight).sum())

    def draw_states(self, count: int, rng: np.random.Generator) -> tuple[NDArray[np.int64], FloatArray]:
        """Draw cells, large and small, by what they hold, and a place in each."""
        log_weight = np.concatenate([leaves.log_weight for leaves in self._leaves])
        chosen = systematic(np.exp(log_weight - log_weight.max()), count, rng)
        parts, end = [], 0
        for leaves in self._leaves:
            begin, end = end, end + len(leaves.cell)
            first, last = np.searchsorted(chosen, [begin, end])
            letter, state = leaves.grid.states(leaves.cell[chosen[first:last] - begin])
            within = rng.uniform(-0.5, 0.5, state.shape) * np.array(leaves.grid.spacing)[:, None]
            parts.append((letter, state + within))
        letter, state = (np.concatenate(part, axis=-1) for part in zip(*parts, strict=True))
        return letter, state

    def belief_over_plane(self) -> PlaneBelief:
        """Sum the belief of each coarse bin and over the angle."""
        grid = self.grid
        probability = np.zeros(len(self.labels) * grid.y * grid.x)
        highest = max(leaves.log_weight.max(initial=-math.inf) for leaves in self._leaves)
        for times, leaves in enumerate(self._leaves):
            letter, _, row, column = leaves.grid.places(leaves.cell)
            place = (letter * grid.y + (row >> times)) * grid.x + (column >> times)
            weight = np.exp(leaves.log_weight - highest)
            probability += np.bincount(place, weight, minlength=len(probability))
        probability = probability.reshape(len(self.labels), grid.y, grid.x) / probability.sum()
        x, y, _ = grid.centres
        return PlaneBelief(self.labels, x, y, probability)

    @property
    def work(self) -> dict[str, Any]:
        """Count evaluations, a bin or cell in a reading each, made and skipped since the estimator was made."""
        return {"likelihood_evaluations": self._evaluated, "skipped": {"replays": self._unreplayed}}

    def _best_bins(self) -> tuple[NDArray[np.int64], FloatArray]:
        """List the coarse bins that are not negligible, and in any case the best `cells`: flat, log-belief."""
        count = len(self._history)
        ceiling = float(self._history.terms.ceiling[count])
        highest = self._belief.upper.ravel() + ceiling
        # Each of the best blocks has a bin as high as itself: that many bins are not lower.
        place = max(0, len(highest) - self.options.cells)
        enough = np.partition(highest, place)[place] if place else -math.inf
        least = min(enough, highest.max() - _NEGLIGIBLE) - _ROUNDING
        cell, log_p = self._picked
        found = pick(self._belief, ceiling, count, least, cell, log_p)
        return cell[:found].copy(), log_p[:found].copy()

    def _halve(self, times: int, cell: NDArray[np.int64], before: _Halved | None) -> _Halved:
        """Evaluate the halves of cells (n,) that were halved `times` before, whole history."""
        count = len(self._history)
        halves = self._grids[times].halves(cell)
        log_p = np.zeros(halves.shape)
        new = np.ones(len(cell), dtype=bool)
        if before is not None and self.options.skip:
            place = np.minimum(np.searchsorted(before.cell, cell), len(before.cell) - 1)
            new = before.cell[place] != cell
            old = ~new
            log_p[old] = self._replay(times + 1, halves[old], before.log_p[place[old]], count - 1)
            self._unreplayed += int(old.sum()) * 8 * (count - 1)
        log_p[new] = self._replay(times + 1, halves[new], log_p[new], 0)
        return _Halved(cell, log_p)

    def _replay(self, times: int, cell: NDArray[np.int64], log_p: FloatArray, first: int) -> FloatArray:
        """Add the readings from `first` on to the log-beliefs of cells (n, 8); returns them."""
        letter, state = self._grids[times].states(cell.ravel())
        count, total = len(self._history), log_p.ravel()
        terms = self._history.terms
        replay(
            total, state, letter, terms.start, terms.kind, terms.xy, terms.weight, terms.constant,
            first, count, self._nodes, self._lattice,
        )  # fmt: skip
        self._evaluated += total.size * (count - first)
        return total.reshape(log_p.shape)

    def _states(self) -> tuple[NDArray[np.int64], FloatArray, FloatArray, FloatArray]:
        """Give letter, state, log-weight (below 0) and log-belief of the leaves that are not negligible."""
        highest = max(leaves.log_weight.max(initial=-math.inf) for leaves in self._leaves)
        parts = []
        for leaves in self._leaves:
            log_weight = leaves.log_weight - highest
            heavy = np.flatnonzero(log_weight > -_NEGLIGIBLE)
            parts.append((*leaves.grid.states(leaves.cell[heavy]), log_weight[heavy], leaves.log_p[heavy]))
        letter, state, log_weight, log_p = (
            np.concatenate(part, axis=-1) for part in zip(*parts, strict=True)
        )
        return letter, state, log_weight, log_p


def _highest(values: FloatArray, count: int) -> NDArray[np.intp]:
    """Give the indices of the `count` highest values (n,), or of all if there are fewer."""
    if count >= len(values):
        return np.arange(len(values))
    return np.argpartition(values, len(values) - count)[len(values) - count :]
