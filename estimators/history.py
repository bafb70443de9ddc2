"""The readings of a sequence, kept as terms so that a state can be caught up later."""

from __future__ import annotations

import numpy as np

from estimators.likelihood import Evidence
from estimators.tables import Tables
from tactsim.poses import FloatArray

# Rounding of float32 sums, relative to the largest table value, that a ceiling must allow for.
_ROUNDING = 1e-6


class History:
    """The terms of all readings so far, in arrays that grow.

    start: (readings + 1,) where each reading's terms begin. kind, xy, weight: the terms' table,
    place in the robot frame (mm) and factor. constant: (readings, letters) what a state far off the
    map gets. ceiling: (readings + 1,) cumulated, the most that any state can get. The arrays may be
    longer than what is filled. most: terms of the longest reading.
    """

    def __init__(self, tables: Tables) -> None:
        self._tables = tables
        self._magnitude = np.maximum(np.abs(tables.lowest), np.abs(tables.highest))
        self.clear()

    def __len__(self) -> int:
        return self._readings

    def clear(self) -> None:
        """Forget all readings."""
        letters = self._tables.outside.shape[1]
        self._readings = self._terms = self.most = 0
        self.start = np.zeros(65, dtype=np.int64)
        self.ceiling = np.zeros(65)
        self.constant = np.zeros((64, letters))
        self.kind = np.zeros(2048, dtype=np.int64)
        self.xy = np.zeros((2048, 2))
        self.weight = np.zeros(2048, dtype=np.float32)

    def append(self, evidence: Evidence, xy: FloatArray) -> None:
        """Add a reading's terms; xy: (terms, 2) mm, where each term's taxel is in the robot frame."""
        terms, tables = len(evidence.table), self._tables
        if self._readings == len(self.constant):
            self.start, self.ceiling = _doubled(self.start), _doubled(self.ceiling)
            self.constant = _doubled(self.constant)
        while self._terms + terms > len(self.kind):
            self.kind, self.xy, self.weight = _doubled(self.kind), _doubled(self.xy), _doubled(self.weight)
        new = slice(self._terms, self._terms + terms)
        self.kind[new], self.xy[new], self.weight[new] = evidence.table, xy, evidence.weight
        weight = evidence.weight.astype(float)
        most = np.maximum(weight * tables.highest[evidence.table], weight * tables.lowest[evidence.table])
        most += _ROUNDING * np.abs(weight) * self._magnitude[evidence.table]
        self.constant[self._readings] = weight @ tables.outside[evidence.table]
        self._terms += terms
        self.most = max(self.most, terms)
        self._readings += 1
        self.start[self._readings] = self._terms
        self.ceiling[self._readings] = self.ceiling[self._readings - 1] + most.sum()


def _doubled(array: np.ndarray) -> np.ndarray:
    return np.concatenate([array, np.zeros_like(array)])
