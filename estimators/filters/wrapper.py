"""What surrounds a filter and changes some of what it does: open set, active touch."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tactsim.core import Scan
from tactsim.estimators.estimator import Estimate, Estimator, PlaneBelief
from tactsim.estimators.filters.map_filter import MapFilter
from tactsim.estimators.options import FilterOptions


class Wrapper(Estimator):
    """A filter, or another wrapper of one, in `filter`, to which every call is passed on.

    A subclass changes what it is there for. What only the filter has, such as `maps` or `grid`, is reached
    through the wrapper.
    """

    options: FilterOptions

    def __init__(self, filter: MapFilter | Wrapper) -> None:
        super().__init__(filter.options)
        self.filter = filter
        self.options_type, self.budget, self.draws = filter.options_type, filter.budget, filter.draws
        self.takes_sequences = filter.takes_sequences

    def fit(self, scan: Scan) -> None:
        """Learn from the scan's training readings."""
        self.filter.fit(scan)

    def without(self, letter: str, scan: Scan) -> Wrapper:
        """Wrap the filter without the letter."""
        other = copy.copy(self)
        other.filter = self.filter.without(letter, scan)
        return other

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the sequence."""
        self.filter.reset(rng)

    def update(self, reading: ArrayLike, sensor_in_robot: ArrayLike) -> None:
        """Take in one reading (taxels,) kPa at the pose sensor_in_robot [mm, mm, rad]."""
        self.filter.update(reading, sensor_in_robot)

    def estimate(self) -> Estimate:
        """Say which letter it is and where."""
        return self.filter.estimate()

    def describe(self) -> str:
        """Say in one line how the filter is set up."""
        return self.filter.describe()

    def belief_over_plane(self) -> PlaneBelief | None:
        """Show how the filter's belief lies over the plane."""
        return self.filter.belief_over_plane()

    @property
    def work(self) -> dict[str, Any]:
        """Count what the filter has done."""
        return self.filter.work

    def __getattr__(self, name: str) -> Any:
        # Asked only for what the wrapper does not have; without `filter` it is being unpickled.
        if name.startswith("_") or name == "filter":
            raise AttributeError(f"{type(self).__name__} has no {name}")
        return getattr(self.filter, name)
