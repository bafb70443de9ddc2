"""Particles over (object, pose in space): drawn about modes, weighed by all touches and moved on the group."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactsim.core import rigid
from tactsim.core.compiling import Reals2D, Reals3D, compiled
from tactsim.core.poses import FloatArray
from tactsim.estimators.filters.states import Weights, highest_power
from tactsim.solids.field import GYRATION, SpaceField, moved, moves, scattered

_FIRST, _LATER = 2, 5  # steps of all candidates, and of those that are left
_CLIMBING, _MOST = 150, 60  # candidates that are left, and modes
_APART = 6.0  # squared standard deviations from one mode to the next, at least
_FORGOTTEN = 30.0  # nats below the best at which a mode does not count
_WIDER = 1.3  # times the covariance of a mode is that of the particles drawn about it
_FLATTER = 0.6  # power of a mode's mass by which particles are shared out


@dataclass(frozen=True, eq=False)
class Modes:
    """Places where a belief is high, as normal distributions.

    label: (k,). pose: (k, 7) object_in_robot. factor: (k, 6, 6), the lower Cholesky factors of the information about
    [shift, turn] in the object's frame, mm and rad. log_mass: (k,) the log of what they hold, but for a constant.
    """

    label: NDArray[np.int64]
    pose: FloatArray
    factor: FloatArray
    log_mass: FloatArray


def climbed(
    field: SpaceField, label: NDArray[np.int64], pose: FloatArray, steps: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Climb from poses (n, 7) of objects (n,): poses, information (n, 6, 6) and log p (n,) of all touches."""
    moved, information, log_p = np.empty_like(pose), np.empty((len(pose), 6, 6)), np.empty(len(pose))
    for one in np.unique(label).tolist():
        mine = np.flatnonzero(label == one)
        moved[mine], information[mine], log_p[mine] = field.climb(one, pose[mine], steps)
    return moved, information, log_p


def find_modes(field: SpaceField, label: NDArray[np.int64], pose: FloatArray, box: float) -> Modes:
    """Climb from candidates (n,) at (n, 7), and keep one of those that come to the same place.

    box: mm, the prior's half side.
    """
    label, pose, *_ = _parted(label, *climbed(field, label, pose, _FIRST), box, 3 * _FORGOTTEN, _CLIMBING)
    return Modes(*_parted(label, *climbed(field, label, pose, _LATER), box, _FORGOTTEN, _MOST))


def _parted(
    label: NDArray[np.int64],
    pose: FloatArray,
    information: FloatArray,
    log_p: FloatArray,
    box: float,
    forgotten: float,
    most: int,
) -> tuple[NDArray[np.int64], FloatArray, FloatArray, FloatArray]:
    """Keep at most so many of the poses (n, 7), and of those that are near each other the one that holds the most.

    forgotten: nats below the best at which one does not count. Returns what `Modes` has, the best first.
    """
    factor = np.asarray(np.linalg.cholesky(information), dtype=float)
    log_mass = log_p - np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
    log_mass[np.abs(pose[:, :3]).max(axis=1) > box] = -np.inf
    order = np.argsort(-log_mass, kind="stable")
    order = order[log_mass[order] > -np.inf]
    kept: list[int] = []
    left = order[log_mass[order] > log_mass[order[:1]] - forgotten]
    while len(left) and len(kept) < most:
        one = left[:1]
        kept.append(int(one[0]))
        away = _away(pose[one], factor[one], pose[left])[0]
        left = left[(away > _APART) | (label[left] != label[one])]
    return label[kept], pose[kept], factor[kept], log_mass[kept]


def draw(
    modes: Modes, count: int, box: float, rng: np.random.Generator
) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
    """Draw `count` poses about modes: labels, poses (n, 7), logs (n,) of how much of the prior each stands for.

    n is at most `count`: poses outside of the prior are left out. It is 0 where there are no modes.
    """
    if not len(modes.label):
        return np.empty(0, dtype=np.int64), np.empty((0, 7)), np.empty(0)
    log_share = _FLATTER * modes.log_mass
    log_share = log_share - log_share.max()
    log_share -= math.log(np.exp(log_share).sum())
    steps = np.cumsum(np.exp(log_share))
    which = np.minimum(
        np.searchsorted(steps, (np.arange(count) + rng.random()) / count * steps[-1]), len(steps) - 1
    )
    normal = rng.standard_normal((count, 6)) * math.sqrt(_WIDER)
    pose = scattered(modes.pose[which], modes.factor[which], normal)
    label = modes.label[which]
    away = _away(modes.pose, modes.factor, pose) / _WIDER
    held = np.log(np.diagonal(modes.factor, axis1=1, axis2=2)).sum(axis=1) - 3 * math.log(
        2 * math.pi * _WIDER
    )
    density = np.where(modes.label[:, None] == label, (log_share + held)[:, None] - 0.5 * away, -np.inf)
    log_density = np.logaddexp.reduce(density, axis=0)
    log_prior = -3 * math.log(2 * box) - math.log(8 * math.pi**2)
    inside = np.abs(pose[:, :3]).max(axis=1) <= box
    return label[inside], pose[inside], (log_prior - math.log(count) - log_density)[inside]


def _away(mode: FloatArray, factor: FloatArray, pose: FloatArray) -> FloatArray:
    """Give how many squared standard deviations poses (n, 7) are from modes (k, 7): (k, n)."""
    away = np.empty((len(mode), len(pose)))
    squares_away(np.ascontiguousarray(mode), np.ascontiguousarray(factor), np.ascontiguousarray(pose), away)
    return away


@compiled()
def squares_away(modes: Reals2D, factor: Reals3D, poses: Reals2D, away: Reals2D) -> None:
    """Write how many squared standard deviations poses (n, 7) are from modes (k, 7): away (k, n).

    factor: (k, 6, 6), the lower Cholesky factors of the information about [shift, turn] in the mode's own frame.
    """
    off = np.empty(6)
    for k in range(len(modes)):
        w, x, y, z = modes[k, 3], -modes[k, 4], -modes[k, 5], -modes[k, 6]
        for n in range(len(poses)):
            p, q, r = poses[n, 0] - modes[k, 0], poses[n, 1] - modes[k, 1], poses[n, 2] - modes[k, 2]
            tx, ty, tz = 2 * (y * r - z * q), 2 * (z * p - x * r), 2 * (x * q - y * p)
            off[0] = p + w * tx + y * tz - z * ty
            off[1] = q + w * ty + z * tx - x * tz
            off[2] = r + w * tz + x * ty - y * tx
            a, b, c, d = poses[n, 3], poses[n, 4], poses[n, 5], poses[n, 6]
            real = w * a - x * b - y * c - z * d
            i = w * b + x * a + y * d - z * c
            j = w * c - x * d + y * a + z * b
            m = w * d + x * c - y * b + z * a
            length = math.sqrt(i * i + j * j + m * m)
            # Of the two quaternions of a turn the one of the shorter way.
            by = 2.0 if length < 1e-12 else 2 * math.atan2(length, abs(real)) / length
            by = -by if real < 0 else by
            off[3], off[4], off[5] = by * i, by * j, by * m
            total = 0.0
            for column in range(6):
                value = 0.0
                for row in range(column, 6):
                    value += off[row] * factor[k, row, column]
                total += value * value
            away[k, n] = total


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

    def spread(self, chosen: NDArray[np.intp], least: float) -> Weights:
        """Weigh some particles (n,) for the rest of the way to power 1, or as far as leaves so many of them effective.

        Where rounds ended before power 1, one particle may hold all: that is no belief without a width, but one that
        is not known more sharply.
        """
        start, log_p = (self.log_weight - self.power * self.log_p)[chosen], self.log_p[chosen]
        return Weights(start + highest_power(start, log_p, min(least, len(chosen) / 4)) * log_p)

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
_NEAR = 3.0  # mm about the mode whose states are averaged


def mean_around(poses: FloatArray, weights: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Average object_in_robot (n, 7) with weights (n,) over the states of the mode that holds the most: (7,).

    Returns also which states (n,) these are. A symmetric object has copies that are as probable, far away, and others
    may look alike: they are left out.
    """
    reached = np.cumsum(weights)
    chosen = np.unique(np.searchsorted(reached, (np.arange(_TRIED) + 0.5) / _TRIED * reached[-1]))
    near = _near(poses, chosen)
    best = int((near @ weights).argmax())
    mode, weight = int(chosen[best]), np.where(near[best], weights, 0.0)
    weight = weight / weight.sum()
    off = rigid.to_vector(rigid.multiply(poses[:, 3:], rigid.conjugate(poses[mode, 3:])))
    turned = rigid.multiply(rigid.from_vector(weight @ off), poses[mode, 3:])
    return np.concatenate([weight @ poses[:, :3], turned / np.linalg.norm(turned)]), near[best]


def widened(
    poses: FloatArray, mean: FloatArray, weight: FloatArray, factor: float, normal: FloatArray
) -> FloatArray:
    """Move states (n, 7) at random, so that the variances of a mode become `factor` times as large: (n, 7).

    mean (7,), weight (n,): of that mode's states, not all 0. normal: (m, 6) normal numbers, which are used in turns.
    """
    away = moves(mean, poses)
    values, axes = np.linalg.eigh((away * weight[:, None]).T @ away / weight.sum())
    scale = np.sqrt((factor - 1) * np.maximum(values, 0))
    return moved(poses, np.resize(normal, away.shape) * scale @ axes.T)


def _near(poses: FloatArray, chosen: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Tell which poses (n, 7) are near those of the indices (k,): (k, n)."""
    away = ((poses[chosen, None, :3] - poses[:, :3]) ** 2).sum(axis=2)
    turn = 2 * np.arccos(np.minimum(np.abs(poses[chosen, 3:] @ poses[:, 3:].T), 1.0))
    return np.asarray(away + (GYRATION * turn) ** 2 <= _NEAR**2)
