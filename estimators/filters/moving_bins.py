"""The log-belief of all bins of a grid if the object moves between touches: kernels on the grid, a bank of scales."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import PoseSamples
from tactsim.estimators.field.field import LikelihoodField
from tactsim.estimators.filters.binned import BinnedBelief
from tactsim.estimators.filters.grid import StateGrid
from tactsim.estimators.filters.motion import EVIDENCE, Motion
from tactsim.estimators.filters.states import Weights, pose_samples

_TINY = np.finfo(float).tiny


class MovingBins:
    """p(letter, bin, scale of the motion | readings) of all bins, for a histogram filter (paper, eq. 13).

    Between readings the belief of each scale is convolved with its kernel along x, y and the angle. The kernel is
    the discrete Gaussian, the solution of the heat equation on the grid (Lindeberg 1990): its variance is right
    however small it is beside a bin, and k steps are one step of k times the variance. At the ends of x and y it
    reflects. A turn about the object's origin also moves T_R^O; that move is taken as independent of the turn,
    with its mean variance over the grid.
    """

    def __init__(self, field: LikelihoodField, grid: StateGrid, motion: Motion) -> None:
        self._field, self._grid, self._motion = field, grid, motion
        self._last = BinnedBelief(field, grid)
        self._shape = len(field.labels), grid.angle, grid.y, grid.x
        variance = [*([] if motion.still is None else [0.0]), *motion.variance, motion.jump_variance]
        self._kernels = [_kernels(grid, of_scale, motion.ratio) for of_scale in variance]
        still = [] if motion.still is None else [motion.still]
        self._first = len(still)  # of the scales that move
        moving = (1 - sum(still)) * motion.prior
        self._prior = np.append(still, moving)
        self.reset()

    def reset(self) -> None:
        """Make all bins of all letters equally probable."""
        even = self._prior[:, None, None, None, None] / np.prod(self._shape)
        self._p = np.broadcast_to(even, (len(self._prior), *self._shape)).copy()

    def update(self, within: float) -> tuple[int, int]:
        """Move the belief, if it is not the first reading's, and multiply it by the likelihood of the last reading.

        No bin waits, whatever `within` is. Returns how many times a bin took in a reading, and 0.
        """
        if len(self._field) > 1:
            self._move()
        log_p = self._last.of_last_reading()
        before = self._p.sum(axis=(1, 2, 3, 4))
        self._p *= np.exp(log_p - log_p.max())
        gained = self._p.sum(axis=(1, 2, 3, 4)) / np.maximum(before, _TINY)
        self._p *= np.maximum(gained, _TINY)[:, None, None, None, None] ** (EVIDENCE - 1)
        self._p /= self._p.sum()
        return log_p.size, 0

    def summary(self) -> tuple[FloatArray, NDArray[np.int64]]:
        """Sum the bins of each letter (eq. 14), and find its mode (eq. 15): (letters,) each.

        A mode is a flat index into (angles, rows, columns). It is that of the letter at rest or moving, whichever is
        likelier: the sum of both may be highest between their modes.
        """
        each = self._p.reshape(len(self._prior), self._shape[0], -1)
        moving = each[self._first :].sum(axis=0)
        mass, mode = moving.sum(axis=1), moving.argmax(axis=1)
        if self._first:
            at_rest = each[0].sum(axis=1)
            mass, mode = mass + at_rest, np.where(at_rest > mass, each[0].argmax(axis=1), mode)
        return mass, mode

    def samples(self, letter: int, within: float) -> PoseSamples:
        """Give the bins of a letter that are at most `within` nats below the best bin."""
        log_p = self.log_belief()
        flat = np.flatnonzero(log_p[letter] >= log_p.max() - within)
        size = np.repeat(np.array(self._grid.spacing)[:, None], len(flat), axis=1)
        return pose_samples(self._grid.states(flat), Weights(log_p[letter].ravel()[flat]), size)

    def log_belief(self) -> FloatArray:
        """Give the log-belief of all bins: (letters, angles, rows, columns)."""
        with np.errstate(divide="ignore"):
            return np.log(self._p.sum(axis=0))

    def _move(self) -> None:
        """Convolve the belief of each scale; some of what moves jumps, and changes its scale."""
        motion, first = self._motion, self._first
        moved = np.stack([_convolved(p, kernel) for p, kernel in zip(self._p, self._kernels, strict=False)])
        if motion.jump:
            moving = self._p[first:]
            total = moving.sum(axis=0)
            share = moving.sum(axis=(1, 2, 3, 4)) / max(float(total.sum()), _TINY)
            jumped = share[:, None, None, None, None] * _convolved(total, self._kernels[-1])
            moved[first:] = (1 - motion.jump) * moved[first:] + motion.jump * jumped
        if motion.switch:
            total = moved[first:].sum(axis=0)
            anew = motion.prior[:, None, None, None, None] * total
            moved[first:] = (1 - motion.switch) * moved[first:] + motion.switch * anew
        self._p = moved


def _kernels(
    grid: StateGrid, variance: float, ratio: float
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Build the kernels along angle, y and x as matrices; None for a kernel that changes nothing.

    variance: mm^2 along each axis, ratio: rad for each mm.
    """
    if variance == 0:
        return None
    dx, dy, da = grid.spacing
    turn = variance * ratio**2
    along = variance + turn * grid.reach**2 / 3  # T_R^O also moves when the object turns
    return (
        heat_kernel(grid.angle, turn / da**2, ring=True),
        heat_kernel(grid.y, along / dy**2),
        heat_kernel(grid.x, along / dx**2),
    )


def heat_kernel(bins: int, variance: float, *, ring: bool = False) -> FloatArray:
    """Solve the heat equation on a row of bins, or a ring: (bins, bins), columns summing to 1.

    variance: of the kernel, in bins squared. It is exp(variance / 2 times the discrete Laplacian).
    """
    laplacian = np.diag(np.full(bins, -2.0)) + np.diag(np.ones(bins - 1), 1) + np.diag(np.ones(bins - 1), -1)
    if ring:
        laplacian[0, -1] += 1
        laplacian[-1, 0] += 1
    else:
        laplacian[0, 0] += 1
        laplacian[-1, -1] += 1
    value, vector = np.linalg.eigh(laplacian)
    kernel = (vector * np.exp(variance / 2 * value)) @ vector.T
    return np.asarray(np.clip(kernel, 0, None), dtype=float)


def _convolved(p: FloatArray, kernels: tuple[FloatArray, FloatArray, FloatArray] | None) -> FloatArray:
    """Convolve a belief (letters, angles, rows, columns) along its angle, rows and columns."""
    if kernels is None:
        return p
    turn, down, along = kernels
    moved = np.matmul(down, np.matmul(p, along.T))
    return np.asarray(np.tensordot(moved, turn, axes=(1, 1)).transpose(0, 3, 1, 2), dtype=float)
