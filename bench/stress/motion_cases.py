"""Objects that move between touches, against answers that are known exactly: a Kalman filter, a table of all bins."""

from __future__ import annotations

import numpy as np

from tactsim.bench.stress.case import Worst, case
from tactsim.core import compose, wrap_angle
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import Estimate
from tactsim.estimators.filters.motion import Motion, parse_motion
from tactsim.estimators.filters.moving import MovingBelief
from tactsim.estimators.filters.moving_bins import heat_kernel
from tactsim.estimators.filters.states import WeightedStates, Weights

_READINGS = 12


class ReadPlacement:
    """One letter whose readings are its placement T_O^R itself, [x, y, angle], off by Gaussian noise.

    This is what `MovingBelief` asks of the filter beside it. A belief that moves as the object does is then a Kalman
    filter's. deviation: (3,) mm, mm, rad, of the noise.
    """

    def __init__(self, deviation: FloatArray, motion: Motion, rng: np.random.Generator) -> None:
        self.labels: tuple[str, ...] = ("A",)
        self.located = True
        self.deviation, self.motion, self.rng = deviation, motion, rng
        self.seen: list[FloatArray] = []

    @property
    def touches(self) -> int:
        """Count the readings."""
        return len(self.seen)

    def log_p(self, letter: int, state: FloatArray, touch: int) -> FloatArray:
        """Weigh states (3, n) by one reading: (n,)."""
        away = self.motion.placed(state) * [1, 1, self.motion.ratio] - self.seen[touch]
        away[:, 2] = wrap_angle(away[:, 2])
        density = -0.5 * (away / self.deviation) ** 2 - np.log(self.deviation * np.sqrt(2 * np.pi))
        return np.asarray(density.sum(axis=1), dtype=float)

    def measure(self) -> None:
        """Do nothing: the belief is made of the first reading alone."""

    def own_states(self) -> WeightedStates:
        """Draw the belief after the first reading."""
        place = self.seen[0] + self.rng.standard_normal((20_000, 3)) * self.deviation
        state = self.motion.state(place / [1, 1, self.motion.ratio])
        return WeightedStates(np.zeros(20_000, dtype=np.int64), state, Weights(np.zeros(20_000)))

    def own_estimate(self) -> Estimate:
        """Raise NotImplementedError: an object that is known to move is not estimated at rest."""
        raise NotImplementedError

    def foretold(self, belief: WeightedStates) -> float:
        """Raise NotImplementedError: an object that is known to move is not compared with one at rest."""
        raise NotImplementedError


def kalman(seen: FloatArray, step: FloatArray, deviation: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Filter readings (n, 3) of a random walk whose axes are independent (Kalman 1960).

    step, deviation: (3,) of a step and of a reading. Returns mean, standard deviation, and log p(seen[1:] | seen[0]).
    """
    mean, variance, evidence = seen[0], deviation**2, 0.0
    for one in seen[1:]:
        predicted = variance + step**2
        total = predicted + deviation**2
        evidence += float((-0.5 * (one - mean) ** 2 / total - 0.5 * np.log(2 * np.pi * total)).sum())
        mean = mean + predicted / total * (one - mean)
        variance = predicted * deviation**2 / total
    return mean, np.sqrt(variance), evidence


def walked(step: FloatArray, deviation: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Draw readings (n, 3) of an object that walks from a random place."""
    path = rng.uniform(-5, 5, 3) + np.cumsum(rng.standard_normal((_READINGS, 3)) * step, axis=0)
    return np.asarray(path + rng.standard_normal((_READINGS, 3)) * deviation, dtype=float)


@case(
    "motion.kalman",
    varied="walks of 0.05 to 2 mm and 0.003 to 0.12 rad a touch, readings exact to 0.1 to 1 mm, 12 readings",
    deviation="mean and deviation of the pose from a Kalman filter's, in its deviations, and log evidence, in 10 nats",
    limit=0.5,
    because="several hundred weighted states stand for the belief: chance moves the mean by some tenths at worst",
)
def kalman_filter(worst: Worst) -> None:
    """Follow a placement that is read directly, with Gaussian noise; the exact belief is a Kalman filter's."""
    rng = np.random.default_rng(0)
    for mm in (0.05, 0.5, 2.0):
        for noise in (0.1, 1.0):
            step, deviation = np.array([mm, mm, 0.06 * mm]), np.array([noise, noise, 0.06 * noise])
            motion = parse_motion(f"{mm},{0.06 * mm}")
            assert motion is not None
            generator = np.random.default_rng(1)
            beside = ReadPlacement(deviation, motion, generator)
            moving = MovingBelief(beside, motion)
            moving.reset(generator.spawn(1)[0])
            seen = walked(step, deviation, rng)
            for reading in seen:
                beside.seen.append(reading)
                moving.update()
            mean, spread, evidence = kalman(seen, step, deviation)
            belief = moving.weighted_states()
            place = motion.placed(belief.state) * [1, 1, motion.ratio]
            weight = belief.weights.normalised
            off = wrap_angle(place - mean)[:, 2]
            place[:, 2] = mean[2] + off
            found = weight @ place
            width = np.sqrt(weight @ (place - found) ** 2)
            at = f"walk {mm} mm, readings to {noise} mm"
            worst.see(np.abs(found - mean) / spread, at)
            worst.see(np.abs(np.log(width / spread)), at)
            cloud = moving._clouds[0]
            assert cloud is not None
            worst.see(abs(cloud.log_evidence - evidence) / 10, at)


@case(
    "motion.heat-kernel",
    varied="1 to 40 bins and rings of them, variances of 1e-8 to 100 bins squared",
    deviation="mass, variance far from the ends, and two half steps against one, from what they must be",
    limit=1e-9,
    because="the kernel is the solution of the heat equation on the grid, to rounding",
    quick=True,
)
def heat(worst: Worst) -> None:
    """Check what a kernel on the grid must hold, whatever its size beside a bin."""
    for bins in (1, 2, 3, 16, 40):
        for ring in (False, True) if bins > 2 else (False,):
            for variance in (1e-8, 1e-3, 0.2, 1.0, 100.0):
                at = f"{bins} bins{', a ring' * ring}, variance {variance}"
                kernel = heat_kernel(bins, variance, ring=ring)
                half = heat_kernel(bins, variance / 2, ring=ring)
                worst.see(np.abs(kernel.sum(axis=0) - 1), at)
                worst.see(np.abs(half @ half - kernel), at)
                worst.see(-kernel.min(), at)
                if bins == 40 and variance <= 1:
                    moved = kernel[:, 20] @ (np.arange(40) - 20.0) ** 2
                    worst.see(abs(moved / variance - 1) if variance > 1e-6 else 0, at)


@case(
    "motion.frames",
    varied="placements all over the plane, steps of 1e-9 to 10 mm and rad",
    deviation="mm between states and the same states turned into placements and back; or a step seen in another frame",
    limit=1e-9,
    because="a state and its placement are one pose and its inverse",
    quick=True,
)
def frames(worst: Worst) -> None:
    """Turn states into placements and back, and take a step of the object in the robot's frame."""
    rng = np.random.default_rng(0)
    motion = parse_motion("0.5,0.03")
    assert motion is not None
    state = rng.uniform(-20, 20, (3, 500))
    state[2] = wrap_angle(state[2])
    again = motion.state(motion.placed(state))
    worst.see(np.abs(again[:2] - state[:2]), "there and back")
    worst.see(np.abs(wrap_angle(again[2] - state[2])), "there and back")
    for size in (1e-9, 1e-3, 10.0):
        step = rng.standard_normal(3) * size
        moved = motion.state(motion.placed(state) + step / [1, 1, motion.ratio])
        # Placements T_O^R compose with states T_R^O to nothing, before the step and after.
        nothing = compose((motion.placed(state) * [1, 1, motion.ratio]) + step, moved.T)
        worst.see(np.abs(nothing[:, :2]), f"steps of {size}")
