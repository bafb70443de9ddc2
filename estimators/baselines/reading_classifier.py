"""What estimators share that name the letter of each reading by itself: Bayes' rule over the readings."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import (
    Estimate,
    Estimator,
    Options,
    check_order,
    check_reading,
    probabilities,
)


class ReadingClassifier(Estimator):
    """Multiply what each reading says of the letter (naive Bayes). A subclass implements `fit` and `_log_p_of`.

    Readings are not fitted together in space. Unless a subclass says where the object lies, the pose is always the
    middle of the prior, 0, 0, 0, which has the least expected squared error while nothing is known.

    labels: the letters. taxels: of a reading. Both are set by `fit`. _robot_in_object: (letters, 3) what is said of the
    pose. _evaluated: what `work` counts.
    """

    draws = False

    def __init__(self, options: Options) -> None:
        super().__init__(options)
        self.labels: tuple[str, ...] = ()
        self.taxels = 0
        self._started = False
        self._evaluated = 0

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the sequence: every letter is equally probable again."""
        check_order(bool(self.labels), "fit", "reset")
        self._sum = np.zeros(len(self.labels))
        self._robot_in_object = np.zeros((len(self.labels), 3))
        self._started = True

    def update(self, reading: ArrayLike, sensor_in_robot: ArrayLike) -> None:
        """Take in one reading (taxels,) in the scan's unit at the pose sensor_in_robot [mm, mm, rad]."""
        check_order(self._started, "reset" if self.labels else "fit", "update")
        self._sum += self._log_p_of(*check_reading(reading, sensor_in_robot, self.taxels))

    def estimate(self) -> Estimate:
        """Say which letter it is, and what is known of the place."""
        check_order(self._started, "reset" if self.labels else "fit", "estimate")
        p = np.exp(self._sum - self._sum.max())
        best = int(p.argmax())
        return Estimate(self.labels[best], probabilities(self.labels, p), self._robot_in_object[best].copy())

    @property
    def work(self) -> dict[str, Any]:
        """Count what readings were compared with, or how often a classifier was asked."""
        return {"likelihood_evaluations": self._evaluated, "skipped": {}}

    @abstractmethod
    def _log_p_of(self, reading: FloatArray, sensor_in_robot: FloatArray) -> FloatArray:
        """Say what a reading (taxels,) adds to the log-probability of each letter, (letters,), up to a constant."""
