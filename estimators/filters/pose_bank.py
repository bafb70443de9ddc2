"""A bank of predicted readings on a grid of sensor poses: where a first reading may have been taken."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactsim.core.forward import ForwardModel
from tactsim.core.poses import FloatArray

_PIECE = 4096  # poses that are pressed at a time


@dataclass(frozen=True, eq=False)
class PoseBank:
    """Predicted readings of one letter at equally spaced sensor poses.

    xy: (k, 2) mm, angle: (m,) rad, the poses are all pairs, angles first. mean: (m * k, taxels) kPa, float32.
    variance: (m * k,) kPa^2, what a taxel is off by anywhere in a grid cell, on average. spacing: mm, mm, rad.
    turns: of the pad, as `ForwardModel.turns`; the angles cover a circle divided by it.
    index: (side, side) the place of each point of the square grid among xy, -1 where nothing touches.
    """

    xy: FloatArray
    angle: FloatArray
    mean: NDArray[np.float32]
    variance: FloatArray
    spacing: FloatArray
    turns: int
    index: NDArray[np.int64]

    @classmethod
    def pressed(
        cls, forward: ForwardModel, letter: str, spacing_mm: float, angles: int, noise: float
    ) -> PoseBank:
        """Press a letter at all poses of a grid where it may touch; `angles` to half a turn."""
        reach = forward.reach[letter]
        half = math.ceil(reach / spacing_mm)
        line = spacing_mm * np.arange(-half, half + 1)
        x, y = np.meshgrid(line, line)
        near = x**2 + y**2 <= reach**2
        xy = np.stack([x[near], y[near]], axis=1)
        count = angles * (2 if forward.turns == 1 else 1)
        angle = np.arange(count) * math.pi / angles
        poses = np.concatenate([np.tile(xy, (count, 1)), np.repeat(angle, len(xy))[:, None]], axis=1)
        spacing = np.array([spacing_mm, spacing_mm, math.pi / angles])
        mean = np.empty((len(poses), forward.taxels), dtype=np.float32)
        variance = np.empty(len(poses))
        cell = spacing**2 / 12
        for first in range(0, len(poses), _PIECE):
            these = slice(first, first + _PIECE)
            found = forward.linearised(letter, poses[these])
            mean[these] = found.mean
            spread = np.einsum("nit,nit,i->n", found.by_pose, found.by_pose, cell)
            spread += np.einsum("nqt,nqt->n", found.nuisance, found.nuisance)
            variance[these] = noise**2 + spread / forward.taxels
        index = np.full(near.shape, -1)
        index[near] = np.arange(len(xy))
        return cls(xy, angle, mean, variance, spacing, forward.turns, index)

    @property
    def whole_circle(self) -> FloatArray:
        """List the angles (turns * m,) of all poses, those where the pad is turned on itself included."""
        return np.concatenate([self.angle + turn * 2 * math.pi / self.turns for turn in range(self.turns)])

    def log_p(self, reading: FloatArray) -> FloatArray:
        """Score a reading (taxels,) roughly at all poses: (angles of the whole circle, k) nats.

        As if errors were independent and alike over the taxels.
        """
        both = np.stack([reading, reading[::-1]][: self.turns], axis=1).astype(np.float32)
        dot = (self.mean @ both).astype(float)
        squares = self._squares[:, None] - 2 * dot + (reading**2).sum()
        score = -0.5 * squares / self.variance[:, None] - self._log_det[:, None]
        return np.concatenate([one.reshape(len(self.angle), -1) for one in score.T])

    def log_p_at(self, reading: FloatArray, poses: FloatArray) -> FloatArray:
        """Score a reading at the grid poses nearest to (n, 3) sensor_in_object, as `log_p`; beside the letter too."""
        half = len(self.index) // 2
        column, row = np.round(poses[:, :2] / self.spacing[:2]).astype(np.int64).T + half
        inside = (np.minimum(column, row) >= 0) & (np.maximum(column, row) < len(self.index))
        place = np.full(len(poses), -1)
        place[inside] = self.index[row[inside], column[inside]]
        count = len(self.angle)
        turn, angle = np.divmod(np.round(poses[:, 2] / self.spacing[2]).astype(np.int64), count)
        touches = np.flatnonzero(place >= 0)
        entry = angle[touches] * len(self.xy) + place[touches]
        reversed_ = (turn[touches] % self.turns == 1)[:, None]
        away = np.where(reversed_, reading[::-1], reading) - self.mean[entry]
        least = float(self.variance.min())  # where nothing touches there is noise alone
        beside = -0.5 * (reading**2).sum() / least - 0.5 * len(reading) * math.log(least)
        result = np.full(len(poses), beside)
        result[touches] = -0.5 * (away**2).sum(axis=1) / self.variance[entry] - self._log_det[entry]
        return result

    @cached_property
    def _squares(self) -> FloatArray:
        return (self.mean.astype(float) ** 2).sum(axis=1)

    @cached_property
    def _log_det(self) -> FloatArray:
        return 0.5 * self.mean.shape[1] * np.log(self.variance)

    def seeds(
        self, reading: FloatArray, sensor_in_robot: FloatArray, reach: float
    ) -> tuple[FloatArray, FloatArray]:
        """Give the states T_R^O (n, 3) with x, y within `reach` at which the reading was taken at a grid pose.

        Returns them and their scores (n,).
        """
        angle = self.whole_circle - sensor_in_robot[2]
        cos, sin = np.cos(angle), np.sin(angle)
        x, y = sensor_in_robot[:2]
        state_x = self.xy[:, 0] - (cos * x - sin * y)[:, None]
        state_y = self.xy[:, 1] - (sin * x + cos * y)[:, None]
        inside = np.maximum(np.abs(state_x), np.abs(state_y)) <= reach
        which = np.nonzero(inside)[0]
        states = np.stack([state_x[inside], state_y[inside], angle[which]], axis=1)
        return states, self.log_p(reading)[inside]
