"""The log-likelihood of one sequence of readings as a field over letters and poses: what every filter asks."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core.poses import FloatArray
from tactsim.estimators.likelihoods.likelihood import Likelihood, TaxelSum

# Nats of a reading that a model says is impossible, where its place is not certain.
IMPOSSIBLE = -1e9


class LikelihoodField(ABC):
    """log p(readings | letter, T_R^O) for the readings of a sequence so far (paper, eq. 7, summed).

    It has a measurement model and all readings; filters ask it and keep neither themselves. `len` is the number of
    readings. labels: the letters. ignored: how many readings were impossible everywhere, since the field was made.
    """

    ignored = 0

    def __init__(self, labels: Sequence[str]) -> None:
        self.labels = tuple(labels)
        self._readings = 0

    def __len__(self) -> int:
        return self._readings

    def reset(self) -> None:
        """Forget all readings."""
        self._readings = 0

    @cached_property
    def alike(self) -> NDArray[np.int64]:
        """Give for each letter (letters,) the number of the first that no reading can tell from it."""
        return np.arange(len(self.labels))

    @abstractmethod
    def append(self, reading: FloatArray, sensor_in_robot: FloatArray) -> None:
        """Add a reading (taxels,) kPa, taken at a pose [mm, mm, rad]."""

    @abstractmethod
    def log_p(
        self, letter: ArrayLike, state: FloatArray, first: int = 0, last: int | None = None
    ) -> FloatArray:
        """Sum log p(z | letter, state) over readings first, ..., last - 1, by default all: (n,) nats.

        letter: (n,) or one for all, index into `labels`. state: (3, n) T_R^O mm, mm, rad.
        """

    def each(self, letter: ArrayLike, state: FloatArray, first: int, last: int) -> FloatArray:
        """Give log p(z | letter, state) of each of readings first, ..., last - 1: (readings, n) nats, as `log_p`."""
        return np.array([self.log_p(letter, state, k, k + 1) for k in range(first, last)])

    @abstractmethod
    def bound(self, first: int = 0) -> float:
        """Give an upper bound of log p of readings first and later, nats, for any letter and state; inf if unknown."""


def field_of(
    likelihood: Likelihood,
    labels: Sequence[str],
    taxel_xy: FloatArray,
    spacing: tuple[float, float],
    finest: float,
) -> LikelihoodField:
    """Make the field of a fitted model: of tables if it is a sum over taxels, for states `spacing` mm apart.

    finest: mm between nodes of the tables, at most. Raises InputError if there would be too many nodes.
    """
    if not isinstance(likelihood, TaxelSum):
        from tactsim.estimators.field.plain_field import PlainField

        return PlainField(likelihood, labels)
    # Compiled code, which other models do without.
    from tactsim.estimators.field.table_field import TableField

    return TableField(likelihood, labels, taxel_xy, spacing, finest)
