"""The histogram filter (paper, section III-C), which touches only the bins that can still matter."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pydantic import Field

from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import Estimate, Options, PlaneBelief, probabilities
from tactsim.estimators.filters.map_filter import GridFilter
from tactsim.estimators.filters.plain_bins import bins_on
from tactsim.estimators.filters.states import WeightedStates, Weights
from tactsim.estimators.options import FilterOptions

# Nats below the best bin from which a bin is left out of the belief about the pose: all of them hold next to nothing.
_IN_BELIEF = 20.0
# Bins that are left alone hold together at most this share of the belief.
_NEGLIGIBLE = 1e-8


class HistogramOptions(FilterOptions):
    """Options of the histogram filter."""

    bins: int = Field(10_000, description="n_H per letter; Table I's 100, 1000, 10000 split as printed")
    split: str | None = Field(None, description="bins in x, y and angle such as 16x16x36, instead of bins")
    skip: bool = Field(True, description="leave bins alone that cannot matter; the answer is the same")


class HistogramFilter(GridFilter):
    """Histogram filter over letter, x, y and angle (paper, eq. 13 to 16), in logs.

    Bins are grouped in planes, all bins of one letter and one angle. A plane has an upper bound of the log-belief of
    its bins. While that is so far below the best bin that all such planes together hold a negligible share of the
    belief, its bins wait (`binned`).
    """

    options_type: type[Options] = HistogramOptions
    options: HistogramOptions

    def __init__(self, options: HistogramOptions) -> None:
        super().__init__(options, options.bins, options.split)
        self._bounds = self._skipped = 0

    def _fit(self) -> None:
        self._belief = bins_on(self.field, self.grid, skip=self.options.skip)
        every = len(self.labels) * self.grid.bins
        self._margin = math.log(every / _NEGLIGIBLE) if self.options.skip else math.inf

    def _reset(self, rng: np.random.Generator) -> None:
        self._belief.reset()

    def measure(self) -> None:
        """Multiply the belief by the likelihood of the last reading (eq. 13)."""
        bins, skipped = self._belief.update(self._margin)
        self._evaluated += bins
        self._bounds += len(self.labels) * self.grid.angle if self.options.skip else 0
        self._skipped += skipped

    def own_estimate(self) -> Estimate:
        """Sum the bins of each letter (eq. 14); take the mode (eq. 15, 16) within the best letter."""
        mass, mode = self._belief.summary()
        best, mass = self.likeliest(mass)
        place, column = divmod(int(mode[best]), self.grid.x)
        angle, row = divmod(place, self.grid.y)
        x, y, theta = self.grid.centres
        return Estimate(
            label=self.labels[best],
            probabilities=probabilities(self.labels, mass),
            robot_in_object=np.array([x[column], y[row], theta[angle]]),
            samples=self._belief.samples(best, _IN_BELIEF),
        )

    def log_belief(self) -> FloatArray:
        """Give the log-belief of all bins: (letters, angles, rows, columns), not normalised.

        Bins that were left alone, because they cannot matter, have -inf.
        """
        return self._belief.log_belief()

    def own_states(self) -> WeightedStates:
        """Give the bins that were not left alone, as their middles."""
        log_p = self.log_belief()
        letter, angle, row, column = np.nonzero(log_p > -np.inf)
        x, y, theta = self.grid.centres
        return WeightedStates(
            letter=letter,
            state=np.stack([x[column], y[row], theta[angle]]),
            weights=Weights(log_p[letter, angle, row, column]),
            size=np.broadcast_to(np.array(self.grid.spacing)[:, None], (3, len(letter))),
        )

    def _own_plane(self) -> PlaneBelief:
        """Sum the belief over the angle."""
        log_p = self.log_belief()
        probability = np.exp(log_p - log_p.max()).sum(axis=1)
        x, y, _ = self.grid.centres
        return PlaneBelief(self.labels, x, y, probability / probability.sum())

    @property
    def work(self) -> dict[str, Any]:
        """Count evaluations, a bin in a reading each, made and skipped since the estimator was made.

        bound_evaluations: of planes of bins, made in order to skip bins.
        """
        return {
            "likelihood_evaluations": self._evaluated,
            "bound_evaluations": self._bounds,
            "skipped": {"bins": self._skipped},
            **self._ignored(),
        }
