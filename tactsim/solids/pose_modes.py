"""The modes of a belief about poses in space: found by climbing, and particles drawn about them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactsim.core import rigid
from tactsim.core.compiling import Reals2D, Reals3D, compiled
from tactsim.core.poses import FloatArray
from tactsim.solids.field import SpaceField

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
    normal = rng.standard_normal((count, 6, 1)) * math.sqrt(_WIDER)
    off = np.linalg.solve(np.swapaxes(modes.factor[which], 1, 2), normal)[:, :, 0]
    at = modes.pose[which]
    pose = rigid.compose(at, np.concatenate([off[:, :3], rigid.from_vector(off[:, 3:])], axis=1))
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
