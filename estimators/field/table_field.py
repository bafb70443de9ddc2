"""The field of a model that is a sum over taxels: its tables, sampled once, and the terms of all readings."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core.poses import FloatArray
from tactsim.estimators.field.field import LikelihoodField
from tactsim.estimators.field.kernels import LANES, Lattice, Named, Ranges, Terms, record, replay
from tactsim.estimators.field.tables import tabulate
from tactsim.estimators.likelihoods.likelihood import Evidence, TaxelSum


class TableField(LikelihoodField):
    """The fast lane: tables on a lattice, and the terms of all readings, for compiled code.

    tables: on the lattice. terms: of all readings.
    """

    def __init__(
        self,
        likelihood: TaxelSum,
        labels: Sequence[str],
        taxel_xy: FloatArray,
        spacing: tuple[float, float],
        finest: float,
    ) -> None:
        """Sample the tables for states `spacing` mm apart in x and y, with nodes at most `finest` mm apart.

        Raises ValueError if a table's value is not finite, InputError if there would be too many nodes.
        """
        super().__init__(labels)
        self._likelihood, self.taxel_xy = likelihood, np.array(taxel_xy, dtype=float)
        self.tables = tabulate(likelihood, labels, spacing, finest)
        self.terms = Terms(
            loads=likelihood.loads,
            start=np.zeros(64 * likelihood.loads + 1, dtype=np.int64),
            kind=np.zeros(4096, dtype=np.int64),
            xy=np.zeros((4096, 2)),
            weight=np.zeros(4096, dtype=np.float32),
            constant=np.zeros((64 * likelihood.loads, len(labels))),
            upper=np.zeros(65),
            slack=np.zeros(64),
        )
        self._ranges = Ranges(self.tables.outside, self.tables.lowest, self.tables.highest)
        self.reset()

    @cached_property
    def alike(self) -> NDArray[np.int64]:
        """Give for each letter (letters,) the number of the first whose tables are equal to its own, bit by bit.

        Such letters are one hypothesis: no reading can tell them apart.
        """
        first: dict[bytes, int] = {}
        nodes, outside = self.tables.nodes, self.tables.outside
        digests = [
            hashlib.sha256(nodes[:, letter].tobytes() + outside[:, letter].tobytes()).digest()
            for letter in range(len(self.labels))
        ]
        return np.array([first.setdefault(digest, letter) for letter, digest in enumerate(digests)])

    def append(self, reading: FloatArray, sensor_in_robot: FloatArray) -> None:
        """Add a reading (taxels,) kPa, taken at a pose [mm, mm, rad]."""
        self.add(self._likelihood.evidence(reading), sensor_in_robot)

    def add(self, evidence: Evidence, sensor_in_robot: FloatArray) -> None:
        """Add the terms of a reading taken at a pose [mm, mm, rad].

        Raises ValueError, and adds nothing, if the likelihood named a table or taxel that does not exist,
        or gave a weight that is negative or not finite.
        """
        if self._readings == len(self.terms.slack):
            self.terms = _with_room(self.terms, ("start", "constant", "upper", "slack"))
        filled = self.terms.start[self._readings * self.terms.loads]
        while filled + len(evidence.table) > len(self.terms.kind):
            self.terms = _with_room(self.terms, ("kind", "xy", "weight"))
        ends = np.full(self.terms.loads, len(evidence.table))
        if evidence.load is not None:
            ends = np.searchsorted(evidence.load, np.arange(self.terms.loads), side="right")
        named = Named(evidence.table, evidence.taxel, evidence.weight, ends)
        if not record(self.terms, self._readings, named, self.taxel_xy, sensor_in_robot, self._ranges):
            evidence.check(len(self.tables.highest), len(self.taxel_xy))
        self._readings += 1

    def log_p(
        self, letter: ArrayLike, state: FloatArray, first: int = 0, last: int | None = None
    ) -> FloatArray:
        """Sum log p(z | letter, state) over some readings, see `LikelihoodField.log_p`."""
        count = state.shape[1]
        letters = np.full(count, letter, dtype=np.int64)
        log_p = np.zeros(count)
        replay(
            log_p, np.ascontiguousarray(state), letters, self.terms, first,
            self._readings if last is None else last, self.tables.sampled,
        )  # fmt: skip
        return log_p

    def bound(self, first: int = 0) -> float:
        """Give an upper bound of log p of readings first and later, nats, for any letter and state."""
        return float(self.terms.upper[self._readings] - self.terms.upper[first])

    def lattice(self, first: FloatArray, spacing: FloatArray) -> Lattice:
        """Lay out the tables for the planes of a grid of bins.

        first: [x, y] mm of the first bin's middle. spacing: of the bins in x and y, mm, as the field was made for.
        """
        tables, (phases_y, phases_x) = self.tables, self.tables.phases
        kinds, letters, rows, columns = tables.nodes.shape
        shape = kinds, letters, phases_y, phases_x, rows // phases_y, columns // phases_x
        split = tables.nodes.reshape(kinds, letters, shape[4], phases_y, shape[5], phases_x)
        flat = np.zeros(math.prod(shape[:5]) * (shape[5] + LANES) + LANES, dtype=np.int16)
        flat[:-LANES].reshape(*shape[:5], -1)[..., LANES:] = split.transpose(0, 1, 3, 5, 2, 4)
        place = np.concatenate([first - tables.origin, spacing])
        return Lattice(flat, tables.unit, np.array(shape), place)


def _with_room(terms: Terms, names: Sequence[str]) -> Terms:
    """Make arrays twice as long."""
    longer: dict[str, Any] = {
        name: np.concatenate([(old := getattr(terms, name)), np.zeros_like(old)]) for name in names
    }
    return terms._replace(**longer)
