"""The coarse-to-fine histogram filter: the best bins are halved again and again, all readings replayed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import Estimate, Options, PlaneBelief
from tactsim.estimators.field.kernels import pick
from tactsim.estimators.field.state_kernels import replay_halves
from tactsim.estimators.filters.grid import Cells
from tactsim.estimators.filters.histogram import HistogramFilter, HistogramOptions
from tactsim.estimators.filters.open_set import OpenSetFilter, OpenSetOptions
from tactsim.estimators.filters.placement import mean_around
from tactsim.estimators.filters.resampling import systematic
from tactsim.estimators.likelihoods.likelihood import Evidence

# Cells this many nats below the heaviest are left out of sums; of means of poses, sooner.
_NEGLIGIBLE, _NEGLIGIBLE_IN_MEAN = 30.0, 20.0
# Nats that rounding may move the highest log-belief of a block of bins.
_ROUNDING = 1e-6


class RefinedOptions(HistogramOptions, OpenSetOptions):
    """Options of the coarse-to-fine histogram filter."""

    likelihood: str = Field("calibrated", description="the measurement model: paper, calibrated, force")
    bins: int = Field(5_000, description="coarse bins per letter; Table I's counts split as printed")
    split: str | None = Field(
        None, description="coarse bins in x, y and angle such as 16x16x36, instead of bins"
    )
    cells: int = Field(100, ge=1, le=100_000, description="how many of the best cells are halved, each time")
    halvings: int = Field(3, ge=0, le=8, description="how many times cells are halved in x, y and angle")
    skip: bool = Field(
        True, description="replay only the new reading in cells halved before; the answer is the same"
    )


@dataclass(frozen=True, eq=False)
class _Halved:
    """Cells that were halved once more: `cell` (n,) ascending; `half`, log_p (n, 8): what they were halved into.

    Cells and halves are flat indices into the grid of their size.
    """

    cell: NDArray[np.int64]
    half: NDArray[np.int64]
    log_p: FloatArray


_Leaves = tuple[NDArray[np.int64], FloatArray]  # cells of one size and their log-beliefs, (n,) each


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
        self._unreplayed = 0

    def describe(self) -> str:
        """Say how the state space is split, in one line."""
        dx, dy, da = (gap / 2**self.options.halvings for gap in self.grid.spacing)
        return (
            f"{self.grid.describe()}; the {self.options.cells} best halved {self.options.halvings} times, "
            f"to {dx:.2g} mm x {dy:.2g} mm x {math.degrees(da):.2g} deg"
        )

    @property
    def _leaves_bins(self) -> bool:
        """Leave no bin alone: ranking needs them all."""
        return False

    def prepare(self) -> None:
        """Tabulate the likelihood; bring the same nodes in an order for cells that lie anywhere."""
        super().prepare()
        kinds, letters, phases_y, phases_x, rows, columns = self.tables.values.shape
        nodes = self.tables.values.transpose(0, 1, 4, 2, 5, 3)
        self._nodes = nodes.reshape(kinds, letters, rows * phases_y, columns * phases_x)
        self._lattice = np.concatenate([self.tables.origin, self.tables.step])
        self._counts = np.array([self.grid.x, self.grid.y, self.grid.angle])
        self._spacing = np.array(self.grid.spacing)
        every = np.arange(letters * self.grid.bins)
        self._prior: _Leaves = every, np.zeros(len(every))
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
        for times in range(self.options.halvings):
            chosen = _highest(log_p, self.options.cells)
            rest = np.ones(len(cell), dtype=bool)
            rest[chosen] = False
            self._leaves.append((cell[rest], log_p[rest]))
            halved = self._halve(times, np.sort(cell[chosen]), before[times] if before else None)
            self._halved.append(halved)
            cell, log_p = halved.half.ravel(), halved.log_p.ravel()
        self._leaves.append((cell, log_p))

    def answer(self) -> Estimate:
        """Sum the belief of each letter (eq. 14); average the placement around the best letter's mode."""
        cells, log_weight = self._belief_in_cells()
        letter = cells.letter
        mass = np.bincount(letter, np.exp(log_weight), minlength=len(self.labels))
        best = int(mass.argmax())
        mine = np.flatnonzero(letter == best)
        mine = mine[log_weight[mine] > log_weight[mine].max() - _NEGLIGIBLE_IN_MEAN]
        log_p = log_weight[mine] + math.log(8) * cells.times[mine]
        probabilities = (mass / mass.sum()).tolist()
        return Estimate(
            label=self.labels[best],
            probabilities=dict(zip(self.labels, probabilities, strict=True)),
            robot_in_object=mean_around(cells[mine].states(), log_weight[mine], int(log_p.argmax())),
        )

    def weighted_states(self) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
        """Give the belief as weighted states: letter (n,), T_R^O (3, n) mm, mm, rad, log-weight (n,).

        They are the middles of the cells, large and small, that hold the belief; the weights sum to 1.
        """
        cells, log_weight = self._belief_in_cells()
        return cells.letter, cells.states(), log_weight - math.log(np.exp(log_weight).sum())

    def draw_states(self, count: int, rng: np.random.Generator) -> tuple[NDArray[np.int64], FloatArray]:
        """Draw cells, large and small, by what they hold, and a place in each."""
        cells, log_weight = self._belief_in_cells()
        chosen = cells[systematic(np.exp(log_weight), count, rng)]
        within = rng.uniform(-0.5, 0.5, (3, count))
        return chosen.letter, chosen.states() + within * chosen.size

    def belief_over_plane(self) -> PlaneBelief:
        """Sum the belief of each coarse bin and over the angle."""
        cells, log_weight = self._belief_in_cells()
        _, row, column = cells.bins()
        shape = len(self.labels), self.grid.y, self.grid.x
        place = np.ravel_multi_index((cells.letter, row, column), shape)
        probability = np.bincount(place, np.exp(log_weight), minlength=math.prod(shape)).reshape(shape)
        x, y, _ = self.grid.centres
        return PlaneBelief(self.labels, x, y, probability / probability.sum())

    @property
    def work(self) -> dict[str, Any]:
        """Count evaluations, a bin or cell in a reading each, made and skipped since the estimator was made."""
        return {"likelihood_evaluations": self._evaluated, "skipped": {"replays": self._unreplayed}}

    def _best_bins(self) -> tuple[NDArray[np.int64], FloatArray]:
        """List the coarse bins that are not negligible, and in any case the best `cells`: flat, log-belief."""
        count = len(self._history)
        ceiling = float(self._history.terms.ceiling[count])
        highest = self._belief.upper.ravel() + ceiling
        # Each of the best blocks has a bin as high as itself: that many bins are not lower. The first
        # that is not split is wanted, too.
        place = max(0, len(highest) - self.options.cells - 1)
        enough = np.partition(highest, place)[place] if place else -math.inf
        least = min(enough, highest.max() - _NEGLIGIBLE) - _ROUNDING
        cell, log_p = self._picked
        found = pick(self._belief, ceiling, count, least, cell, log_p)
        return cell[:found].copy(), log_p[:found].copy()

    def _halve(self, times: int, cell: NDArray[np.int64], before: _Halved | None) -> _Halved:
        """Evaluate the halves of cells (n,), themselves halved `times` before, over the whole history."""
        count = len(self._history)
        halved = _Halved(cell, np.empty((len(cell), 8), dtype=np.int64), np.zeros((len(cell), 8)))
        new = np.ones(len(cell), dtype=bool)
        if before is not None and len(before.cell) and self.options.skip:
            place = np.minimum(np.searchsorted(before.cell, cell), len(before.cell) - 1)
            new = before.cell[place] != cell
            old = np.flatnonzero(~new)
            halved.log_p[old] = before.log_p[place[old]]
            self._replay(times, halved, old, count - 1)
            self._unreplayed += 8 * len(old) * (count - 1)
        self._replay(times, halved, np.flatnonzero(new), 0)
        return halved

    def _replay(self, times: int, halved: _Halved, which: NDArray[np.intp], first: int) -> None:
        """Add the readings from `first` on to the log-beliefs of the halves of some cells."""
        terms, count = self._history.terms, len(self._history)
        replay_halves(
            halved.half, halved.log_p, halved.cell, which, self._counts << times, self._spacing / 2**times,
            terms.start, terms.kind, terms.xy, terms.weight, terms.constant, first, count, self._nodes,
            self._lattice,
        )  # fmt: skip
        self._evaluated += 8 * len(which) * (count - first)

    def _belief_in_cells(self) -> tuple[Cells, FloatArray]:
        """Give the cells that were not split and are not negligible, and the log of what they hold, up to 0."""
        volume = -math.log(8) * np.arange(len(self._leaves))
        tops = [log_p.max(initial=-math.inf) for _, log_p in self._leaves]
        highest = (volume + tops).max()
        times, index, log_weight = [], [], []
        for depth, (cell, log_p) in enumerate(self._leaves):
            held = log_p + (volume[depth] - highest)
            heavy = np.flatnonzero(held > -_NEGLIGIBLE)
            times.append(np.full(len(heavy), depth))
            index.append(cell[heavy])
            log_weight.append(held[heavy])
        cells = Cells(self.grid, np.concatenate(times), np.concatenate(index))
        return cells, np.concatenate(log_weight)


def _highest(values: FloatArray, count: int) -> NDArray[np.intp]:
    """Give the indices of the `count` highest values (n,), or of all if there are fewer.

    Where the last of them are as high as others, which are not among them, they are left out, too: of
    letters that look alike none may be preferred.
    """
    if count >= len(values):
        return np.arange(len(values))
    next_one = len(values) - count - 1
    return np.flatnonzero(values > np.partition(values, next_one)[next_one])
