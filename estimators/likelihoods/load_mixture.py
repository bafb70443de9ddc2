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

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core import Scan
from tactsim.core.poses import FloatArray
from tactsim.estimators.likelihoods.folds import load_levels
from tactsim.estimators.likelihoods.likelihood import Evidence, Likelihood, create
from tactsim.estimators.likelihoods.occupancy import OccupancyMap, learn_maps
from tactsim.estimators.options import LikelihoodOptions


def loads_of(train: Scan) -> NDArray[np.intp]:
    """Tell the loads of training readings apart: (n,), from 0, the lightest; all 0 if they are of one load.

    They are the shares of its press's load at which each was taken, or without those what was felt at a pose beside the
    most that was felt there.
    """
    shares = train.moments
    if shares is None:
        found = np.zeros(len(train), dtype=np.intp)
        for label in train.letters:
            mine = train.labels == label
            found[mine] = load_levels(train.poses[mine], train.readings[mine])
    return np.unique(found if shares is None else np.round(shares, 6), return_inverse=True)[1].reshape(-1)


class LoadMixture(Likelihood):
    """The mean of the likelihoods of all loads that were trained.

    of_load: the measurement model of each load, the lightest first.
    """

    def __init__(self, options: LikelihoodOptions, load: NDArray[np.intp]) -> None:
        """Take options, and the load of each training reading (n,), as `loads_of` numbers them."""
        super().__init__(options)
        self._load = load
        self.loads = int(load.max()) + 1
        self.of_load = [create(options) for _ in range(self.loads)]

    def fit(self, scan: Scan, maps: Mapping[str, OccupancyMap]) -> None:
        """Learn maps and measurement model of each load from its training readings.

        An object without readings at a load has all its readings there.
        """
        train, options = scan.where("train"), self.options
        self._chosen = []
        for number, model in enumerate(self.of_load):
            chosen = self._load == number
            for label in set(train.letters) - set(train.labels[chosen].tolist()):
                chosen |= train.labels == label
            self._chosen.append(chosen)
            own = train.chosen(chosen)
            charts = learn_maps(
                own, sigma=options.sigma, peak=options.peak, prior=options.prior, threshold=options.threshold,
                ratio=options.ratio, cell=options.cell,
            )  # fmt: skip
            model.fit(own, {label: charts[label] for label in maps})

    def without(
        self, train: Scan, gone: NDArray[np.bool_], labels: Sequence[str], whole_positions: bool
    ) -> LoadMixture | None:
        """Make a copy whose maps, at each load, were learned without some training readings."""
        rest = copy(self)
        rest.of_load = []
        for model, chosen in zip(self.of_load, self._chosen, strict=True):
            left = model.without(train.chosen(chosen), gone[chosen], labels, whole_positions)
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
        self._first = np.cumsum([0, *(len(of_load) for of_load in tables)])
        return np.concatenate(tables)

    def evidence(self, reading: FloatArray) -> Evidence:
        """Turn a reading into the terms of every load."""
        each = [model.evidence(reading) for model in self.of_load]
        return Evidence(
            np.concatenate([terms.table + self._first[load] for load, terms in enumerate(each)]),
            np.concatenate([terms.taxel for terms in each]),
            np.concatenate([terms.weight for terms in each]),
            np.repeat(np.arange(self.loads), [len(terms.table) for terms in each]),
        )
