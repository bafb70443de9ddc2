"""A measurement model that is no sum over taxels: the cosine between what is felt and what the map expects."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from tactsim.core import compose, transform
from tactsim.core.poses import FloatArray
from tactsim.estimators import Likelihood
from tactsim.estimators.options import MapOptions


class CosineOptions(MapOptions):
    """How much the cosine counts."""

    k: float = Field(20.0, gt=0, le=1000, description="log p of a reading that is as expected, nats")


class CosineLikelihood(Likelihood):
    """k times the cosine of the angle between a reading and the probabilities that its taxels are occupied."""

    options_type = CosineOptions

    def log_p(self, reading: FloatArray, pose: FloatArray, label: str, states: FloatArray) -> FloatArray:
        """Compare the reading with the map of the letter at each state: (n,) nats."""
        xy = transform(compose(states, pose), self.taxel_xy)
        expected = 1 / (1 + np.exp(-self.maps[label].log_odds_at(xy)))
        felt = np.maximum(reading, 0)
        lengths = np.linalg.norm(expected, axis=1) * max(float(np.linalg.norm(felt)), 1e-9)
        return np.asarray(self.options.k * (expected @ felt) / lengths, dtype=float)

    def most(self, reading: FloatArray) -> float:
        """No cosine is above 1."""
        return float(self.options.k)
