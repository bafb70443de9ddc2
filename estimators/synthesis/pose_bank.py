"""A bank of predicted readings on a grid of sensor poses: where a reading may have been taken."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactsim.core.compiling import Bools1D, Floats2D, Ints1D, Reals1D, Reals2D, compiled
from tactsim.core.forward import Linearised
from tactsim.core.poses import FloatArray
from tactsim.estimators.synthesis.learned_pad import LearnedPad

_PIECE = 4096  # poses that are pressed at a time
# Twice the logarithm of the range of a press's readings over what a cell's predictions are off by, roughly, and twice
# that: off by far more at edges of the contact, where presses tell most, they would pass for failing.
_SURE = 9.0
_FORCES = 2.0  # standard deviations: so far a touch's factor is searched for


class Places(NamedTuple):
    """Where a reading may have been taken: n entries of a bank.

    entry: (n,) number in the bank. turned: (n,) whether the pad is turned by half a turn from there. state: (n, 3)
    T_R^O. score: (n,) rough log-likelihood. factor: (n,) of the touch, by which the entry is multiplied.
    """

    entry: NDArray[np.int64]
    turned: NDArray[np.bool_]
    state: FloatArray
    score: FloatArray
    factor: FloatArray


@dataclass(frozen=True, eq=False)
class PoseBank:
    """Predicted readings of one letter at equally spaced sensor poses.

    xy: (k, 2) mm, angle: (m,) rad, the poses are all pairs, angles first. mean: (m * k, taxels) kPa, float32.
    by_pose: (m * k, 3, taxels) and nuisance: (m * k, q, taxels), as in `Linearised`, float16. variance: (m * k,)
    kPa^2, what a taxel is off by anywhere in a grid cell, on average. spacing: mm, mm, rad. turns: by how many turns
    of the pad on itself each pose stands for further ones. copies: of how many poses that are alike, because the letter
    is symmetric, one is there; the angles cover a circle divided by both. index: (side, side) the place of each point
    of the square grid among xy, -1 where nothing touches. force: standard deviation of the logarithm of a touch's
    factor, the last nuisance, which is not part of `variance`. cap: what a taxel costs at most, in standard deviations
    squared, since it may have failed.
    """

    xy: FloatArray
    angle: FloatArray
    mean: NDArray[np.float32]
    by_pose: NDArray[np.float16]
    nuisance: NDArray[np.float16]
    variance: FloatArray
    spacing: FloatArray
    turns: int
    copies: int
    index: NDArray[np.int64]
    force: float
    cap: float

    @classmethod
    def pressed(cls, forward: LearnedPad, letter: str, spacing_mm: float, angles: int) -> PoseBank:
        """Press a letter at all poses of a grid where it may touch; `angles` to half a turn."""
        reach = forward.reach[letter]
        half = math.ceil(reach / spacing_mm)
        line = spacing_mm * np.arange(-half, half + 1)
        x, y = np.meshgrid(line, line)
        near = x**2 + y**2 <= reach**2
        xy = np.stack([x[near], y[near]], axis=1)
        # A symmetric letter is felt alike at several poses, of which one is enough.
        order, circle = forward.symmetry[letter], 2 * angles
        copies = circle if order == 0 else math.gcd(order, circle)
        turns = 1 if copies > 1 else forward.turns
        angle = np.arange(circle // (copies * turns)) * math.pi / angles
        poses = np.concatenate([np.tile(xy, (len(angle), 1)), np.repeat(angle, len(xy))[:, None]], axis=1)
        spacing = np.array([spacing_mm, spacing_mm, math.pi / angles])
        pieces = [
            forward.linearised(letter, poses[first : first + _PIECE])
            for first in range(0, len(poses), _PIECE)
        ]
        index = np.full(near.shape, -1)
        index[near] = np.arange(len(xy))
        return cls(
            xy,
            angle,
            np.concatenate([piece.mean for piece in pieces], dtype=np.float32),
            np.concatenate([_half_precision(piece.by_pose) for piece in pieces]),
            np.concatenate([_half_precision(piece.nuisance) for piece in pieces]),
            np.concatenate([_spread(piece, spacing, forward) for piece in pieces]),
            spacing,
            turns,
            copies,
            index,
            forward.force,
            _SURE + 2 * math.log((1 - forward.failing) / forward.failing) if forward.failing else math.inf,
        )

    def places(self, reading: FloatArray, sensor_in_robot: FloatArray, reach: float) -> Places:
        """List where a reading (taxels,) may have been taken such that T_R^O has x and y within `reach`.

        The score takes errors for independent and alike over the taxels.
        """
        both = np.stack([reading, reading[::-1]][: self.turns]).astype(np.float32)
        scored = score_places(
            self.mean, 1 / self.variance, -self._log_det, self.xy, self.angle, both, sensor_in_robot, reach,
            self.force, self.cap,
        )  # fmt: skip
        return Places(*scored)

    def predicted(
        self, entry: NDArray[np.int64], turned: NDArray[np.bool_], factor: FloatArray
    ) -> Linearised:
        """Give the predictions (n, ...) of entries, the pad turned or not, times the touches' factors, tilts too."""
        sign = np.where(turned[:, None, None], -1.0, 1.0)
        mean = self.mean[entry].astype(float)
        by_pose, nuisance = self.by_pose[entry].astype(float), self.nuisance[entry].astype(float)
        by_pose[:, :2] *= sign  # a turned pad moves the other way
        for values in (mean, by_pose, nuisance):
            values[turned] = values[turned][..., ::-1]
        by = factor[:, None, None]
        return Linearised(mean * factor[:, None], by_pose * by, nuisance * by)

    def log_p_at(self, reading: FloatArray, poses: FloatArray) -> FloatArray:
        """Score a reading at the grid poses nearest to (n, 3) sensor_in_object, beside the letter too."""
        # Of poses that are alike, the one in the bank.
        period = 2 * math.pi / self.copies
        fold = np.floor((poses[:, 2] + self.spacing[2] / 2) / period) * period
        cos, sin = np.cos(fold), np.sin(fold)
        x, y = cos * poses[:, 0] + sin * poses[:, 1], cos * poses[:, 1] - sin * poses[:, 0]
        half = len(self.index) // 2
        column, row = (np.round(along / self.spacing[0]).astype(np.int64) + half for along in (x, y))
        inside = (np.minimum(column, row) >= 0) & (np.maximum(column, row) < len(self.index))
        grid_point = np.full(len(poses), -1)
        grid_point[inside] = self.index[row[inside], column[inside]]
        turn, angle = np.divmod(
            np.round((poses[:, 2] - fold) / self.spacing[2]).astype(np.int64), len(self.angle)
        )
        touches = np.flatnonzero(grid_point >= 0)
        entry = angle[touches] * len(self.xy) + grid_point[touches]
        turned = (turn[touches] % self.turns == 1)[:, None]
        felt, mean = np.where(turned, reading[::-1], reading), self.mean[entry]
        factor, cost = np.ones(len(entry)), np.zeros(len(entry))
        if self.force > 0:
            seen = np.einsum("nt,nt->n", felt, mean) / np.einsum("nt,nt->n", mean, mean).clip(min=1e-9)
            logs = np.log(seen.clip(min=1e-9)).clip(-_FORCES * self.force, _FORCES * self.force)
            factor, cost = np.exp(logs), (logs / self.force) ** 2 / 2
        squares = (felt - factor[:, None] * mean) ** 2 / self.variance[entry][:, None]
        least = float(self.variance.min())  # where nothing touches there is noise alone
        beside = -0.5 * np.minimum(reading**2 / least, self.cap).sum() - 0.5 * len(reading) * math.log(least)
        result = np.full(len(poses), beside)
        result[touches] = -0.5 * np.minimum(squares, self.cap).sum(axis=1) - cost - self._log_det[entry]
        return result

    @cached_property
    def _log_det(self) -> FloatArray:
        return 0.5 * self.mean.shape[1] * np.log(self.variance)


def _half_precision(values: FloatArray) -> NDArray[np.float16]:
    largest = float(np.finfo(np.float16).max)
    return values.clip(-largest, largest).astype(np.float16)


def _spread(predicted: Linearised, spacing: FloatArray, pad: LearnedPad) -> FloatArray:
    """Average the variance of a taxel, kPa^2, over a grid cell (n,), at the touch's own factor."""
    spread = np.einsum("nit,nit,i->n", predicted.by_pose, predicted.by_pose, spacing**2 / 12)
    nuisance = predicted.nuisance[:, :-1] if pad.force else predicted.nuisance
    spread += np.einsum("nqt,nqt->n", nuisance, nuisance)
    return pad.noise**2 + spread / predicted.mean.shape[1]


@compiled()
def score_places(
    mean: Floats2D, precision: Reals1D, log_height: Reals1D, xy: Reals2D, angle: Reals1D,
    reading: Floats2D, sensor_in_robot: Reals1D, reach: float, force: float, cap: float,
) -> tuple[Ints1D, Bools1D, Reals2D, Reals1D, Reals1D]:  # fmt: skip
    """Score the poses of a bank at which T_R^O has x and y within `reach` mm, as `Places`.

    The density of a reading at each pose is normal, its errors independent and alike over the taxels; force, cap: as in
    `PoseBank`, the factor being what explains the reading best. mean: (m * k,
    taxels) kPa. precision: (m * k,) 1 / variance. log_height: (m * k,) the log-density at the mean, less a constant.
    xy: (k, 2) mm, angle: (m,) rad, as in `PoseBank`. reading: (turns, taxels) kPa, as it is and as a pad turned on
    itself reads it.
    """
    count, taxels = 0, mean.shape[1]
    turns = len(reading)
    room = turns * len(mean)
    entry, turned = np.empty(room, dtype=np.int64), np.empty(room, dtype=np.bool_)
    state, score, factor = np.empty((room, 3)), np.empty(room), np.empty(room)
    for t in range(turns):
        z = reading[t]
        for a in range(len(angle)):
            theta = angle[a] + t * 2 * math.pi / turns - sensor_in_robot[2]
            cos, sin = math.cos(theta), math.sin(theta)
            x = cos * sensor_in_robot[0] - sin * sensor_in_robot[1]
            y = sin * sensor_in_robot[0] + cos * sensor_in_robot[1]
            for k in range(len(xy)):
                state_x, state_y = xy[k, 0] - x, xy[k, 1] - y
                if abs(state_x) > reach or abs(state_y) > reach:
                    continue
                i = a * len(xy) + k
                by, cost = np.float32(1), 0.0
                if force > 0:
                    seen, own = np.float32(0), np.float32(1e-9)
                    for s in range(taxels):
                        seen += z[s] * mean[i, s]
                        own += mean[i, s] * mean[i, s]
                    log = math.log(max(float(seen / own), 1e-9))
                    log = min(max(log, -_FORCES * force), _FORCES * force)
                    by, cost = np.float32(math.exp(log)), (log / force) ** 2 / 2
                away, most = np.float32(0), np.float32(cap / precision[i])
                for s in range(taxels):
                    apart = z[s] - by * mean[i, s]
                    away += min(apart * apart, most)
                entry[count], turned[count] = i, t > 0
                state[count, 0], state[count, 1], state[count, 2] = state_x, state_y, theta
                score[count] = log_height[i] - 0.5 * precision[i] * away - cost
                factor[count] = by
                count += 1
    return entry[:count], turned[:count], state[:count], score[:count], factor[:count]
