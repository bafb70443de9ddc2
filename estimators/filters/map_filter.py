"""What all filters over (letter, T_R^O) share: learning the maps, and the order of the calls."""

from __future__ import annotations

import copy
from abc import abstractmethod
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from tactsim.core import Scan, memory
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import Estimate, Estimator, Options, check_order, check_reading
from tactsim.estimators.field.field import LikelihoodField
from tactsim.estimators.filters.doubts import Doubts
from tactsim.estimators.filters.states import WeightedStates
from tactsim.estimators.filters.trust import Trust, images_count
from tactsim.estimators.likelihoods import likelihood
from tactsim.estimators.likelihoods.calibrated import CalibratedLikelihood
from tactsim.estimators.likelihoods.likelihood import Likelihood
from tactsim.estimators.likelihoods.occupancy import OccupancyMap, learn_maps
from tactsim.estimators.likelihoods.sequence import SequenceLikelihood
from tactsim.estimators.options import FilterOptions, reach_of

# Bytes that a filter holds for a bin of a letter and for a particle: logs, indices, and room to list and sum them.
_OF_A_BIN, _OF_A_PARTICLE = 64, 200


class MapFilter(Estimator):
    """A filter on learned maps. A subclass implements `_fit`, `_reset`, `_update` and `_estimate`.

    labels: the letters, in the order of the scan. maps: the occupancy map of each. taxel_xy: (taxels, 2)
    mm. reach: mm, of x and y of T_R^O. likelihood: the measurement model. field: the log-likelihood of the
    readings so far, which has a new reading before `_update` is called.
    """

    options_type: type[Options] = FilterOptions
    options: FilterOptions
    # Whether the filter's own belief follows `options.motion`; a `Moving` is put around one that does not.
    moves = False
    # By what power the likelihood of so many readings counts in the belief; learned by some filters.
    trust = Trust()
    taxel_xy: FloatArray
    reach: float
    field: LikelihoodField

    def __init__(self, options: FilterOptions) -> None:
        super().__init__(options)
        self.likelihood: Likelihood = likelihood.create(options)
        self.takes_sequences = options.moments > 1
        self.labels: tuple[str, ...] = ()
        self.maps: Mapping[str, OccupancyMap] = {}
        self._started = False

    def fit(self, scan: Scan) -> None:
        """Learn the maps (eq. 2 to 6) and the measurement model from the training readings."""
        self._check_memory(len(scan.where("train").letters))
        chosen = self.options
        maps = learn_maps(
            scan, sigma=chosen.sigma, peak=chosen.peak, prior=chosen.prior, threshold=chosen.threshold,
            ratio=chosen.ratio, cell=chosen.cell,
        )  # fmt: skip
        self.fit_with(maps, scan)

    def without(self, letter: str, scan: Scan) -> MapFilter:
        """Give a filter of the other letters, with the maps that are known and a measurement model of their own."""
        other = copy.copy(self)
        other.likelihood = likelihood.create(self.options)
        maps = {label: chart for label, chart in self.maps.items() if label != letter}
        other.fit_with(maps, scan.untrained([letter]))
        return other

    def fit_with(self, maps: Mapping[str, OccupancyMap], scan: Scan) -> None:
        """Learn the measurement model from the training readings, given the maps of all letters in the scan."""
        self._started = False
        self.maps = maps
        self.labels = tuple(self.maps)
        self.taxel_xy = scan.taxel_xy
        self._reach_to(reach_of(self.options.reach, scan.taxel_xy))
        self.likelihood.fit(scan, self.maps)
        if isinstance(self.likelihood, SequenceLikelihood):
            self.likelihood.counts = images_count(self.likelihood, scan)
        self._learn(scan)
        self.field = LikelihoodField(
            self.likelihood, self.labels, self.taxel_xy, self._spacing, self.options.cell
        )
        self._fit()

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the sequence: every state of every letter is equally probable again."""
        check_order(bool(self.maps), "fit", "reset")
        self.field.reset()
        self._reset(rng)
        self._started = True

    def update(self, reading: ArrayLike, sensor_in_robot: ArrayLike) -> None:
        """Take in one reading (taxels,) kPa at the pose sensor_in_robot [mm, mm, rad].

        Raises InputError, and leaves the belief as it was, for a wrong length or a NaN.
        """
        self.take(reading, sensor_in_robot)
        self._update()

    def take(self, reading: ArrayLike, sensor_in_robot: ArrayLike) -> None:
        """Add a reading to `field` and leave the belief alone, for a wrapper that has a belief of its own.

        Raises InputError, and adds nothing, for a wrong length or a NaN.
        """
        self._check_started("update")
        values, pose = check_reading(reading, sensor_in_robot, len(self.taxel_xy), self.takes_sequences)
        self.field.append(self.likelihood.evidence(values), pose)

    def estimate(self) -> Estimate:
        """Give the letter's probabilities, and the pose T_R^O of the most probable letter."""
        self._check_started("estimate")
        return self._estimate()

    @abstractmethod
    def weighted_states(self) -> WeightedStates:
        """Give the belief as weighted states of all letters; those that are negligible may be left out."""

    def path(self, estimate: Estimate) -> FloatArray:
        """Give robot_in_object at each touch so far (n, 3), given an estimate: of an object that lies still."""
        return np.tile(estimate.robot_in_object, (len(self.field), 1))

    def log_evidence(self) -> FloatArray:
        """Give log p(readings so far | letter) if the object lies still, (letters,), up to what no model changes."""
        raise NotImplementedError(f"{type(self).__name__} is not compared with a moving belief")

    def information_on_none(self, doubts: Doubts, candidates: FloatArray) -> FloatArray | None:
        """Say what readings at candidates (n, 3) would tell of "none of these" (n,); None if it is not considered."""
        return None

    @property
    def calibrated(self) -> CalibratedLikelihood | None:
        """Give the calibrated model of the training readings, if that is the filter's own."""
        return self.likelihood if isinstance(self.likelihood, CalibratedLikelihood) else None

    @property
    def _spacing(self) -> tuple[float, float]:
        """Give how far apart in x and y (mm) states lie that share a node's place; a map cell for any states."""
        return self.options.cell, self.options.cell

    def _reach_to(self, reach: float) -> None:
        """Let x and y of T_R^O be in [-reach, reach] mm."""
        self.reach = reach

    def _learn(self, scan: Scan) -> None:
        """Learn from the training readings what a filter needs beside the measurement model, given that."""

    @abstractmethod
    def _fit(self) -> None:
        """Build from `labels` and `field` what every sequence needs."""

    @abstractmethod
    def _reset(self, rng: np.random.Generator) -> None:
        """Begin a new sequence; `field` has no reading."""

    @abstractmethod
    def _update(self) -> None:
        """Update the belief with the last reading of `field`."""

    @abstractmethod
    def _estimate(self) -> Estimate:
        """Make the estimate."""

    def _check_memory(self, letters: int) -> None:
        """Raise InputError if the belief of so many letters would not fit in memory: before hours of work."""
        grid, particles = getattr(self, "grid", None), getattr(self.options, "particles", None)
        if grid is not None:
            what, count = f"{letters} letters with {grid.bins:,} bins each", letters * grid.bins * _OF_A_BIN
            memory.require(count, what, "choose fewer bins")
        elif particles is not None:
            memory.require(particles * _OF_A_PARTICLE, f"{particles:,} particles", "choose fewer particles")

    def _check_started(self, call: str) -> None:
        check_order(self._started, "reset" if self.maps else "fit", call)
