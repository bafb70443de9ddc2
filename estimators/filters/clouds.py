"""What is believed of one letter that may move: weighted placements, and the proposals that follow a reading."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core.compiling import Ints1D, Reals1D, Reals2D, compiled
from tactsim.core.poses import FloatArray
from tactsim.estimators.filters.motion import Motion
from tactsim.estimators.filters.states import Weights, highest_power

CENTRES = 240  # of a letter's belief that is moved, and of each round of proposals
DRAWN = 600  # states of a letter in a round
_ROUNDS = 4
_ENOUGH = 60.0  # effective states that a round aims at
_NEGLIGIBLE = 20.0
_REACH = 14.0  # a part of a mixture is left out where it is below exp(-_REACH) of its height
_FEWEST = 24  # centres from which wide steps go out
# The weight of a centre lies as far around it as the belief is thin there: its variance is this share of the squared
# distance to the third nearest centre. Tuned on jumps of scans 31 to 34.
_SMOOTHED, _NEAREST = 0.3, 3
_TINY = np.finfo(float).tiny
# Of the draws, beside the share that is believed: for each scale, and for jumps, which have far to look.
_LEAST_SHARE, _JUMP_SHARE = 0.1, 0.4


@dataclass(frozen=True, eq=False)
class Cloud:
    """What is believed of one letter if it moves: weighted placements, for each scale of the motion.

    centre: (n, 3) [x, y, angle / ratio] mm of T_O^R. spread: (n,) mm^2, how far around a centre its weight lies.
    log_weight: (n, scales), log p(placement, scale | letter, readings), summing to 1.
    log_evidence: log p(readings | letter).
    """

    centre: FloatArray
    spread: FloatArray
    log_weight: FloatArray
    log_evidence: float

    def joined(self, other: Cloud) -> Cloud:
        """Put two clouds of a letter together, each with what its evidence makes of it."""
        both = float(np.logaddexp(self.log_evidence, other.log_evidence))
        parts = (self, other)
        return Cloud(
            np.concatenate([one.centre for one in parts]),
            np.concatenate([one.spread for one in parts]),
            np.concatenate([one.log_weight + one.log_evidence - both for one in parts]),
            both,
        )


@dataclass(frozen=True, eq=False)
class Drawn:
    """The states of one letter that were looked at after the last reading: T_R^O (3, n), their log-weights, density."""

    state: FloatArray
    log_weight: FloatArray
    log_density: FloatArray

    def heavy(self) -> tuple[FloatArray, Weights, int]:
        """Give the states that are not negligible (3, m), their weights, and which of them is the densest."""
        chosen = np.flatnonzero(self.log_weight > self.log_weight.max() - _NEGLIGIBLE)
        return (
            self.state.take(chosen, axis=1), Weights(self.log_weight[chosen]), int(self.log_density[chosen].argmax())
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Moved:
    """A letter's belief after the motion: a mixture of normal distributions for each scale, and one for jumps.

    centre: (n, 3) mm, variance: (n,) mm^2, weight: (n,) of all parts. mixture: (n,) of which mixture each is. held:
    (scales + 1,) the weight of each mixture. around: mm, the length of the circle of angles.
    """

    centre: FloatArray
    variance: FloatArray
    weight: FloatArray
    mixture: NDArray[np.int64]
    held: FloatArray
    around: float

    @classmethod
    def of(cls, cloud: Cloud, weight: FloatArray, motion: Motion, rng: np.random.Generator) -> _Moved:
        """Move a cloud whose centres have a weight for each scale (n, scales).

        The wider a step, the fewer centres will do for it.
        """
        held = np.append(weight.sum(axis=0) * (1 - motion.jump), weight.sum() * motion.jump)
        steps = np.append(motion.variance, motion.jump_variance)
        chosen, share, every = [], [], len(cloud.centre)
        for k in np.flatnonzero(held).tolist():
            of_step = weight[:, k] if k < weight.shape[1] else weight.sum(axis=1)
            count = max(_FEWEST, math.ceil(every * math.sqrt(steps[0] / steps[k])))
            if count >= every:
                chosen.append(np.arange(every))
                share.append(of_step * held[k] / of_step.sum())
            else:
                chosen.append(Weights(log(of_step)).systematic(count, rng))
                share.append(np.full(count, held[k] / count))
        parts = np.repeat(np.flatnonzero(held), [len(one) for one in chosen])
        which = np.concatenate(chosen)
        return cls(
            cloud.centre[which], cloud.spread[which] + steps[parts], np.concatenate(share), parts, held,
            motion.around,
        )  # fmt: skip

    @cached_property
    def share(self) -> FloatArray:
        """Give the part of the draws that each mixture gets: one that is hardly believed gets enough to be found."""
        share = self.held / self.held.sum() + _LEAST_SHARE * (self.held > 0)
        share[-1] += _JUMP_SHARE * (self.held[-1] > 0)
        return np.asarray(share / share.sum(), dtype=float)

    def draw(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Draw placements (count, 3), from each mixture its share."""
        drawn = rng.multinomial(count, self.share)
        part = []
        for k in np.flatnonzero(drawn).tolist():
            mine = np.flatnonzero(self.mixture == k)
            part.append(mine[Weights(log(self.weight[mine])).systematic(int(drawn[k]), rng)])
        which = np.concatenate(part)
        width = np.sqrt(self.variance[which])
        return self.centre[which] + rng.standard_normal((count, 3)) * width[:, None]

    def densities(self, place: FloatArray) -> FloatArray:
        """Give the density of each mixture at placements (n, 3): (n, mixtures), mm^-3."""
        density = np.zeros((len(place), len(self.held)))
        add_densities(density, place, self.centre, self.weight, self.variance, self.mixture, self.around)
        return density

    def offered(self, density: FloatArray) -> FloatArray:
        """Turn `densities` (n, mixtures) into the density (n,) with which `draw` draws."""
        held = self.held
        return np.asarray(
            density @ np.divide(self.share, held, out=np.zeros_like(held), where=held > 0), dtype=float
        )


@dataclass(frozen=True, eq=False)
class _Round:
    """A round of proposals: `count` draws from round normal distributions about states that were drawn before.

    centre: (n, 3). width: mm. around: mm, the length of the circle of angles.
    """

    centre: FloatArray
    width: float
    count: int
    around: float

    def draw(self, rng: np.random.Generator) -> FloatArray:
        """Draw placements (about `count`, 3), equally many about each centre."""
        place = np.repeat(self.centre, self.count // len(self.centre), axis=0)
        return np.asarray(place + rng.standard_normal(place.shape) * self.width, dtype=float)

    def offered(self, place: FloatArray) -> FloatArray:
        """Give the expected number of draws for each mm^3 at placements (n, 3): (n,)."""
        density, count = np.zeros((len(place), 1)), len(self.centre)
        add_densities(
            density, place, self.centre, np.full(count, float(self.count // count)), np.full(count, self.width**2),
            np.zeros(count, dtype=np.int64), self.around,
        )  # fmt: skip
        return density[:, 0]


def advance(
    cloud: Cloud,
    motion: Motion,
    log_p: Callable[[FloatArray], FloatArray],
    count: int,
    rng: np.random.Generator,
) -> tuple[Cloud, Drawn]:
    """Move a letter's belief and take in a reading, whose log-likelihood at placements (n, 3) mm is log_p (n,).

    `count` states are drawn from the belief after the motion. They are weighed, and more are drawn around the
    better ones, in rounds, as the reading is taken in little by little (adaptive importance sampling, Cappe et
    al. 2004); all rounds together are the mixture that weighs a state (Cornuet et al. 2012).
    """
    before = np.exp(cloud.log_weight)
    weight = (1 - motion.switch) * before + motion.switch * before.sum(axis=1, keepdims=True) * motion.prior
    moved = _Moved.of(cloud, weight, motion, rng)
    place = moved.draw(count, rng)
    density, of_place = moved.densities(place), log_p(place)
    offered, rounds = count * moved.offered(density), []
    for number in range(_ROUNDS):
        base = log(density.sum(axis=1)) - np.log(offered + _TINY)
        power = highest_power(base, of_place, _ENOUGH)
        if power == 1 and number > 0:
            break
        around = place[Weights(base + power * of_place).systematic(CENTRES // 3, rng)]
        rounds.append(_Round(around, _spacing(around, motion.around), DRAWN // 2, motion.around))
        fresh = rounds[-1].draw(rng)
        offered = np.append(offered + rounds[-1].offered(place), np.zeros(len(fresh)))
        place, of_place = np.concatenate([place, fresh]), np.append(of_place, log_p(fresh))
        density = np.concatenate([density, moved.densities(fresh)])
        new = slice(-len(fresh), None)
        offered[new] = count * moved.offered(density[new]) + sum(one.offered(fresh) for one in rounds)
    log_density = log(density.sum(axis=1)) + of_place
    weights = Weights(log_density - np.log(offered + _TINY))
    drawn = Drawn(motion.state(place), weights.log, log_density)

    chosen, times = np.unique(weights.systematic(CENTRES, rng), return_counts=True)
    scales = len(motion.variance)
    # What jumped has the scales that its letter has.
    by_scale = density[chosen, :scales] + density[chosen, scales:] * weight.sum(axis=0) / weight.sum()
    by_scale *= times[:, None] / (CENTRES * by_scale.sum(axis=1, keepdims=True))
    spread = _SMOOTHED * _gaps(place[chosen], motion.around, _NEAREST) ** 2
    evidence = cloud.log_evidence + weights.log_mean + math.log(len(weights)) - math.log(moved.held.sum())
    return Cloud(place[chosen], spread, log(by_scale), evidence), drawn


def log(values: ArrayLike) -> FloatArray:
    """Take natural logs; that of 0 is -inf."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(values), dtype=float)


def _spacing(place: FloatArray, around: float) -> float:
    """Say how far apart placements lie: the median distance to the fifth nearest, mm."""
    return max(float(np.median(_gaps(place, around, 5))), 0.02)


@compiled()
def _gaps(place: Reals2D, around: float, nearest: int) -> Reals1D:
    """Give the distance (n,) mm from each placement (n, 3) to its `nearest`-th nearest, or its farthest of fewer."""
    found, nearest = np.empty(len(place)), min(nearest, len(place) - 1)
    least = np.empty(nearest + 1)  # squared, in order, that to itself among them
    for i in range(len(place)):
        least[:] = np.inf
        for j in range(len(place)):
            turn = abs(place[i, 2] - place[j, 2])
            turn -= around * np.rint(turn / around)
            away = (place[i, 0] - place[j, 0]) ** 2 + (place[i, 1] - place[j, 1]) ** 2 + turn**2
            k = nearest
            if away < least[k]:
                while k > 0 and away < least[k - 1]:
                    least[k] = least[k - 1]
                    k -= 1
                least[k] = away
        found[i] = math.sqrt(least[nearest])
    return found


@compiled()
def add_densities(
    density: Reals2D,
    place: Reals2D,
    centre: Reals2D,
    weight: Reals1D,
    variance: Reals1D,
    mixture: Ints1D,
    around: float,
) -> None:
    """Add the densities of several mixtures of round normal distributions.

    density: (places, mixtures), in mm^-3, is added to. place: (places, 3), centre: (parts, 3) mm, of which the
    third is an angle as a length that closes after `around` mm. weight, variance, mixture: (parts,) of each part its
    weight, its mm^2 along each axis, and of which mixture it is.
    """
    order = np.argsort(centre[:, 0])
    for number in range(density.shape[1]):
        mine = order[mixture[order] == number]
        height, rate, reach = np.empty(len(mine)), np.empty(len(mine)), np.empty(len(mine))
        for i in range(len(mine)):
            height[i] = weight[mine[i]] / (2 * math.pi * variance[mine[i]]) ** 1.5
            rate[i] = 0.5 / variance[mine[i]]
            reach[i] = _REACH / rate[i] if weight[mine[i]] > 0 else 0.0
        # Of parts in order of x only those around a place are looked at.
        parts, far = centre[mine], math.sqrt(reach.max()) if len(mine) else 0.0
        first = np.searchsorted(parts[:, 0], place[:, 0] - far)
        for j in range(len(place)):
            for i in range(first[j], len(mine)):
                dx, dy = place[j, 0] - parts[i, 0], place[j, 1] - parts[i, 1]
                if dx < -far:
                    break
                away = dx * dx + dy * dy
                if away >= reach[i]:
                    continue
                turn = abs(place[j, 2] - parts[i, 2])
                turn = min(turn, abs(around - turn))
                away += turn * turn
                if away < reach[i]:
                    density[j, number] += height[i] * math.exp(-away * rate[i])
