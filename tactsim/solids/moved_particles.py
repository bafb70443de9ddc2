"""Particles over (object, pose in space), weighed by all touches little by little and moved on the group."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactsim.core import rigid
from tactsim.core.poses import FloatArray
from tactsim.estimators.filters.states import Weights, highest_power

# log p of the touches so far for labels (n,) and object_in_robot (n, 7).
LogP = Callable[[NDArray[np.int64], FloatArray], FloatArray]

_NEIGHBOURS = 4  # particles to each side in the list, which resampling leaves in the order of where they are
_STRIDES = np.array([0.3, 0.7, 1.2])  # of the difference of two neighbours
_FAR = 0.6  # rad; neighbours turned further apart belong to different modes
_TURNS = 0.002, 0.15  # rad: the least and the largest scale of a turn about a touched place
_LEVER = 5.0  # mm for a rad, of the shift beside such a turn
_JITTER = 0.02, 0.001  # mm and rad, so that copies can part
_POWERS = np.geomspace(1, 0.02, 18)
_MOVES = 3  # after each resampling


@dataclass(eq=False)
class MovedParticles:
    """Particles that stand for p(state) p(touches | state)^power.

    label: (n,). pose: (n, 7) object_in_robot. log_p: (n,) of all touches. log_weight: (n,).
    """

    label: NDArray[np.int64]
    pose: FloatArray
    log_p: FloatArray
    log_weight: FloatArray
    power: float

    @property
    def rest(self) -> FloatArray:
        """Give the log-weights (n,) for the rest of the way to power 1."""
        return self.log_weight + (1 - self.power) * self.log_p

    def take_in(self, log_p: FloatArray) -> None:
        """Add a touch's log p (n,)."""
        self.log_weight = self.log_weight + self.power * log_p
        self.log_p = self.log_p + log_p

    def lower_power(self, least: float) -> None:
        """Set the power as near 1 as leaves at least so many particles effective.

        If no power does, the one is taken that leaves the most.
        """
        start = self.log_weight - self.power * self.log_p
        effective = np.array([Weights(start + power * self.log_p).ess for power in _POWERS])
        enough = np.flatnonzero(effective >= least)
        self.power = float(_POWERS[enough[0] if len(enough) else effective.argmax()])
        self.log_weight = start + self.power * self.log_p

    def raise_power(self, least: float) -> None:
        """Raise the power as near to 1 as leaves at least so many particles effective."""
        start = self.log_weight - self.power * self.log_p
        power = highest_power(start, self.log_p, least, self.power)
        self.log_weight, self.power = start + power * self.log_p, power

    def resample(self, count: int, rng: np.random.Generator) -> None:
        """Draw `count` particles systematically: equal weights afterwards, and the same sum."""
        weights = Weights(self.log_weight)
        chosen = weights.systematic(count, rng)
        self.log_weight = np.full(count, weights.log_mean + np.log(len(weights) / count))
        self.label, self.pose, self.log_p = self.label[chosen], self.pose[chosen], self.log_p[chosen]

    def move(self, log_p: LogP, places: FloatArray, box: float, rng: np.random.Generator) -> None:
        """Move particles by a Metropolis step that leaves what they stand for as it is.

        places: (k, 3) mm, touched places about which poses are turned. box: mm, the prior's half side.
        """
        count = len(self.label)
        first, second = (
            (np.arange(count) + rng.choice([-1, 1], count) * rng.integers(1, _NEIGHBOURS + 1, count)) % count
            for _ in range(2)
        )
        turn = rigid.to_vector(rigid.multiply(self.pose[first, 3:], rigid.conjugate(self.pose[second, 3:])))
        shift = self.pose[first, :3] - self.pose[second, :3]
        apart = (self.label[first] != self.label[second]) | (np.linalg.norm(turn, axis=1) > _FAR)
        stride = np.where(apart, 0.0, rng.choice(_STRIDES, count))[:, None]
        turn, shift = stride * turn, stride * shift
        about = self.pose[:, :3].copy()
        # The others are turned about a touched place, which keeps a contact there.
        own = apart | (rng.random(count) < 0.4)
        scale = np.exp(rng.uniform(math.log(_TURNS[0]), math.log(_TURNS[1]), count))[:, None]
        turn = np.where(own[:, None], scale * rng.standard_normal((count, 3)), turn)
        shift = np.where(own[:, None], _LEVER * scale * rng.standard_normal((count, 3)), shift)
        if len(places):
            about[own] = places[rng.integers(len(places), size=count)][own]
        turn = turn + _JITTER[1] * rng.standard_normal((count, 3))
        shift = shift + _JITTER[0] * rng.standard_normal((count, 3))
        by = rigid.from_vector(turn)
        proposed = np.concatenate(
            [
                about + rigid.turned(by, self.pose[:, :3] - about) + shift,
                rigid.multiply(by, self.pose[:, 3:]),
            ],
            axis=1,
        )
        proposed[:, 3:] /= np.linalg.norm(proposed[:, 3:], axis=1, keepdims=True)
        within = np.abs(proposed[:, :3]).max(axis=1) <= box
        found = self.log_p.copy()
        found[within] = log_p(self.label[within], proposed[within])
        accepted = within & (np.log(rng.random(count)) < self.power * (found - self.log_p))
        self.pose = np.where(accepted[:, None], proposed, self.pose)
        self.log_p = np.where(accepted, found, self.log_p)

    def settle(
        self, log_p: LogP, places: FloatArray, box: float, rng: np.random.Generator, count: int, rounds: int,
        least: float,
    ) -> None:  # fmt: skip
        """Raise the power to 1 in at most `rounds` rounds.

        Each resamples to `count` particles, moves them, and leaves at least so many effective.
        """
        self.raise_power(least)
        for _ in range(rounds):
            if self.power == 1.0:
                return
            self.resample(count, rng)
            for _ in range(_MOVES):
                self.move(log_p, places, box, rng)
            self.raise_power(least)


def born(
    label: NDArray[np.int64], pose: FloatArray, log_p: FloatArray, log_volume: FloatArray, least: float
) -> MovedParticles:
    """Make particles of poses that stand for volumes (n,), at the largest power that leaves enough effective."""
    particles = MovedParticles(label, pose, log_p, log_volume + log_p, 1.0)
    if len(label):
        particles.lower_power(least)
    return particles


def evidence(log_weight: FloatArray) -> float:
    """Give log p(touches), all that weights (n,) stand for: -inf if there are none."""
    if not log_weight.max(initial=-math.inf) > -math.inf:
        return -math.inf
    return Weights(log_weight).log_mean + math.log(len(log_weight))


_TRIED = 50  # states, chosen evenly by weight, of which one is the middle of the mode
_NEAR, _GYRATION = 3.0, 15.0  # mm about the mode whose states are averaged; an angle counts at that lever


def mean_around(poses: FloatArray, weights: FloatArray) -> FloatArray:
    """Average object_in_robot (n, 7) with weights (n,) over the states of the mode that holds the most: (7,).

    A symmetric object has copies that are as probable, far away, and others may look alike: they are left out.
    """
    reached = np.cumsum(weights)
    chosen = np.unique(np.searchsorted(reached, (np.arange(_TRIED) + 0.5) / _TRIED * reached[-1]))
    near = _near(poses, chosen)
    best = int((near @ weights).argmax())
    mode, weight = int(chosen[best]), np.where(near[best], weights, 0.0)
    weight = weight / weight.sum()
    off = rigid.to_vector(rigid.multiply(poses[:, 3:], rigid.conjugate(poses[mode, 3:])))
    turned = rigid.multiply(rigid.from_vector(weight @ off), poses[mode, 3:])
    return np.concatenate([weight @ poses[:, :3], turned / np.linalg.norm(turned)])


def _near(poses: FloatArray, chosen: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Tell which poses (n, 7) are near those of the indices (k,): (k, n)."""
    away = ((poses[chosen, None, :3] - poses[:, :3]) ** 2).sum(axis=2)
    turn = 2 * np.arccos(np.minimum(np.abs(poses[chosen, 3:] @ poses[:, 3:].T), 1.0))
    return np.asarray(away + (_GYRATION * turn) ** 2 <= _NEAR**2)
