"""The stacked measurement model: what several models say of a touch, added up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core import Scan
from tactsim.core.poses import FloatArray
from tactsim.estimators.likelihoods.calibrated import CountedOptions
from tactsim.estimators.likelihoods.force import ForceLikelihood
from tactsim.estimators.likelihoods.graded import GradedLikelihood
from tactsim.estimators.likelihoods.likelihood import Evidence, TaxelSum
from tactsim.estimators.likelihoods.occupancy import OccupancyMap
from tactsim.estimators.options import MapOptions


class StackedLikelihood(TaxelSum):
    """log p(z | x) is the sum of what `force` and `graded` say (a logarithmic opinion pool: Genest and Zidek 1986).

    They err in different ways: one of pressures, which foretells best where poses and loads are as stated, and one of
    shares of the reading's own pressure, which minds neither the load nor a bent response. A state has to please both.
    Each counts as much as alone. How much the sum counts is learned of left-out readings, as for every model (`trust`).
    Weights of their own, learned by the log score of left-out touches, gained nothing in simulation, and lost on real
    pads, whose training presses are near copies of each other (docs/estimators.md).

    models: those that are added.
    """

    options_type = CountedOptions
    of_pressures: ClassVar[bool] = True
    moves = 2048
    loads_of_images: ClassVar[bool] = True

    def __init__(self, options: MapOptions) -> None:
        super().__init__(options)
        self.models: tuple[TaxelSum, ...] = (GradedLikelihood(options), ForceLikelihood(options))

    def fit(self, scan: Scan, maps: Mapping[str, OccupancyMap]) -> None:
        """Fit each model to the scan's training readings."""
        super().fit(scan, maps)
        for model in self.models:
            model.fit(scan, maps)
        anywhere = [model.log_tables(next(iter(maps)), np.zeros(2)) for model in self.models]
        self._first_table = np.cumsum([0, *map(len, anywhere)])

    def without(
        self, train: Scan, gone: NDArray[np.bool_], labels: Sequence[str], whole_positions: bool
    ) -> StackedLikelihood | None:
        """Make a copy whose models know nothing of some training readings; None if one of them cannot."""
        left = [model.without(train, gone, labels, whole_positions) for model in self.models]
        rest = copy(self)
        rest.models = tuple(model for model in left if model is not None)
        rest.maps = {label: self.maps[label] for label in labels}
        return rest if len(rest.models) == len(left) else None

    def log_tables(self, label: str, xy: ArrayLike) -> FloatArray:
        """Evaluate the tables of all models, one model's after the other's: (tables, ...)."""
        return np.concatenate([model.log_tables(label, xy) for model in self.models])

    def evidence(self, reading: FloatArray) -> Evidence:
        """Turn a reading into the terms of all models, taxel after taxel: those at one place are summed faster."""
        each = [model.evidence(reading) for model in self.models]
        taxel = np.concatenate([terms.taxel for terms in each])
        order = np.argsort(taxel, kind="stable")
        return Evidence(
            np.concatenate(
                [terms.table + first for terms, first in zip(each, self._first_table, strict=False)]
            )[order],
            taxel[order],
            np.concatenate([terms.weight for terms in each])[order],
        )
