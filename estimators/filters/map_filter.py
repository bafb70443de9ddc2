"""What all filters over (letter, T_R^O) share: maps, likelihood, and the order of the calls."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core import Scan
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import (
    Estimate,
    Estimator,
    Options,
    check_candidates,
    check_order,
    check_reading,
)
from tactsim.estimators.filters.information import STATES, Planner
from tactsim.estimators.likelihoods import likelihood
from tactsim.estimators.likelihoods.calibrated import CalibratedLikelihood
from tactsim.estimators.likelihoods.likelihood import Evidence, Likelihood
from tactsim.estimators.likelihoods.occupancy import OccupancyMap, learn_maps
from tactsim.estimators.options import FilterOptions


class MapFilter(Estimator):
    """A filter on learned maps. A subclass implements `prepare`, `restart`, `take` and `answer`.

    labels: the letters, in the order of the scan. maps: the occupancy map of each.
    """

    options_type: ClassVar[type[Options]] = FilterOptions
    options: FilterOptions

    def __init__(self, options: FilterOptions) -> None:
        super().__init__(options)
        self.likelihood: Likelihood = likelihood.create(options)
        self.labels: tuple[str, ...] = ()
        self.maps: Mapping[str, OccupancyMap] = {}
        self._planner: Planner | None = None
        self._started = False

    def fit(self, scan: Scan) -> None:
        """Learn the maps (eq. 2 to 6) and the measurement model from the training readings."""
        chosen = self.options
        self._started = False
        self.maps = learn_maps(
            scan, sigma=chosen.sigma, peak=chosen.peak, prior=chosen.prior, threshold=chosen.threshold,
            ratio=chosen.ratio, cell=chosen.cell,
        )  # fmt: skip
        self.labels = tuple(self.maps)
        self.taxel_xy = scan.taxel_xy
        self.likelihood.fit(scan, self.maps)
        self._train, self._planner = scan.where("train"), None
        self.prepare()

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the sequence: every state of every letter is equally probable again."""
        check_order(bool(self.maps), "fit", "reset")
        self.restart(rng)
        # A stream of its own: what is proposed does not depend on how, nor the estimates on whether.
        self._planning = rng.spawn(1)[0]
        self._started = True

    def update(self, reading: ArrayLike, sensor_in_robot: ArrayLike) -> None:
        """Take in one reading (taxels,) kPa at the pose sensor_in_robot [mm, mm, rad].

        Raises InputError, and leaves the belief as it was, for a wrong length or a NaN.
        """
        self._check_started("update")
        values, pose = check_reading(reading, sensor_in_robot, len(self.taxel_xy))
        self.take(self.likelihood.evidence(values), pose)

    def estimate(self) -> Estimate:
        """Give the letter's probabilities, and the mode of T_R^O within the most probable letter."""
        self._check_started("estimate")
        return self.answer()

    def propose(self, candidates: Sequence[FloatArray] | FloatArray) -> int:
        """Choose the index of the sensor_in_robot pose (n, 3) whose reading should say most about the state."""
        self._check_started("propose")
        poses = check_candidates(candidates)
        if self._planner is None:
            self._planner = Planner(self.calibrated(), self.taxel_xy)
        letter, state = self.draw_states(STATES, self._planning)
        return self._planner.choose(poses, letter, state, self._planning)

    def calibrated(self) -> CalibratedLikelihood:
        """Give the calibrated model of the same readings: the filter's own, or one learned for the purpose."""
        if isinstance(self.likelihood, CalibratedLikelihood):
            return self.likelihood
        model = CalibratedLikelihood(self.options)
        model.fit(self._train, self.maps)
        return model

    @abstractmethod
    def draw_states(self, count: int, rng: np.random.Generator) -> tuple[NDArray[np.int64], FloatArray]:
        """Draw states from the belief, equally probable: indices of letters (count,), T_R^O (3, count)."""

    @abstractmethod
    def prepare(self) -> None:
        """Build from `maps` and `likelihood` what every sequence needs."""

    @abstractmethod
    def restart(self, rng: np.random.Generator) -> None:
        """Begin a new sequence."""

    @abstractmethod
    def take(self, evidence: Evidence, sensor_in_robot: FloatArray) -> None:
        """Update with the terms of a reading taken at a pose [mm, mm, rad]."""

    @abstractmethod
    def answer(self) -> Estimate:
        """Make the estimate."""

    def _check_started(self, call: str) -> None:
        check_order(self._started, "reset" if self.maps else "fit", call)
