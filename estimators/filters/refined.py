"""The coarse-to-fine histogram filter: the best bins are halved again and again, all readings replayed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tactsim.core import Scan
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import Estimate, Options, PlaneBelief
from tactsim.estimators.filters.binned import BinnedBelief, Certificate
from tactsim.estimators.filters.grid import Cells
from tactsim.estimators.filters.grid_filter import GridFilter
from tactsim.estimators.filters.halving import halve
from tactsim.estimators.filters.placement import mean_around
from tactsim.estimators.filters.states import WeightedStates, letter_mass, pose_samples, probabilities
from tactsim.estimators.filters.trust import learn_trust
from tactsim.estimators.filters.weights import Weights
from tactsim.estimators.likelihoods.occupancy import OccupancyMap
from tactsim.estimators.options import OpenSetOptions

# Cells are halved so often in any case, and on until the smallest hold the belief in so many cells (effective sample
# size): then they are about as large as the belief is wide.
_AT_LEAST, _ENOUGH = 3, 64.0
# Cells this many nats below the heaviest are left out of sums; of means of poses, sooner.
_NEGLIGIBLE, _NEGLIGIBLE_IN_MEAN = 30.0, 20.0


class RefinedOptions(OpenSetOptions):
    """Options of the coarse-to-fine histogram filter."""

    likelihood: str = Field(
        "calibrated", description="the measurement model: paper, calibrated, force, graded"
    )
    bins: int = Field(5_000, description="coarse bins per letter; Table I's counts split as printed")
    split: str | None = Field(
        None, description="coarse bins in x, y and angle such as 16x16x36, instead of bins"
    )
    cells: int = Field(100, ge=1, le=100_000, description="how many of the best cells are halved, each time")
    halvings: int = Field(
        6, ge=0, le=8, description="how many times cells are halved in x, y and angle, at most"
    )
    skip: bool = Field(
        True, description="replay only the new reading in cells halved before; the answer is the same"
    )


@dataclass(frozen=True, eq=False)
class _Halved:
    """Cells that were halved once more, and their halves.

    cell: (n,) ascending, half: (n, 8) flat indices into the grid of their size. log_p: (n, 8) log-beliefs.
    """

    cell: NDArray[np.int64]
    half: NDArray[np.int64]
    log_p: FloatArray


_Leaves = tuple[NDArray[np.int64], FloatArray]  # cells of one size and their log-beliefs, (n,) each


class RefinedFilter(GridFilter):
    """Coarse bins, the best of which are split into smaller and smaller cells.

    After every reading the `cells` best of all coarse bins, whichever letter's, are halved in x, y and angle,
    the `cells` best of these halves likewise, and so on, `halvings` times. The whole history is replayed in
    each new cell. The bins are ranked, and not compared with a limit: the longer the sequence, the less likely
    is the middle of the bin that holds the truth beside the truth itself.

    The log-likelihood of the readings is weighted by what left-out training readings say of how far a posterior may be
    trusted (`trust`). Halving ends, after the third time, when the smallest cells are about as large as the belief is
    wide.

    The belief is what the leaves hold: a cell's likelihood is that of its middle, times its volume. So a
    cell that was split is worth the mean of its parts.
    """

    options_type: type[Options] = RefinedOptions
    options: RefinedOptions

    def __init__(self, options: RefinedOptions) -> None:
        super().__init__(options, options.bins, options.split)
        self._evaluated = self._unreplayed = 0

    def describe(self) -> str:
        """Say how the state space is split, in one line."""
        dx, dy, da = (gap / 2**self.options.halvings for gap in self.grid.spacing)
        return (
            f"{self.grid.describe()}; the {self.options.cells} best halved up to {self.options.halvings} times, "
            f"to {dx:.2g} mm x {dy:.2g} mm x {math.degrees(da):.2g} deg"
        )

    def _fit(self) -> None:
        self._coarse = BinnedBelief(self.field, self.grid)
        self._counts = np.array([self.grid.x, self.grid.y, self.grid.angle])
        self._size = np.array(self.grid.spacing)
        every = np.arange(len(self.labels) * self.grid.bins)
        self._prior: _Leaves = every, np.zeros(len(every))

    def fit_with(self, maps: Mapping[str, OccupancyMap], scan: Scan) -> None:
        """Learn the measurement model, and how much a sequence of readings counts, given the maps."""
        super().fit_with(maps, scan)
        self.trust = learn_trust(self.likelihood, scan)

    def _reset(self, rng: np.random.Generator) -> None:
        self._coarse.reset()
        self._halved: list[_Halved] = []
        self._leaves = [self._prior]

    def _update(self) -> None:
        """Update the coarse bins (eq. 13), then split the best."""
        bins, _ = self._coarse.update()
        self._evaluated += bins
        before, self._halved, self._leaves = self._halved, [], []
        weight = self.trust(len(self.field))
        cell, log_p = self._coarse.best(self.options.cells, _NEGLIGIBLE / weight)
        for times in range(self.options.halvings):
            if times >= _AT_LEAST and len(log_p) and Weights(weight * log_p).ess > _ENOUGH:
                break
            chosen = _highest(log_p, self.options.cells)
            rest = np.ones(len(cell), dtype=bool)
            rest[chosen] = False
            self._leaves.append((cell[rest], log_p[rest]))
            halved = self._halve(times, np.sort(cell[chosen]), before[times] if times < len(before) else None)
            self._halved.append(halved)
            cell, log_p = halved.half.ravel(), halved.log_p.ravel()
        self._leaves.append((cell, log_p))

    def _estimate(self) -> Estimate:
        """Sum the belief of each letter (eq. 14); average the placement around the best letter's mode."""
        cells, weights = self._belief_in_cells()
        letter, log_weight = cells.letter, weights.log
        mass = letter_mass(letter, weights, len(self.labels))
        best = int(mass.argmax())
        mine = np.flatnonzero(letter == best)
        mine = mine[log_weight[mine] > log_weight[mine].max() - _NEGLIGIBLE_IN_MEAN]
        log_p = log_weight[mine] + math.log(8) * cells.times[mine]
        cells, weights = cells[mine], Weights(log_weight[mine])
        state = cells.states()
        return Estimate(
            label=self.labels[best],
            probabilities=probabilities(self.labels, mass),
            robot_in_object=mean_around(state, weights, int(log_p.argmax())),
            samples=pose_samples(state, weights, cells.size),
        )

    def certificate(self) -> Certificate:
        """Give the best of all coarse bins of all letters; none is left alone."""
        return self._coarse.certificate()

    def weighted_states(self) -> WeightedStates:
        """Give the middles of the cells, large and small, that hold the belief."""
        cells, weights = self._belief_in_cells()
        return WeightedStates(cells.letter, cells.states(), weights, cells.size)

    def log_evidence(self) -> FloatArray:
        """Sum what the cells of each letter hold; the prior of a letter's bins is 1 in all."""
        cells, weights = self._belief_in_cells()
        mass = letter_mass(cells.letter, weights, len(self.labels))
        with np.errstate(divide="ignore"):
            return np.log(mass) + weights.log.max() + self._highest - math.log(self.grid.bins)

    def belief_over_plane(self) -> PlaneBelief:
        """Sum the belief of each coarse bin and over the angle."""
        cells, weights = self._belief_in_cells()
        _, row, column = cells.bins()
        shape = len(self.labels), self.grid.y, self.grid.x
        place = np.ravel_multi_index((cells.letter, row, column), shape)
        probability = np.bincount(place, weights.relative, minlength=math.prod(shape)).reshape(shape)
        x, y, _ = self.grid.centres
        return PlaneBelief(self.labels, x, y, probability / probability.sum())

    @property
    def work(self) -> dict[str, Any]:
        """Count evaluations, a bin or cell in a reading each, made and skipped since the estimator was made."""
        return {"likelihood_evaluations": self._evaluated, "skipped": {"replays": self._unreplayed}}

    def _halve(self, times: int, cell: NDArray[np.int64], before: _Halved | None) -> _Halved:
        """Evaluate the halves of cells (n,), themselves halved `times` before, over the whole history."""
        halved = _Halved(cell, np.empty((len(cell), 8), dtype=np.int64), np.empty((len(cell), 8)))
        new, last = np.arange(len(cell)), len(self.field) - 1
        if before is not None and len(before.cell) and self.options.skip:
            # What was halved at the last reading too needs only the new one.
            place = np.minimum(np.searchsorted(before.cell, cell), len(before.cell) - 1)
            known = before.cell[place] == cell
            new, old = np.flatnonzero(~known), np.flatnonzero(known)
            halved.log_p[old] = before.log_p[place[old]] + self._replay(times, halved, old, last)
            self._unreplayed += 8 * len(old) * last
        halved.log_p[new] = self._replay(times, halved, new, 0)
        return halved

    def _replay(self, times: int, halved: _Halved, which: NDArray[np.intp], first: int) -> FloatArray:
        """Find the halves of n cells, and sum log p of the readings from `first` on: (n, 8)."""
        state, letter = np.empty((3, 8 * len(which))), np.empty(8 * len(which), dtype=np.int64)
        halve(halved.half, state, letter, halved.cell, which, self._counts << times, self._size / 2**times)
        self._evaluated += len(letter) * (len(self.field) - first)
        return self.field.log_p(letter, state, first).reshape(-1, 8)

    def _belief_in_cells(self) -> tuple[Cells, Weights]:
        """Give the cells that were not split and are not negligible, and what they hold."""
        volume, trust = -math.log(8) * np.arange(len(self._leaves)), self.trust(len(self.field))
        tops = [trust * log_p.max(initial=-math.inf) for _, log_p in self._leaves]
        highest = self._highest = float((volume + tops).max())
        times, index, log_weight = [], [], []
        for depth, (cell, log_p) in enumerate(self._leaves):
            held = trust * log_p + (volume[depth] - highest)
            heavy = np.flatnonzero(held > -_NEGLIGIBLE)
            times.append(np.full(len(heavy), depth))
            index.append(cell[heavy])
            log_weight.append(held[heavy])
        cells = Cells(self.grid, np.concatenate(times), np.concatenate(index))
        return cells, Weights(np.concatenate(log_weight))


class ForceMosaicOptions(RefinedOptions):
    """Options of the coarse-to-fine filter, with pressures instead of classes unless said otherwise."""

    likelihood: str = Field("force", description="the measurement model: paper, calibrated, force, graded")


class ForceMosaicFilter(RefinedFilter):
    """The coarse-to-fine filter with a measurement model that predicts pressures instead of classes."""

    options_type: type[Options] = ForceMosaicOptions


class GradedOptions(RefinedOptions):
    """Options of the coarse-to-fine filter, with grades of the reading's own pressure unless said otherwise."""

    likelihood: str = Field("graded", description="the measurement model: paper, calibrated, force, graded")
    threshold: Annotated[float, Field(ge=-1e9, le=1e9)] | Literal["auto"] = Field(
        "auto", description="T of eq. 3, kPa; auto: 1/18 of the training readings' median scale"
    )


class GradedFilter(RefinedFilter):
    """The coarse-to-fine filter with a measurement model that does not mind the load and the response curve."""

    options_type: type[Options] = GradedOptions


def _highest(values: FloatArray, count: int) -> NDArray[np.intp]:
    """Give the indices of the `count` highest values (n,), or of all if there are fewer.

    Values that are equal are all among them, or none is: of letters that look alike none may be preferred.
    So there may be fewer than `count`.
    """
    if count >= len(values):
        return np.arange(len(values))
    next_one = len(values) - count - 1
    return np.flatnonzero(values > np.partition(values, next_one)[next_one])
