"""The log-likelihood of one sequence of readings as a field over letters and poses: what every filter asks."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core.errors import InputError
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

    @abstractmethod
    def bound(self, first: int = 0) -> float:
        """Give an upper bound of log p of readings first and later, nats, for any letter and state; inf if unknown."""


class PlainField(LikelihoodField):
    """The field of any measurement model: its `log_p` is asked for each reading and letter."""

    def __init__(self, likelihood: Likelihood, labels: Sequence[str]) -> None:
        super().__init__(labels)
        self._likelihood, self._name = likelihood, type(likelihood).__name__
        self.reset()

    def reset(self) -> None:
        """Forget all readings."""
        super().reset()
        self._felt: list[tuple[FloatArray, FloatArray] | None] = []

    def append(self, reading: FloatArray, sensor_in_robot: FloatArray) -> None:
        """Add a reading (taxels,) kPa, taken at a pose [mm, mm, rad]."""
        self._felt.append((np.array(reading, dtype=float), np.array(sensor_in_robot, dtype=float)))
        self._readings += 1

    def ignore_last(self) -> None:
        """Let the last reading say nothing, for it is impossible wherever the object may be."""
        self._felt[-1] = None
        self.ignored += 1

    def log_p(
        self, letter: ArrayLike, state: FloatArray, first: int = 0, last: int | None = None
    ) -> FloatArray:
        """Sum log p(z | letter, state) over some readings, see `LikelihoodField.log_p`.

        Raises InputError that names the model for an answer of another shape, with a NaN or with inf.
        """
        states, total = np.ascontiguousarray(state.T), np.zeros(state.shape[1])
        letters = np.full(len(total), letter, dtype=np.int64)
        for number in np.unique(letters).tolist():
            mine = letters == number
            for felt in self._felt[first:last]:
                if felt is not None:
                    total[mine] += self._checked(*felt, self.labels[number], states[mine])
        return total

    def bound(self, first: int = 0) -> float:
        """Give an upper bound of log p of readings first and later, nats; inf if the model knows none."""
        return float(sum(self._likelihood.most(felt[0]) for felt in self._felt[first:] if felt is not None))

    def _checked(self, reading: FloatArray, pose: FloatArray, label: str, states: FloatArray) -> FloatArray:
        log_p = np.asarray(self._likelihood.log_p(reading, pose, label, states))
        if log_p.shape != (len(states),):
            raise InputError(
                f"likelihood {self._name}: log_p of {len(states)} states has shape {log_p.shape}, not "
                f"({len(states)},)"
            )
        if not np.issubdtype(log_p.dtype, np.floating) or np.isnan(log_p).any() or np.isposinf(log_p).any():
            raise InputError(
                f"likelihood {self._name}: log_p gives a NaN, inf or no float; give nats or -inf"
            )
        return log_p


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
        return PlainField(likelihood, labels)
    from tactsim.estimators.field.table_field import (
        TableField,  # compiled code, which other models do without
    )

    return TableField(likelihood, labels, taxel_xy, spacing, finest)
