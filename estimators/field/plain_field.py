"""The field of any measurement model, one that is no sum over taxels: slow, and without tables."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.estimators.field.field import LikelihoodField
from tactsim.estimators.likelihoods.likelihood import Likelihood


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
