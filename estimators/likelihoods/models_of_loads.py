"""What measurement models that consist of one for each load have in common: maps, tables and left-out readings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core import Scan
from tactsim.core.poses import FloatArray
from tactsim.estimators.likelihoods.likelihood import Likelihood
from tactsim.estimators.likelihoods.occupancy import OccupancyMap
from tactsim.estimators.options import LikelihoodOptions


class ModelsOfLoads(Likelihood):
    """Measurement models side by side, each fitted to the training readings of its load, with tables of its own.

    of_load: the measurement model of each load, the lightest first. first_table: (loads + 1,) where each model's tables
    begin among all, once they were evaluated.
    """

    first_table: NDArray[np.int64]

    def __init__(self, options: LikelihoodOptions, of_load: list[Likelihood]) -> None:
        super().__init__(options)
        self.of_load = of_load

    def fit_each(
        self, kept: NDArray[np.bool_], scans: Sequence[Scan], maps: Sequence[Mapping[str, OccupancyMap]]
    ) -> None:
        """Fit the models to their scans and maps. kept: (loads, n) which of all training readings each scan has."""
        self._kept, self._scans = kept, tuple(scans)
        for model, scan, charts in zip(self.of_load, scans, maps, strict=True):
            model.fit(scan, charts)

    def without(
        self, train: Scan, gone: NDArray[np.bool_], labels: Sequence[str], whole_positions: bool
    ) -> ModelsOfLoads | None:
        """Make a copy whose maps, at each load, were learned without some training readings."""
        rest = copy(self)
        rest.of_load = []
        for kept, model, scan in zip(self._kept, self.of_load, self._scans, strict=True):
            left = model.without(scan, gone[kept], labels, whole_positions)
            if left is None:
                return None
            rest.of_load.append(left)
        return rest

    @property
    def extent(self) -> tuple[FloatArray, FloatArray]:
        """Give the corners of the maps of all loads."""
        low, high = zip(*(model.extent for model in self.of_load), strict=True)
        return np.min(low, axis=0), np.max(high, axis=0)

    def log_tables(self, label: str, xy: ArrayLike) -> FloatArray:
        """Evaluate the tables of all loads, the lightest's first: (tables, ...)."""
        tables = [model.log_tables(label, xy) for model in self.of_load]
        self.first_table = np.cumsum([0, *(len(of_load) for of_load in tables)])
        return np.concatenate(tables)
