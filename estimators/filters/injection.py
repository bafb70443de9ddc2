"""When a particle filter is given random particles: when the weights fall (paper, ref. [23])."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tactsim.estimators.filters.weights import Weights


class Injection:
    """Replace each particle with probability max(0, 1 - w_fast / w_slow).

    w_slow and w_fast follow the mean weight, with the decays `alpha_slow` and `alpha_fast`; both are kept as logs.
    """

    def __init__(self, alpha_slow: float, alpha_fast: float) -> None:
        self._alpha_slow, self._alpha_fast = alpha_slow, alpha_fast
        self.reset()

    def reset(self) -> None:
        """Forget the means."""
        self._log_slow = self._log_fast = -math.inf

    def follow(self, weights: Weights) -> None:
        """Move both means towards the mean of these weights, which must not have lost a common factor."""
        self._log_slow = _mix(self._log_slow, weights.log_mean, self._alpha_slow)
        self._log_fast = _mix(self._log_fast, weights.log_mean, self._alpha_fast)

    def choose(self, count: int, rng: np.random.Generator) -> NDArray[np.intp]:
        """Choose which of `count` particles are to be replaced: their indices."""
        share = max(0.0, -math.expm1(min(0.0, self._log_fast - self._log_slow)))
        return np.flatnonzero(rng.random(count) < share) if share > 0 else np.empty(0, dtype=np.intp)


def _mix(log_mean: float, log_value: float, share: float) -> float:
    """Move a mean by a share towards a value, both in logs; a mean of nothing has log -inf."""
    stay = math.log1p(-share) if share < 1 else -math.inf
    return float(np.logaddexp(stay + log_mean, math.log(share) + log_value))
