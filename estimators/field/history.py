"""The readings of a sequence, kept as terms so that a state can be caught up later."""

from __future__ import annotations

import numpy as np

from tactsim.core.poses import FloatArray
from tactsim.estimators.field.kernels import Terms, record
from tactsim.estimators.field.tables import Tables
from tactsim.estimators.likelihoods.likelihood import Evidence


class History:
    """The terms of all readings so far, in arrays that grow.

    terms.start: (readings + 1,) where each reading's terms begin. kind, xy, weight: (terms,) the
    terms' table, place in the robot frame (mm) and factor. constant: (readings, letters) what a state
    far off the map gets. ceiling: (readings + 1,) cumulated, the most that any state can get. slack:
    (readings,) by how much rounding may move a sum. Arrays may be longer than what is filled. most:
    terms of the longest reading.
    """

    def __init__(self, tables: Tables, taxel_xy: FloatArray) -> None:
        self._tables, self._taxel_xy = tables, np.array(taxel_xy, dtype=float)
        letters = tables.outside.shape[1]
        self.terms = Terms(
            start=np.zeros(65, dtype=np.int64),
            kind=np.zeros(4096, dtype=np.int64),
            xy=np.zeros((4096, 2)),
            weight=np.zeros(4096, dtype=np.float32),
            constant=np.zeros((64, letters)),
            ceiling=np.zeros(65),
            slack=np.zeros(64),
        )
        self.clear()

    def __len__(self) -> int:
        return self._readings

    def clear(self) -> None:
        """Forget all readings."""
        self._readings = self.most = 0

    def append(self, evidence: Evidence, sensor_in_robot: FloatArray) -> None:
        """Add the terms of a reading taken at a pose [mm, mm, rad].

        Raises ValueError if the likelihood named a table or taxel that does not exist, or gave a weight that
        is negative or not finite.
        """
        count, tables = len(evidence.table), self._tables
        self._make_room(count)
        if not record(
            self.terms, self._readings, evidence.table, evidence.taxel, evidence.weight, self._taxel_xy,
            sensor_in_robot, tables.outside, tables.lowest, tables.highest,
        ):  # fmt: skip
            evidence.check(len(tables.highest), len(self._taxel_xy))
        self._readings += 1
        self.most = max(self.most, count)

    def _make_room(self, count: int) -> None:
        terms = self.terms
        if self._readings == len(terms.slack):
            by_reading = ("start", "constant", "ceiling", "slack")
            terms = terms._replace(**{name: _doubled(getattr(terms, name)) for name in by_reading})
        while terms.start[self._readings] + count > len(terms.kind):
            by_term = ("kind", "xy", "weight")
            terms = terms._replace(**{name: _doubled(getattr(terms, name)) for name in by_term})
        self.terms = terms


def _doubled(array: np.ndarray) -> np.ndarray:
    return np.concatenate([array, np.zeros_like(array)])
