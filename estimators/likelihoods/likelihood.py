"""Measurement models: what a reading says about the pose at which it was taken (paper, section III-A).

Every filter takes its likelihood from here, and every likelihood comes down to the same thing: a
few tables over the object's plane for each letter, and for each reading a list of terms that says
which table to look up at which taxel. The log-likelihood of a state is the sum of its terms.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core import Scan
from tactsim.core.errors import unknown
from tactsim.core.poses import FloatArray
from tactsim.estimators.likelihoods.classifier import UNKNOWN
from tactsim.estimators.likelihoods.occupancy import OccupancyMap
from tactsim.estimators.options import LikelihoodOptions


@dataclass(frozen=True, eq=False)
class Evidence:
    """One reading as terms: log p(z | x) = sum of weight * table value at the taxel, over the terms.

    table, taxel: (terms,) indices. weight: (terms,) factor of the table's value, not negative; 1 for a class. load:
    (terms,) of which of the likelihood's loads each is, rising; None if it has one. p(z | x) is the loads' mean.
    """

    table: NDArray[np.int64]
    taxel: NDArray[np.int64]
    weight: NDArray[np.float32]
    load: NDArray[np.int64] | None = None

    @classmethod
    def of_classes(cls, classes: NDArray[np.int8], with_unknown: bool) -> Evidence:
        """Make a term of weight 1 of each taxel's class, as from `classify`: the number of its table.

        with_unknown: whether Unknown taxels are terms too.
        """
        taxel = np.arange(len(classes)) if with_unknown else np.flatnonzero(classes != UNKNOWN)
        return cls(classes[taxel].astype(np.int64), taxel, np.ones(len(taxel), dtype=np.float32))

    def of_taxels(self, chosen: NDArray[np.bool_]) -> Evidence:
        """Keep the terms of chosen (taxels,) taxels."""
        kept = chosen[self.taxel]
        load = None if self.load is None else self.load[kept]
        return Evidence(self.table[kept], self.taxel[kept], self.weight[kept], load)

    def check(self, tables: int, taxels: int) -> None:
        """Raise ValueError if a term names a table or taxel beyond these counts, or has an odd weight."""
        for name, indices, count in (("table", self.table, tables), ("taxel", self.taxel, taxels)):
            if len(indices) and not 0 <= indices.min() <= indices.max() < count:
                raise ValueError(f"a likelihood named a {name} that does not exist, of {count}")
        if not ((self.weight >= 0) & (self.weight < np.inf)).all():
            raise ValueError("a likelihood gave a weight that is negative or not finite")


class Likelihood(ABC):
    """A measurement model. A subclass implements `fit`, `log_tables` and `evidence`.

    It is registered in `LIKELIHOODS`; `create` makes it by name. of_pressures: whether its tables are of pressures
    rather than of classes by eq. 3, so that the response curve matters to it, and threshold and ratio do not. maps: by
    letter, as `fit` was given them.
    """

    of_pressures: ClassVar[bool] = False
    maps: Mapping[str, OccupancyMap]
    # Under how many loads a reading may have been taken: `load_mixture.LoadMixture` has several.
    loads: int = 1

    def __init__(self, options: LikelihoodOptions) -> None:
        self.options = options

    @abstractmethod
    def fit(self, scan: Scan, maps: Mapping[str, OccupancyMap]) -> None:
        """Learn from the maps and, where it needs more, from the scan's training readings."""

    @property
    def extent(self) -> tuple[FloatArray, FloatArray]:
        """Give the lower left and upper right corner [x, y] mm beyond which tables are constant.

        Beyond the maps and a frame of cells at the prior around them every map interpolates to its prior alone.
        """
        charts = self.maps.values()
        low = np.min([chart.origin - chart.cell for chart in charts], axis=0)
        high = np.max(
            [chart.origin + chart.cell * np.array(chart.log_odds.shape[::-1]) for chart in charts], axis=0
        )
        return low, high

    @abstractmethod
    def log_tables(self, label: str, xy: ArrayLike) -> FloatArray:
        """Evaluate a letter's tables at points (..., 2) mm in the object frame: (tables, ...)."""

    @abstractmethod
    def evidence(self, reading: FloatArray) -> Evidence:
        """Turn a reading (taxels,) kPa into the terms that it contributes."""

    def without(
        self, train: Scan, gone: NDArray[np.bool_], labels: Sequence[str], whole_positions: bool
    ) -> Likelihood | None:
        """Make a copy, of some letters, whose maps were learned without some training readings.

        train: the n training readings that the likelihood was fitted to. gone: (n,) those to leave out.
        whole_positions: whether those are all presses at some positions, or some of each. What was learned of how
        readings deviate from maps stays. None if it cannot leave readings out.
        """
        return None


# name: the module here and its class; nothing is imported before its name is asked for.
LIKELIHOODS = {
    "paper": ("paper", "PaperLikelihood"),
    "calibrated": ("calibrated", "CalibratedLikelihood"),
    "force": ("force", "ForceLikelihood"),
    "graded": ("graded", "GradedLikelihood"),
    "stacked": ("stacked", "StackedLikelihood"),
}


def create(options: LikelihoodOptions, train: Scan | None = None) -> Likelihood:
    """Make the likelihood that the options name.

    train: the training readings that it will be fitted to, if a touch may have been made under any of their loads.
    Raises InputError if there is none of that name.
    """
    kind = kind_of(options.likelihood)
    if train is not None:
        from tactsim.estimators.likelihoods.load_mixture import LoadMixture, loads_of

        load = loads_of(train)
        if load.any():
            return LoadMixture(options, load)
    return kind(options)


def kind_of(name: str) -> type[Likelihood]:
    """Import the class of that name. Raises InputError if there is none."""
    if name not in LIKELIHOODS:
        raise unknown("likelihood", name, LIKELIHOODS)
    module, kind = LIKELIHOODS[name]
    found: type[Likelihood] = getattr(import_module(f"tactsim.estimators.likelihoods.{module}"), kind)
    return found
