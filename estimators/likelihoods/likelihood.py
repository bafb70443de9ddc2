"""Measurement models: what a reading says about the pose at which it was taken (paper, section III-A).

A model answers one question, `log_p`: how probable is this reading if the object is this letter, there? Any function
may. Most are sums over taxels: they give a few tables over the object's plane for each letter, and for each reading a
list of terms that says which table to look up at which taxel. Filters compute those a hundred times faster.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any, ClassVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core import Scan, compose, transform
from tactsim.core.plug_ins import Registry, fault_of_class
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import Options
from tactsim.estimators.likelihoods.classifier import UNKNOWN
from tactsim.estimators.likelihoods.folds import loads_of
from tactsim.estimators.likelihoods.occupancy import OccupancyMap
from tactsim.estimators.options import LikelihoodOptions, MapOptions


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
    """A measurement model. A subclass implements `log_p`, or `log_tables` and `evidence` as a `TaxelSum`.

    options_type: its options, which a filter with this model has beside its own. of_pressures: whether it predicts
    pressures, so that the response curve matters to it. of_classes: whether the threshold and the ratio of eq. 3 do.
    loads_of_images: whether windows of one image tell their load together (`folds.loads_of`).
    maps: by letter, as `fit` was given them. taxel_xy: (taxels, 2) mm.
    """

    options_type: ClassVar[type[MapOptions]] = MapOptions
    of_pressures: ClassVar[bool] = False
    of_classes: ClassVar[bool] = True
    loads_of_images: ClassVar[bool] = False
    maps: Mapping[str, OccupancyMap]
    taxel_xy: FloatArray
    # Under how many loads a reading may have been taken: `load_mixture.LoadMixture` has several.
    loads: int = 1
    # At how many poses `trust` asks for a reading that was left out: the fewer, the longer an answer takes.
    moves: int = 1024

    def __init__(self, options: MapOptions) -> None:
        """Take options; those of `options_type` that are not among them have their defaults."""
        own = self.options_type.model_fields
        known = {name: value for name, value in options if name in own}
        self.options: Any = options if isinstance(options, self.options_type) else self.options_type(**known)

    def fit(self, scan: Scan, maps: Mapping[str, OccupancyMap]) -> None:
        """Learn from the maps and, where it needs more, from the scan's training readings."""
        self.maps, self.taxel_xy = maps, np.array(scan.taxel_xy, dtype=float)

    @abstractmethod
    def log_p(self, reading: FloatArray, pose: FloatArray, label: str, states: FloatArray) -> FloatArray:
        """Give log p(reading | the letter `label` in these states): (n,) nats, of any common constant.

        reading: (taxels,) kPa. pose: (3,) sensor_in_robot. states: (n, 3) robot_in_object T_R^O; mm, mm, rad. So the
        taxels lie at `transform(compose(states, pose), self.taxel_xy)` on the object, (n, taxels, 2) mm. -inf is
        impossible; NaN and inf are refused by who asks.
        """

    def most(self, reading: FloatArray) -> float:
        """Give an upper bound of `log_p` of a reading, nats; inf if none is known."""
        return float("inf")

    def without(
        self, train: Scan, gone: NDArray[np.bool_], labels: Sequence[str], whole_positions: bool
    ) -> Likelihood | None:
        """Make a copy, of some letters, whose maps were learned without some training readings.

        train: the n training readings that the likelihood was fitted to. gone: (n,) those to leave out.
        whole_positions: whether those are all presses at some positions, or some of each. What was learned of how
        readings deviate from maps stays. None if it cannot leave readings out, as one that learns more than maps must
        say itself how: each reading then counts in full, and regions are as narrow as `log_p` makes them.
        """
        if type(self).fit is not Likelihood.fit:
            return None
        from tactsim.estimators.likelihoods.occupancy import learn_maps_by

        rest = copy(self)
        rest.maps = learn_maps_by(self.options, train.chosen(~gone).of_letters(labels))
        return rest


class TaxelSum(Likelihood):
    """A measurement model that is a sum over taxels of weighted tables: log p = sum of weight * table(taxel's place).

    Filters look its tables up on a lattice, in compiled code, and skip what cannot matter (`field.TableField`). Between
    the nodes they interpolate log p, which comes to `log_p` as the lattice gets finer.
    """

    moves = 4096

    def log_p(self, reading: FloatArray, pose: FloatArray, label: str, states: FloatArray) -> FloatArray:
        """Sum the terms, term by term; the mean over loads counts where there are several."""
        tables = self.log_tables(label, transform(compose(states, pose), self.taxel_xy))
        terms = self.evidence(reading)
        each = tables[terms.table, :, terms.taxel] * terms.weight[:, None]
        if self.loads == 1:
            return np.asarray(each.sum(axis=0), dtype=float)
        assert terms.load is not None
        of_load = [each[terms.load == load].sum(axis=0) for load in range(self.loads)]
        return np.asarray(np.logaddexp.reduce(of_load) - np.log(self.loads), dtype=float)

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
    ) -> TaxelSum | None:
        """Make a copy without some training readings, see `Likelihood.without`."""
        return None


GROUP = "tactsim.likelihoods"
# name: (where its class is, what it is); nothing is imported before its name is asked for.
BUILT_IN: dict[str, tuple[str, str]] = {
    "paper": ("tactsim.estimators.likelihoods.paper:PaperLikelihood", "classes, by the paper's eq. 7"),
    "calibrated": (
        "tactsim.estimators.likelihoods.calibrated:CalibratedLikelihood",
        "classes, how often each comes counted over the training readings",
    ),
    "force": ("tactsim.estimators.likelihoods.force:ForceLikelihood", "pressures, from a mosaic of planes"),
    "graded": (
        "tactsim.estimators.likelihoods.graded:GradedLikelihood",
        "grades of the reading's own pressure, counted over the training readings",
    ),
    "stacked": (
        "tactsim.estimators.likelihoods.stacked:StackedLikelihood",
        "what force and graded say, added up",
    ),
}


def _fault(found: Any) -> str | None:
    return fault_of_class(found, Likelihood, "tactsim.estimators.Likelihood", Options)


_LIKELIHOODS = Registry("likelihood", GROUP, BUILT_IN, _fault)
names, listing = _LIKELIHOODS.names, _LIKELIHOODS.listing


def create(options: LikelihoodOptions, train: Scan | None = None) -> Likelihood:
    """Make the likelihood that the options name.

    train: the training readings that it will be fitted to, if a touch may have been made under any of their loads.
    Raises InputError if there is none of that name.
    """
    kind = kind_of(options.likelihood)
    if train is not None and issubclass(kind, TaxelSum):
        load = loads_of(train, kind.loads_of_images)
        if load.any():
            from tactsim.estimators.likelihoods.load_mixture import LoadMixture

            return LoadMixture(options, load)
    return kind(options)


def kind_of(name: str) -> type[Likelihood]:
    """Import the class of that name. Raises InputError if there is none, or it is no Likelihood."""
    return cast("type[Likelihood]", _LIKELIHOODS.load(name))
