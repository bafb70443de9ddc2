"""The one bootstrap: figures with 95 % intervals over scans and trials; `compare` has those of paired differences.

A run has a scan of its own, and all its trials share the maps learned from it. So its trials are not independent,
and an interval from the trials of one run says nothing of the next scan. The bootstrap has two levels (Davison and
Hinkley 1997, section 3.8): it draws as many runs as there are, with replacement, and from each of them as many trials
as it has. Intervals are percentiles. Where trials differ more than scans they are somewhat too wide. Where scans differ
more, and there are only five, they hold the truth in 85 to 90 % of cases instead of 95 %: a reason to run more seeds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike

from tactsim.core.poses import FloatArray

DRAWS = 2000
LEVEL = 0.95
Z_95 = NormalDist().inv_cdf((1 + LEVEL) / 2)
# Fewer pairs decide nothing: even if all of them speak for one side, chance does that in more than 1 of 40 cases.
FEWEST_PAIRS = 7
# All draws of a single trial are that trial, which would be an interval without a width.
_FEWEST = 2


@dataclass(frozen=True)
class Figure:
    """A figure with its 95 % interval; None where there is none, or, of a reading, where it is later."""

    value: float | None
    low: float | None
    high: float | None


NOTHING = Figure(None, None, None)


def wilson(successes: ArrayLike, count: int, level: float = LEVEL) -> tuple[FloatArray, FloatArray]:
    """Bound a proportion with Wilson's score interval (Wilson 1927), 95 % unless another level is given.

    The proportion lies within it: at 0 the interval begins at 0, and at 1 it ends at 1.
    """
    p, z = np.asarray(successes, dtype=float) / count, NormalDist().inv_cdf((1 + level) / 2)
    middle = (p + z**2 / (2 * count)) / (1 + z**2 / count)
    half = z / (1 + z**2 / count) * np.sqrt(p * (1 - p) / count + z**2 / (4 * count**2))
    # By rounding alone an end may lie on the wrong side of p, and an error bar would be negative.
    return np.clip(middle - half, 0, p), np.clip(middle + half, p, 1)


def mean(
    values: ArrayLike, sizes: Sequence[int], of: ArrayLike | None = None, level: float = LEVEL
) -> Figure:
    """Average values (n,) of the trials of runs of these sizes, one run after the other; None if one is NaN: not known.

    of: (n,) marks those that count. One trial alone has no interval.
    """
    values = np.asarray(values, dtype=float)
    marked = np.ones(len(values)) if of is None else np.asarray(of, dtype=float)
    if np.isnan(values[marked > 0]).any():
        return NOTHING
    # Of the others nothing need be known.
    return ratio(np.where(marked > 0, values, 0.0), marked, sizes, level)


def share(
    holds: ArrayLike, sizes: Sequence[int], of: ArrayLike | None = None, level: float = LEVEL
) -> Figure:
    """Give the share as `mean` does; its interval is never narrower than Wilson's, which is that of a single run.

    Where something holds in all trials, it does in all draws of the bootstrap, which says nothing of the next trial.
    """
    chosen = np.asarray(holds, dtype=float)
    chosen = chosen if of is None else chosen[np.asarray(of, bool)]
    if not len(chosen) or np.isnan(chosen).any():
        return NOTHING
    low, high = map(float, wilson(chosen.sum(), len(chosen), level))
    if len(sizes) > 1:
        found = mean(holds, sizes, of, level)
        if found.low is not None and found.high is not None:
            low, high = min(low, found.low), max(high, found.high)
    return Figure(float(chosen.mean()), low, high)


def ratio(above: ArrayLike, below: ArrayLike, sizes: Sequence[int], level: float = LEVEL) -> Figure:
    """Divide the sum of `above` (n,) over the trials of runs of these sizes by that of `below` (n,)."""
    above, below = np.asarray(above, dtype=float), np.asarray(below, dtype=float)
    if not below.any():
        return NOTHING
    found = float(above.sum() / below.sum())
    if np.count_nonzero(below) < _FEWEST:
        return Figure(found, None, None)
    counts = counts_of(tuple(sizes))
    drawn, divisor = counts @ above, counts @ below
    low, high = percentiles(drawn[divisor > 0] / divisor[divisor > 0], level)
    return Figure(found, float(low), float(high))


def percentiles(drawn: FloatArray, level: float = LEVEL) -> FloatArray:
    """Take the ends of an interval from draws (draws, ...) of a figure; returns (2, ...)."""
    return np.quantile(drawn, [(1 - level) / 2, (1 + level) / 2], axis=0)


def resampled(sizes: Sequence[int], rng: np.random.Generator, draws: int = DRAWS) -> FloatArray:
    """Draw runs of these sizes with replacement, and trials of each; gives the trials' counts (draws, n)."""
    runs = rng.multinomial(len(sizes), np.full(len(sizes), 1 / len(sizes)), size=draws)  # (draws, runs)
    # k copies of a run are k times as many of its trials.
    pairs = zip(runs.T, sizes, strict=True)
    drawn = [rng.multinomial(times * size, np.full(size, 1 / size)) for times, size in pairs]
    return np.hstack(drawn).astype(float)


@lru_cache(maxsize=4)
def counts_of(sizes: tuple[int, ...]) -> FloatArray:
    """Draw for runs of these sizes, the same for all methods, as they are drawn from one seed: (draws, n)."""
    counts = resampled(sizes, np.random.default_rng(0))
    counts.setflags(write=False)
    return counts
