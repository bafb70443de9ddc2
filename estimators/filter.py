"""What all filters over (letter, T_R^O) share: maps, likelihood, and the order of the calls."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from estimators import likelihood
from estimators.base import Estimate, Estimator, Options, check_order, check_reading
from estimators.likelihood import Evidence, Likelihood
from estimators.occupancy import OccupancyMap, learn_maps
from estimators.options import FilterOptions
from tactsim import Scan
from tactsim.poses import FloatArray


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
        self.prepare()

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the sequence: every state of every letter is equally probable again."""
        check_order(bool(self.maps), "fit", "reset")
        self.restart(rng)
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
