"""How far an object may move between two touches, as the option `motion` says it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tactsim.core import InputError, invert
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import PoseSamples

# rad for each mm: a point 16 mm from the middle, the tip of a letter of 25 mm, then moves as far by turning.
_RATIO = 0.06
_SCALES = (0.15, 0.5, 1.5)  # mm, of the bank from which the motion is learned
_JUMP, _JUMPS = 4.0, 0.001  # mm, standard deviation of a jump along an axis, and how often one comes
# The prior probability that the object lies still at first, and how often one at rest begins to move: seldom, as one
# misplaced press may speak for a jump by some six nats; after a jump of 5 mm three touches mostly do so by ten.
_STILL, _BEGINS = 0.9, 0.00025
_SWITCH = 0.02  # how often the scale changes from one touch to the next
# The prior of rest and of each scale in regions, until a motion is seen: no belief about objects, but one with which
# regions of what lies still hold about as much more than they say as those of what walks hold less. Few touches cannot
# tell.
_FELT = (0.25, 0.05, 0.45, 0.25)
_WALKED = 512  # samples of a belief that may have walked
_LEAST = 0.01, 0.0006  # mm, rad: densities need a width


@dataclass(frozen=True, eq=False)
class Motion:
    """The motion of an object between two touches: a random walk of one of several scales, and jumps.

    ratio: rad that count as 1 mm. variance: (scales,) mm^2 along each axis. prior: (scales,) their probabilities
    given that it moves. switch: probability that the scale is drawn anew. jump, jump_variance: probability and
    mm^2. still: the prior probability that it lies still at first; None if it is known to move. begins: probability
    that it begins to move before a touch.
    """

    ratio: float
    variance: FloatArray
    prior: FloatArray
    switch: float
    jump: float
    jump_variance: float
    still: float | None
    begins: float = 0.0

    @property
    def around(self) -> float:
        """Give the length of the circle of angles, mm."""
        return 2 * math.pi / self.ratio

    def placed(self, state: FloatArray) -> FloatArray:
        """Turn states T_R^O (3, n) into placements (n, 3) [x, y, angle / ratio] mm of T_O^R."""
        return np.asarray(invert(state.T) / [1, 1, self.ratio], dtype=float)

    def state(self, placement: FloatArray) -> FloatArray:
        """Undo `placed`."""
        return np.ascontiguousarray(invert(placement * [1, 1, self.ratio]).T)

    def shares(self, readings: int, place: FloatArray, log_p: FloatArray, shown: float) -> FloatArray:
        """Weigh rest and a walk of each scale by where each of n readings pulls: (1 + scales,), sum 1.

        place: (k, 3) T_O^R mm, mm, rad, equally probable states of the belief at rest. log_p: (m, k) of its last m
        readings. shown: what `Trust.shown` says of n. In each axis of the belief a reading alone says a place that errs
        by n times the belief's variance. The discrete cosines are the principal components of a random walk: along the
        k-th of m it has 1 / 4 sin^2(pi k / 2m) of a step's variance.
        """
        away = place / [1, 1, self.ratio] - place[0] / [1, 1, self.ratio]
        away[:, 2] -= self.around * np.rint(away[:, 2] / self.around)
        away -= away.mean(axis=0)
        spread, axes = np.linalg.eigh(away.T @ away / len(away))
        spread = np.maximum(spread, _LEAST[0] ** 2)
        pulled = math.sqrt(shown) * readings * log_p @ away @ axes / len(away)
        waves = math.pi * np.arange(1, len(log_p)) / len(log_p)
        along = np.cos(np.outer(waves, np.arange(len(log_p)) + 0.5)) @ pulled * math.sqrt(2 / len(log_p))
        walk = np.append(0.0, self.variance)[:, None, None] / (4 * np.sin(waves / 2) ** 2)[:, None]
        errs = readings * spread + walk
        share = np.log(_FELT) - 0.5 * (np.log(errs) + along**2 / errs).sum(axis=(1, 2))
        share = np.exp(share - share.max())
        return np.asarray(share / share.sum(), dtype=float)

    def walked(self, samples: PoseSamples, shares: FloatArray, readings: int) -> PoseSamples:
        """Mix a belief of rest with where the object is if it walked: as far from there as from the mean of n places.

        shares: of rest and of each scale. The last place of a walk has about the mean of all the variance of a step
        times (n - 1) (2n - 1) / 6n.
        """
        rng = np.random.default_rng(0)  # the same however often an estimate is asked for
        count = np.rint(_WALKED * shares[1:] / max(shares[1:].sum(), 1e-9)).astype(int)
        reached = (readings - 1) * (2 * readings - 1) / (6 * readings)
        width = np.sqrt(np.repeat(self.variance, count) * reached)
        chosen = rng.choice(len(samples.weights), len(width), p=samples.weights / samples.weights.sum())
        place = self.placed(samples.poses[chosen].T) + rng.standard_normal((len(width), 3)) * width[:, None]
        return PoseSamples(
            np.concatenate([samples.poses, self.state(place).T]),
            np.append(samples.weights * shares[0], np.full(len(width), (1 - shares[0]) / max(len(width), 1))),
        )


def parse_motion(text: str) -> Motion | None:
    """Read `off` (None), `auto` or the deviations of a random walk, as MM,RAD such as 0.5,0.03.

    Zero and zero is `off`. Raises InputError for anything else.
    """
    if text == "off":
        return None
    if text == "auto":
        scales = np.array(_SCALES)
        even = np.full(len(scales), 1 / len(scales))
        return Motion(_RATIO, scales**2, even, _SWITCH, _JUMPS, _JUMP**2, _STILL, _BEGINS)
    try:
        mm, rad = (float(word) for word in text.split(","))
    except ValueError:
        mm = rad = math.nan
    if not (0 <= mm <= 100 and 0 <= rad <= 3.2):
        raise InputError(
            f"motion {text!r} is not off, auto or a random walk's deviations such as 0.5,0.03 (mm, rad)"
        )
    if mm == rad == 0:
        return None
    mm, rad = max(mm, _LEAST[0]), max(rad, _LEAST[1])
    return Motion(rad / mm, np.array([mm**2]), np.ones(1), 0.0, 0.0, 1.0, None)
