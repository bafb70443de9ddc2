"""The measurement model of touches whose load nobody knows: maps of its own for each load that was trained, mixed.

A light press is another picture than a full one, not a fainter one: of a ring, say, one side touches first. Maps of all
loads together blur them. So the training readings are divided by their loads, each with maps and a measurement model of
its own, and a touch may have been made under any of them, one as likely as another:

    p(z | x) = 1/L sum over loads l of p_l(z | x).

Each touch has a load of its own. A training set of one load has one model, and this is not asked.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core import Scan
from tactsim.core.poses import FloatArray
from tactsim.estimators.likelihoods.likelihood import Evidence, TaxelSum, kind_of
from tactsim.estimators.likelihoods.occupancy import OccupancyMap, learn_maps_by
from tactsim.estimators.options import LikelihoodOptions


class LoadMixture(TaxelSum):
    """The mean of the likelihoods of all loads that were trained, each fitted to the readings of its load.

    of_load: the measurement model of each load, the lightest first. first_table: (loads + 1,) where each model's tables
    begin among all.
    """

    first_table: NDArray[np.int64]

    def __init__(self, options: LikelihoodOptions, load: NDArray[np.intp]) -> None:
        """Take options, and the load of each training reading (n,), as `loads_of` numbers them."""
        self._load, self.loads = load, int(load.max()) + 1
        super().__init__(options)
        kind = cast("type[TaxelSum]", kind_of(options.likelihood))
        self.of_load, self.moves = [kind(options) for _ in range(self.loads)], kind.moves

    def fit(self, scan: Scan, maps: Mapping[str, OccupancyMap]) -> None:
        """Learn maps and measurement model of each load from its training readings.

        An object without readings at a load has all its readings there.
        """
        super().fit(scan, maps)
        train = scan.where("train")
        kept = self._load == np.arange(self.loads)[:, None]
        for of_load in kept:
            for label in set(train.letters) - set(train.labels[of_load].tolist()):
                of_load |= train.labels == label
        scans = [train.chosen(of_load) for of_load in kept]
        charts = [learn_maps_by(self.options, of_load) for of_load in scans]
        self._kept, self._scans = kept, scans
        for model, scan, chart in zip(self.of_load, scans, charts, strict=True):
            model.fit(scan, {label: chart[label] for label in maps})
        anywhere = [model.log_tables(next(iter(maps)), np.zeros(2)) for model in self.of_load]
        self.first_table = np.cumsum([0, *map(len, anywhere)])

    def evidence(self, reading: FloatArray) -> Evidence:
        """Turn a reading into the terms of every load."""
        each = [model.evidence(reading) for model in self.of_load]
        return Evidence(
            np.concatenate([terms.table + self.first_table[load] for load, terms in enumerate(each)]),
            np.concatenate([terms.taxel for terms in each]),
            np.concatenate([terms.weight for terms in each]),
            np.repeat(np.arange(self.loads), [len(terms.table) for terms in each]),
        )

    def without(
        self, train: Scan, gone: NDArray[np.bool_], labels: Sequence[str], whole_positions: bool
    ) -> LoadMixture | None:
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
        return np.concatenate([model.log_tables(label, xy) for model in self.of_load])
