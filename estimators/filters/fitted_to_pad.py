"""A filter that works in the lengths and pressures of the paper's pad, whatever pad the readings come from."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from tactsim.core import Scan
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import Estimate, PlaneBelief, PoseSamples, check_candidates
from tactsim.estimators.filters.active_touch import ActiveTouch
from tactsim.estimators.filters.map_filter import MapFilter
from tactsim.estimators.filters.wrapper import Wrapper
from tactsim.estimators.likelihoods.occupancy import OccupancyMap
from tactsim.estimators.options import FilterOptions
from tactsim.estimators.pad_fit import PadFit, fit_to_pad, is_wanted


class FittedToPad(Wrapper):
    """A filter and all around it, fitted to a scan's pad if its options ask for that; else everything is passed on.

    What goes in and comes out is in mm and in the scan's unit. What is reached through the wrapper, but for
    `maps`, is the filter's own. options: as they were asked for. pad_fit: what was found; None if
    nothing was asked for.
    """

    pad_fit: PadFit | None = None

    def __init__(
        self, kind: type[MapFilter], options: FilterOptions, surround: Callable[[MapFilter], ActiveTouch]
    ) -> None:
        super().__init__(surround(kind(options)))
        self._kind, self._surround = kind, surround

    def fit(self, scan: Scan) -> None:
        """Find units and options by the training readings, and learn from these. Raises InputError as the filter."""
        self.pad_fit = None
        if not is_wanted(self.options, scan):
            self.filter.fit(scan)
            return
        found = fit_to_pad(scan, self.options)
        self.filter = self._surround(self._kind(found.inner(self.options)))
        self.filter.fit(found.units.scan(scan))
        self.pad_fit = found

    def without(self, letter: str, scan: Scan) -> FittedToPad:
        """Wrap the filter without the letter; what is fitted to the pad is fitted anew, for it saw the letter."""
        if self.pad_fit is None:
            return super().without(letter, scan)  # type: ignore[return-value]
        other = copy.copy(self)
        other.fit(scan.untrained([letter]))
        return other

    def update(self, reading: ArrayLike, sensor_in_robot: ArrayLike) -> None:
        """Take in one reading (taxels,) in the scan's unit at the pose sensor_in_robot [mm, mm, rad]."""
        if self.pad_fit is None:
            self.filter.update(reading, sensor_in_robot)
            return
        units, pose = self.pad_fit.units, np.array(sensor_in_robot, dtype=float)
        values = units.readings(np.array(reading, dtype=float))
        self.filter.update(values, units.poses(pose) if pose.shape == (3,) else pose)

    def estimate(self) -> Estimate:
        """Say which letter it is and where, mm and rad."""
        known = self.filter.estimate()
        if self.pad_fit is None:
            return known
        back, samples = self.pad_fit.units.poses_back, known.samples
        return replace(
            known,
            robot_in_object=back(known.robot_in_object),
            samples=None if samples is None else PoseSamples(back(samples.poses), samples.weights),
        )

    def propose(self, candidates: Sequence[FloatArray] | FloatArray) -> int:
        """Choose the index of the sensor_in_robot pose (n, 3) whose reading should say most about the state."""
        if self.pad_fit is not None:
            candidates = self.pad_fit.units.poses(check_candidates(candidates))
        return self.filter.propose(candidates)

    def belief_over_plane(self) -> PlaneBelief | None:
        """Show how the filter's belief lies over the plane, mm."""
        belief = self.filter.belief_over_plane()
        if belief is None or self.pad_fit is None:
            return belief
        length = self.pad_fit.units.length
        return replace(belief, x=belief.x * length, y=belief.y * length)

    @property
    def maps(self) -> Mapping[str, OccupancyMap]:
        """Give the maps that were learned, in mm."""
        known: Mapping[str, OccupancyMap] = self.filter.maps
        if self.pad_fit is None:
            return known
        length = self.pad_fit.units.length
        return {
            label: replace(chart, origin=chart.origin * length, cell=chart.cell * length)
            for label, chart in known.items()
        }

    def describe(self) -> str:
        """Say in one line how the filter is set up, and to what it was fitted."""
        said = self.filter.describe()
        return said if self.pad_fit is None else f"{said}; {self.pad_fit.describe()}"
