"""The base of learned methods, which answer many trials at once."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np
from numpy.typing import ArrayLike

from tactsim.core import Scan
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import (
    Estimate,
    Estimator,
    Options,
    check_order,
    check_reading,
    probabilities,
)


class BatchEstimator(Estimator):
    """Answer batches of trials. A subclass implements `learn` and `answer`; it draws nothing once it has learned.

    labels: the letters. taxels: of a reading. Both are set by `fit`, before it calls `learn`.
    """

    draws = False

    def __init__(self, options: Options) -> None:
        super().__init__(options)
        self.labels: tuple[str, ...] = ()
        self.taxels = 0
        self._touches: list[tuple[FloatArray, FloatArray]] | None = None

    @abstractmethod
    def learn(self, train: Scan) -> None:
        """Learn from training readings, one at least; `train.batches` draws trials from them."""

    @abstractmethod
    def answer(self, readings: FloatArray, sensor_in_robot: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Say after each of k readings of n trials which letter it is, and where; later readings are not looked at.

        readings: (n, k, taxels) in the scan's unit. sensor_in_robot: (n, k, 3) mm, mm, rad. Returns p(letter) (n, k,
        letters), in the order of `labels`, and robot_in_object (n, k, 3), zeros where nothing is known of the place.
        """

    def fit(self, scan: Scan) -> None:
        """Learn from the scan's training readings. Raises InputError if there are none."""
        train = scan.where("train")
        check_order(len(train) > 0, "a train reading", "fit")
        self.labels, self.taxels, self._touches = train.letters, train.readings.shape[1], None
        self.learn(train)

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the sequence."""
        check_order(bool(self.labels), "fit", "reset")
        self._touches = []

    def update(self, reading: ArrayLike, sensor_in_robot: ArrayLike) -> None:
        """Keep one reading (taxels,) in the scan's unit and its pose [mm, mm, rad]."""
        touches = self._sequence("update")
        touches.append(check_reading(reading, sensor_in_robot, self.taxels))

    def estimate(self) -> Estimate:
        """Say which letter it is, and where; before the first reading all letters are equally probable."""
        touches = self._sequence("estimate")
        if not touches:
            return self._estimate(np.ones(len(self.labels)), np.zeros(3))
        readings, poses = (np.array(part)[None] for part in zip(*touches, strict=True))
        return self.estimates(readings, poses)[0][-1]

    def estimates(self, readings: FloatArray, sensor_in_robot: FloatArray) -> list[list[Estimate]]:
        """Say after each of k readings of n trials what it would after each by itself: see `Estimator.estimates`."""
        p, poses = self.answer(readings, sensor_in_robot)
        return [
            [self._estimate(*last) for last in zip(*trial, strict=True)]
            for trial in zip(p, poses, strict=True)
        ]

    def _sequence(self, call: str) -> list[tuple[FloatArray, FloatArray]]:
        check_order(self._touches is not None, "reset" if self.labels else "fit", call)
        assert self._touches is not None
        return self._touches

    def _estimate(self, p: FloatArray, robot_in_object: FloatArray) -> Estimate:
        p = np.asarray(p, dtype=float)
        place = np.array(robot_in_object, dtype=float)
        return Estimate(self.labels[int(p.argmax())], probabilities(self.labels, p), place)
