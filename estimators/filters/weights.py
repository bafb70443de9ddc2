"""Weights of states, kept as logs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray

_BISECTIONS = 14  # of a power


@dataclass(frozen=True, eq=False)
class Weights:
    """The weights of n states, from 1. log: (n,), of any common factor; -inf is weight 0, at least one is finite."""

    log: FloatArray

    def __len__(self) -> int:
        return len(self.log)

    @cached_property
    def relative(self) -> FloatArray:
        """Give the weights (n,) in the unit of the heaviest, which is 1: they cannot all be 0."""
        below = self.log - self.log.max()
        return np.exp(below, out=below)

    @property
    def normalised(self) -> FloatArray:
        """Give the weights (n,), summing to 1."""
        return self.relative / self.relative.sum()

    @property
    def log_mean(self) -> float:
        """Give the log of the mean weight."""
        return float(self.log.max() + np.log(self.relative.mean()))

    @property
    def ess(self) -> float:
        """Give the effective sample size, from 1 to n (Kong 1992)."""
        weight = self.relative
        return float(weight.sum() ** 2 / (weight @ weight))

    def systematic(self, count: int, rng: np.random.Generator) -> NDArray[np.intp]:
        """Draw `count` indices, ascending, each as often as is due, rounded up or down.

        Systematic resampling (Kitagawa 1996): one random number, the least variance for its cost.
        """
        return self.spaced(count, rng.random())

    def spaced(self, count: int, first: float) -> NDArray[np.intp]:
        """List the indices at which the sum of the weights reaches (k + first) / count of all, `count` ascending ones.

        first: from 0 to 1.
        """
        reached = np.cumsum(self.relative)
        ladder = (np.arange(count) + first) / count * reached[-1]
        return np.minimum(np.searchsorted(reached, ladder, side="right"), len(self) - 1)


def highest_power(log_weight: FloatArray, log_p: FloatArray, least: float, low: float = 0.0) -> float:
    """Find the largest power b from `low` to 1 with which weights times p^b leave so many states effective.

    log_weight, log_p: (n,). least: effective sample size. By bisection; `low` if no power does.
    """
    if Weights(log_weight + log_p).ess >= least:
        return 1.0
    high = 1.0
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        enough = Weights(log_weight + middle * log_p).ess >= least
        low, high = (middle, high) if enough else (low, middle)
    return low
