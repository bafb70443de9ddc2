"""`ForwardModel`: what an estimator may ask of a press, without seeing the press: predicted readings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray


@dataclass(frozen=True, eq=False)
class Linearised:
    """Predicted readings of n presses and how they change.

    mean: (n, taxels) kPa. by_pose: (n, 3, taxels) kPa per mm, mm and rad of the sensor's motion along its own axes
    and about its middle. nuisance: (n, q, taxels) kPa for one standard deviation of each thing that is off in a press
    and that nobody is told: its place, its angle, its tilts. To first order and beside the noise, readings are
    Gaussian about the mean with the covariance nuisance.T @ nuisance.
    """

    mean: FloatArray
    by_pose: FloatArray
    nuisance: FloatArray

    def with_rows(self, rows: NDArray[np.intp], others: Linearised, off: FloatArray) -> Linearised:
        """Put others, of presses that were off by `off` (k, q) standard deviations, in the place of some rows (k,)."""
        mean, by_pose, nuisance = self.mean.copy(), self.by_pose.copy(), self.nuisance.copy()
        mean[rows] = others.mean - (off[:, None] @ others.nuisance)[:, 0]
        by_pose[rows], nuisance[rows] = others.by_pose, others.nuisance
        return Linearised(mean, by_pose, nuisance)


class ForwardModel(Protocol):
    """Predict what a pad reads of known objects at given poses.

    letters: the objects. taxels: of a reading. noise: kPa, standard deviation of a taxel's independent errors.
    reach: mm for each letter: where the pad's middle is farther from the object's origin nothing touches. turns: 2 if
    a pad turned by half a turn reads the same in reverse, else 1. symmetry: of each letter, the order of its rotational
    symmetry about its origin, 0 for a disc.
    """

    letters: tuple[str, ...]
    noise: float
    reach: Mapping[str, float]
    turns: int
    symmetry: Mapping[str, int]

    @property
    def taxels(self) -> int:
        """Count the taxels of a reading."""
        ...

    def readings(self, letter: str, sensor_in_object: FloatArray) -> FloatArray:
        """Predict the readings (n, taxels) kPa of presses at poses (n, 3), exactly there, without noise."""
        ...

    def linearised(
        self,
        letter: str,
        sensor_in_object: FloatArray,
        off: FloatArray | None = None,
        load: FloatArray | None = None,
    ) -> Linearised:
        """Predict the readings of presses stated to be at poses (n, 3), and how they change.

        off: (n, q) by how many standard deviations each press is off, in the order of `Linearised.nuisance`; by
        default none is. load: (n,) times that of the press; if it is given, a last nuisance follows, of 1 in its
        logarithm.
        """
        ...
