"""The coarse-to-fine histogram filter: the best bins are halved again and again, all readings replayed."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tactsim.core import Scan
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import Estimate, Options, PlaneBelief, probabilities
from tactsim.estimators.field.table_field import TableField
from tactsim.estimators.filters.cells import (
    Cells,
    History,
    Limits,
    bins_of,
    blank_halved,
    heaviest,
    held,
    refine,
)
from tactsim.estimators.filters.coarse_bounds import CoarseBins
from tactsim.estimators.filters.map_filter import GridFilter
from tactsim.estimators.filters.placement import mean_around, placements
from tactsim.estimators.filters.states import WeightedStates, Weights, letter_mass, pose_samples
from tactsim.estimators.filters.trust import Misfit, Trust, learn_trust
from tactsim.estimators.filters.trust_kernels import influence
from tactsim.estimators.likelihoods.occupancy import OccupancyMap
from tactsim.estimators.options import MODELS, FilterOptions, OpenSetOptions

if TYPE_CHECKING:
    from tactsim.estimators.filters.binned import BinnedBelief
    from tactsim.estimators.filters.moving import MovingBelief
    from tactsim.estimators.filters.plain_bins import PlainBins

# Cells are halved so often in any case, and on until the smallest hold the belief in so many cells (effective sample
# size): then they are about as large as the belief is wide.
_AT_LEAST, _ENOUGH = 3, 64.0
# Cells this many nats below the heaviest are left out of sums; of means of poses, sooner.
_NEGLIGIBLE, _NEGLIGIBLE_IN_MEAN = 30.0, 20.0
# So many states of the belief, and readings, the last ones, say by how much readings disagree about the place.
_STATES, _READINGS = 32, 64
# Of more bins than the first, those of whole planes are summed, and the best, so many, hold the belief.
_MANY_BINS, _BEST_BINS = 1_000_000, 100_000


class RefinedOptions(OpenSetOptions):
    """Options of the coarse-to-fine histogram filter."""

    likelihood: str = Field("calibrated", description=MODELS)
    bins: int = Field(5_000, description="coarse bins per letter; Table I's counts split as printed")
    split: str | None = Field(
        None, description="coarse bins in x, y and angle such as 16x16x36, instead of bins"
    )
    cells: int = Field(100, ge=1, le=100_000, description="how many of the best cells are halved, each time")
    halvings: int = Field(
        6, ge=0, le=8, description="how many times cells are halved in x, y and angle, at most"
    )
    skip: bool = Field(
        True,
        description="leave coarse bins alone that cannot be among the best, and replay only the new reading in cells "
        "halved before; the answer is the same",
    )


class RefinedFilter(GridFilter):
    """Coarse bins, the best of which are split into smaller and smaller cells.

    After every reading the `cells` best of all coarse bins, whichever letter's, are halved in x, y and angle,
    the `cells` best of these halves likewise, and so on, `halvings` times. The whole history is replayed in
    each new cell. The bins are ranked, and not compared with a limit: the longer the sequence, the less likely
    is the middle of the bin that holds the truth beside the truth itself.

    The log-likelihood of the readings is weighted by what left-out training readings say of how far a posterior may be
    trusted, and by how much the readings themselves disagree (`trust`). Halving ends, after the third time, when the
    smallest cells are about as large as the belief is wide.

    Where the readings are explained worse, even by the best cell, than left-out training readings are, by u nats more
    than chance explains, letters are told apart only by differences that are large beside u: their probabilities are
    taken to the power 1 / (1 + u) (temperature scaling: Guo et al. 2017). Label and place do not change by it; where
    `minds_misfit`, the belief about the place is wider, too (`Misfit.dispersion`).

    Of more than a million bins, as large objects need whose place is unknown, the best 100,000 hold the belief.

    The belief is what the leaves hold: a cell's likelihood is that of its middle, times its volume. So a
    cell that was split is worth the mean of its parts.
    """

    options_type: type[Options] = RefinedOptions
    options: RefinedOptions
    mixes_loads = True
    minds_misfit = False
    trust: Trust
    _belief: tuple[Cells, Weights] | None  # once it was asked for

    def __init__(self, options: RefinedOptions) -> None:
        super().__init__(options, options.bins, options.split)
        self._bounds = self._left_alone = self._unreplayed = self._badly_explained = 0

    def _own_setup(self) -> str:
        """Say how the state space is split, in one line."""
        dx, dy, da = (gap / 2**self.options.halvings for gap in self.grid.spacing)
        return (
            f"{self.grid.describe()}; the {self.options.cells} best halved up to {self.options.halvings} times, "
            f"to {dx:.2g} mm x {dy:.2g} mm x {math.degrees(da):.2g} deg"
        )

    def _fit(self) -> None:
        many = len(self.labels) * self.grid.bins > _MANY_BINS and self.likelihood.loads == 1
        self._coarse: CoarseBins | BinnedBelief | PlainBins
        # The same, where it tells the best bin of each letter.
        self._by_letter: CoarseBins | PlainBins | None = None
        if isinstance(self.field, TableField) and not many:
            self._coarse = self._by_letter = CoarseBins(self.field, self.grid, skip=self.options.skip)
        else:
            from tactsim.estimators.filters.plain_bins import PlainBins, bins_on

            self._coarse = bins_on(self.field, self.grid, skip=self.options.skip)
            self._by_letter = self._coarse if isinstance(self._coarse, PlainBins) else None
        self._bins = bins_of(self.grid)
        self._limits = Limits(
            self.options.cells, _AT_LEAST, self.options.halvings, _ENOUGH, self.options.skip
        )
        self._before, self._halved = blank_halved(self._limits), blank_halved(self._limits)

    def fit_with(self, options: FilterOptions, maps: Mapping[str, OccupancyMap], scan: Scan) -> None:
        """Learn the measurement model, given the maps, and then how much a sequence of readings counts."""
        super().fit_with(options, maps, scan)
        self.trust = learn_trust(self.likelihood, scan)
        if self.options.halvings < _AT_LEAST:  # the middle of a coarse bin explains no reading well
            self.trust = replace(self.trust, misfit=Misfit())

    def _reset(self, rng: np.random.Generator) -> None:
        self._coarse.reset()
        self._halved.number[:] = 0
        every = len(self.labels) * self.grid.bins
        # Where the cells of each size end (sizes,); the cells that were not halved, and their log-beliefs, (n,) each.
        self._leaves = np.array([every]), np.arange(every), np.zeros(every)
        self._weight, self._unexplained, self._shares = self.trust(0), 0.0, np.ones(1)
        self._belief = None

    def measure(self) -> None:
        """Update the coarse bins (eq. 13), then split the best."""
        weight = self.trust(len(self.field))
        if self._by_letter is None:
            bins, left_alone = self._coarse.update(0.0, keep=max(_BEST_BINS, self.options.cells))
        else:
            bins, left_alone = self._coarse.update(_NEGLIGIBLE / weight, keep=self.options.cells)
        self._left_alone += left_alone
        self._bounds += bins + left_alone if self.options.skip else 0
        cell, log_p = self._coarse.listed
        self._before, self._halved = self._halved, self._before
        if isinstance(self.field, TableField):
            history = History(self.field.terms, self.field.tables.sampled, len(self.field))
            end, left, left_log_p, evaluated, unreplayed = refine(
                cell, log_p, self._limits, weight, history, self._bins, self._before, self._halved
            )
        else:
            from tactsim.estimators.filters.plain_bins import halve_best

            end, left, left_log_p, evaluated = halve_best(
                cell, log_p, self._limits, weight, self.field, self.grid
            )
            unreplayed = 0
        self._leaves, self._belief = (end, left, left_log_p), None
        self._weight = self.trust.given(len(self.field), self._influence(weight))
        missed = self.field.bound() - float(left_log_p.max())
        self._unexplained = self.trust.misfit.unexplained(len(self.field), missed)
        self._badly_explained += self._unexplained > 0 and self.moving is None
        # Of each letter's coarse bins, where letters are tempered.
        self._best = np.full(len(self.labels), -np.inf)
        if self._unexplained and self._by_letter is not None:
            self._best, more = self._by_letter.best_of_letters()
            bins, self._left_alone = bins + more, self._left_alone - more
        self._evaluated += bins + evaluated
        self._unreplayed += unreplayed

    def shares_of_walks(self) -> FloatArray | None:
        """Weigh rest and walks by how, and in which order, readings disagree about the place."""
        return self._shares

    def left_along(self, moving: MovingBelief) -> float:
        """Tell what share of what is not explained at rest is not along the path of a belief that moves either.

        Readings of a load, pad or object that was not trained disagree about the place, too, but are explained badly
        wherever the object is at each of them.
        """
        if not self._unexplained:
            return 0.0
        letter, poses = moving.likeliest_way()
        each = [self.field.log_p(letter, poses[k, :, None], k, k + 1).item() for k in range(len(poses))]
        left = self.trust.misfit.unexplained(len(poses), self.field.bound() - sum(each))
        return left / self._unexplained

    def own_estimate(self) -> Estimate:
        """Sum the belief of each letter (eq. 14); average the placement around the best letter's mode."""
        cells, weights = self._belief_in_cells()
        best, mass = self.likeliest(self._letter_mass(cells.letter, weights))
        if self.minds_misfit and self._unexplained:
            dispersion = self.trust.misfit.dispersion(len(self.field), self._unexplained)
            cells, weights = self._held(self._weight / dispersion)
        letter, log_weight = cells.letter, weights.log
        # Of the object's views, one that holds something.
        views = np.flatnonzero(self.same_object[best] & (np.bincount(letter, minlength=len(mass)) > 0))
        best = int(views[mass[views].argmax()])
        mine = np.flatnonzero(letter == best)
        mine = mine[log_weight[mine] > log_weight[mine].max() - _NEGLIGIBLE_IN_MEAN]
        # Only these cells are placed: at first there are many others.
        weights, some = Weights(log_weight[mine]), cells.some(mine)
        densest = int((weights.log + math.log(8) * some.times).argmax())
        return Estimate(
            label=self.labels[best],
            probabilities=probabilities(self.labels, mass),
            robot_in_object=mean_around(some.states, weights.relative, densest),
            samples=pose_samples(some.states, weights, some.size),
            unexplained=self._unexplained,
        )

    def own_states(self) -> WeightedStates:
        """Give the middles of the cells, large and small, that hold the belief."""
        return self._keep()()

    def _keep(self) -> Callable[[], WeightedStates]:
        cells, weights = self._belief_in_cells()
        return lambda: WeightedStates(cells.letter, cells.states, weights, cells.size)

    def _own_plane(self) -> PlaneBelief:
        """Sum the belief of each coarse bin and over the angle."""
        cells, weights = self._belief_in_cells()
        _, row, column = cells.bins()
        shape = len(self.labels), self.grid.y, self.grid.x
        place = np.ravel_multi_index((cells.letter, row, column), shape)
        mass = letter_mass(cells.letter, weights, len(self.labels))
        tempered = self._letter_mass(cells.letter, weights) / np.where(mass > 0, mass, 1)
        held = np.bincount(place, weights.relative, minlength=math.prod(shape))
        probability = held.reshape(shape) * tempered[:, None, None]
        x, y, _ = self.grid.centres
        return PlaneBelief(self.labels, x, y, probability / probability.sum())

    @property
    def work(self) -> dict[str, Any]:
        """Count evaluations, a bin or cell in a reading each, made and skipped since the estimator was made.

        bound_evaluations: of bins, made in order to skip bins. badly_explained: readings after which a sequence was
        explained worse than training readings are.
        """
        return {
            "likelihood_evaluations": self._evaluated,
            "bound_evaluations": self._bounds,
            "badly_explained": self._badly_explained,
            "skipped": {"bins": self._left_alone, "replays": self._unreplayed},
            **self._ignored(),
        }

    def _letter_mass(self, letter: NDArray[np.int64], weights: Weights) -> FloatArray:
        """Sum the belief of each letter (letters,), tempered as far as the readings are explained badly.

        Then letters count whose cells are all negligible, too: each by its best coarse bin. No letter has less than
        what is negligible: an exact 0 would say more than is known, and costs without limit where it is wrong.
        """
        mass = letter_mass(letter, weights, len(self.labels))
        if self._unexplained:
            end, _, log_p = self._leaves
            of_bins = self._weight * self._best - heaviest(end, log_p, self._weight)
            # A bin whose halves are negligible is no more than that, whatever its middle says.
            mass = np.where(mass > 0, mass, np.exp(np.minimum(of_bins, -_NEGLIGIBLE)))
        return np.maximum(mass ** (1 / (1 + self._unexplained)), math.exp(-_NEGLIGIBLE))

    def _influence(self, weight: float) -> float:
        """Find how far a reading moves the belief of a weight about the best letter's place, for `Trust.given`."""
        count, self._shares = len(self.field), np.ones(1)
        if count < 2 or not self.trust.corrected or not isinstance(self.field, TableField):
            return math.nan
        cells, weights = self._held(weight)
        best = int(letter_mass(cells.letter, weights, len(self.labels)).argmax())
        mine = np.flatnonzero(cells.letter == best)
        some = Weights(weights.log[mine]).spaced(_STATES, 0.5)
        states = cells.some(mine[some]).states
        log_p, place = self.field.each(best, states, max(0, count - _READINGS), count), placements(states)
        moved = influence(log_p, np.ones(len(some)), place)
        if self._watched and self.motion is not None and not math.isnan(moved):
            self._shares = self.motion.shares(count, place.T, log_p, self.trust.shown(count))
        return moved

    def _belief_in_cells(self) -> tuple[Cells, Weights]:
        """Give the cells that were not split and are not negligible, and what they hold."""
        if self._belief is None:
            self._belief = self._held(self._weight)
        return self._belief

    def _held(self, weight: float) -> tuple[Cells, Weights]:
        end, cell, log_p = self._leaves
        times, index, log_weight = held(end, cell, log_p, weight, _NEGLIGIBLE)
        return Cells(self.grid, times, index), Weights(log_weight)


class ForceMosaicOptions(RefinedOptions):
    """Options of the coarse-to-fine filter, with pressures instead of classes unless said otherwise."""

    likelihood: str = Field("force", description=MODELS)


class ForceMosaicFilter(RefinedFilter):
    """The coarse-to-fine filter with a measurement model that predicts pressures instead of classes."""

    options_type: type[Options] = ForceMosaicOptions


class GradedOptions(RefinedOptions):
    """Options of the coarse-to-fine filter, with grades of the reading's own pressure unless said otherwise."""

    likelihood: str = Field("graded", description=MODELS)
    threshold: Annotated[float, Field(ge=-1e9, le=1e9)] | Literal["auto"] = Field(
        "auto", description="T of eq. 3, kPa; auto: 1/18 of the training readings' median scale"
    )


class GradedFilter(RefinedFilter):
    """The coarse-to-fine filter with a measurement model that does not mind the load and the response curve."""

    options_type: type[Options] = GradedOptions
