"""A belief over letter and pose as a sum of Gaussians, one for each mode, and the readings that shape them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactsim.core.compiling import Ints1D, Reals1D, Reals2D, Reals3D, Reals4D, compiled
from tactsim.core.forward import Linearised
from tactsim.core.poses import FloatArray

if TYPE_CHECKING:
    from tactsim.estimators.synthesis.learned_pad import LearnedPad

_OF_READINGS = ("at", "log_p", "gradient", "information")
_OF_MODES = (
    *("letter", "prior_mean", "prior_cov", "log_prior", "merged"), *_OF_READINGS, *("mean", "cov", "log_weight"),
)  # fmt: skip
GYRATION = 8.0  # mm: how far a rad counts where turns are compared with shifts


@dataclass(frozen=True, eq=False)
class Modes:
    """n Gaussian parts of the belief over (letter, T_R^O), after k readings.

    letter: (n,). prior_mean (n, 3), prior_cov (n, 3, 3), log_prior (n,), merged (n,): the part of the prior that each
    stands for, and of how many grid cells. number: (k,) which readings were taken in, in this order. at: (n, k, 3) the
    states at which each was expanded; log_p (n, k), gradient (n, k, 3), information (n, k, 3, 3): its log-likelihood
    there, in x, y and theta of the state. mean: (n, 3), cov: (n, 3, 3), log_weight: (n,) the posterior, of any common
    factor.
    """

    letter: NDArray[np.int64]
    prior_mean: FloatArray
    prior_cov: FloatArray
    log_prior: FloatArray
    merged: NDArray[np.int64]
    number: NDArray[np.int64]
    at: FloatArray
    log_p: FloatArray
    gradient: FloatArray
    information: FloatArray
    mean: FloatArray
    cov: FloatArray
    log_weight: FloatArray

    def __len__(self) -> int:
        return len(self.letter)

    @classmethod
    def begun(
        cls, letter: NDArray[np.int64], states: FloatArray, cov: FloatArray, log_prior: FloatArray
    ) -> Modes:
        """Begin with the cells of a grid, without readings: states (n, 3), the cells' middles; cov (3, 3) of each."""
        n = len(letter)
        every = np.broadcast_to(cov, (n, 3, 3)).copy()
        return cls(
            letter, states, every, log_prior, np.ones(n, dtype=np.int64), np.empty(0, dtype=np.int64),
            np.empty((n, 0, 3)), np.empty((n, 0)), np.empty((n, 0, 3)), np.empty((n, 0, 3, 3)), states, every,
            np.zeros(n),
        )  # fmt: skip

    def some(self, which: NDArray[np.intp]) -> Modes:
        """Take some of the modes."""
        return replace(self, **{name: getattr(self, name)[which] for name in _OF_MODES})

    def joined(self, other: Modes) -> Modes:
        """Put the modes of two beliefs with the same readings together."""
        ours, theirs = self.in_order(), other.in_order()
        both = {name: np.concatenate([getattr(ours, name), getattr(theirs, name)]) for name in _OF_MODES}
        return replace(ours, **both)

    def in_order(self) -> Modes:
        """Put the readings in the order of their numbers."""
        order = np.argsort(self.number)
        ordered = {name: getattr(self, name)[:, order] for name in _OF_READINGS}
        return replace(self, number=self.number[order], **ordered)

    def with_reading(
        self, number: int, at: FloatArray, log_p: FloatArray, gradient: FloatArray, information: FloatArray
    ) -> Modes:
        """Append a reading, expanded at the states `at` (n, 3)."""
        return replace(
            self,
            number=np.append(self.number, number),
            at=np.concatenate([self.at, at[:, None]], axis=1),
            log_p=np.concatenate([self.log_p, log_p[:, None]], axis=1),
            gradient=np.concatenate([self.gradient, gradient[:, None]], axis=1),
            information=np.concatenate([self.information, information[:, None]], axis=1),
        )

    def posterior(self, floor: FloatArray) -> Modes:
        """Find mean, covariance and weight of each mode: prior times readings, a Gaussian.

        floor: of all readings, the log-density of each as an outlier. A reading that is less likely than that at the
        mean that all of them give counts as one.
        """
        return self._solved(floor, doubt=False)._solved(floor, doubt=True)

    def _solved(self, floor: FloatArray, *, doubt: bool) -> Modes:
        prior = Gaussians(self.prior_mean, self.prior_cov, self.log_prior)
        readings = Expansions(self.at, self.log_p, self.gradient, self.information)
        result = Gaussians(*(np.empty_like(values) for values in (self.mean, self.cov, self.log_weight)))
        solve_modes(prior, readings, floor[self.number], self.mean, doubt, result)
        return replace(self, **result._asdict())

    def log_p_of_readings(self) -> FloatArray:
        """Give the log-likelihood (n, k) of the readings at the modes' means."""
        away = self.mean[:, None] - self.at
        bent = np.einsum("nkij,nkj->nki", self.information, away)
        return self.log_p + np.einsum("nki,nki->nk", self.gradient - bent / 2, away)

    def heaviest(self, count: int, within: float) -> Modes:
        """Keep the `count` heaviest modes, and of those what is at most `within` nats below the heaviest.

        What is as heavy as the last one is kept, too: letters that are alike lose the same modes.
        """
        weight = np.sort(self.log_weight)[::-1]
        least = max(weight[min(count, len(weight)) - 1], weight[0] - within)
        return self.some(np.flatnonzero(self.log_weight >= least))

    def together(self, apart: float) -> Modes:
        """Merge modes of one letter whose means are less than `apart` of their standard deviations apart.

        What is merged keeps the heavier one's readings, and the mean and covariance of both parts of the prior.
        """
        order = np.argsort(-self.log_weight, kind="stable")
        taken = np.zeros(len(self), dtype=bool)
        precision = np.linalg.inv(self.cov)
        heads, prior_mean, prior_cov, log_prior, merged = [], [], [], [], []
        for head in order.tolist():
            if taken[head]:
                continue
            away = self.mean - self.mean[head]
            turns = np.round(away[:, 2] / (2 * math.pi)) * 2 * math.pi
            away[:, 2] -= turns
            near = (self.letter == self.letter[head]) & ~taken
            near &= np.einsum("ni,ij,nj->n", away, precision[head], away) < apart**2
            near &= np.einsum("ni,nij,nj->n", away, precision, away) < apart**2
            near[head] = True
            group = np.flatnonzero(near)
            taken[group] = True
            count = self.merged[group]
            share = count / count.sum()
            means = self.prior_mean[group].copy()
            means[:, 2] -= turns[group]
            middle = share @ means
            apart_from = means - middle
            heads.append(head)
            merged.append(count.sum())
            prior_mean.append(middle)
            prior_cov.append(
                np.einsum("n,nij->ij", share, self.prior_cov[group])
                + np.einsum("n,ni,nj->ij", share, apart_from, apart_from)
            )
            log_prior.append(np.logaddexp.reduce(self.log_prior[group]))
        if len(heads) == len(self):
            return self
        return replace(
            self.some(np.array(heads)),
            prior_mean=np.array(prior_mean),
            prior_cov=np.array(prior_cov),
            log_prior=np.array(log_prior),
            merged=np.array(merged),
        )

    def moved(self) -> FloatArray:
        """Tell how far each mode's mean is from where each reading was expanded, (n, k) mm."""
        away = self.mean[:, None] - self.at
        away[..., 2] *= GYRATION
        return np.sqrt((away**2).sum(axis=-1))

    def expanded_again(
        self,
        mode: NDArray[np.intp],
        column: NDArray[np.intp],
        log_p: FloatArray,
        gradient: FloatArray,
        information: FloatArray,
    ) -> Modes:
        """Replace the expansions of some readings (column) of some modes by ones at the modes' means."""
        result = replace(self, **{name: getattr(self, name).copy() for name in _OF_READINGS})
        result.at[mode, column] = self.mean[mode]
        result.log_p[mode, column] = log_p
        result.gradient[mode, column] = gradient
        result.information[mode, column] = information
        return result


def sensor_motion(state: FloatArray, sensor_in_robot: FloatArray) -> FloatArray:
    """Give how the sensor moves along its own axes and turns, (n, 3, 3), when x, y and theta of T_R^O (n, 3) change."""
    turned, (x, y, angle) = state[:, 2], sensor_in_robot.T
    cos, sin = np.cos(turned), np.sin(turned)
    arm_x, arm_y = -sin * x - cos * y, cos * x - sin * y  # by a turn of the state about the robot's origin
    cos, sin = np.cos(turned + angle), np.sin(turned + angle)
    motion = np.zeros((len(state), 3, 3))
    motion[:, 0, 0], motion[:, 0, 1], motion[:, 0, 2] = cos, sin, cos * arm_x + sin * arm_y
    motion[:, 1, 0], motion[:, 1, 1], motion[:, 1, 2] = -sin, cos, -sin * arm_x + cos * arm_y
    motion[:, 2, 2] = 1
    return motion


class Gaussians(NamedTuple):
    """n weighted Gaussians: mean (n, 3), cov (n, 3, 3), log_weight (n,)."""

    mean: Reals2D
    cov: Reals3D
    log_weight: Reals1D


class Expansions(NamedTuple):
    """The log-likelihoods of k readings around n states, to the second order, as `Modes` holds them."""

    at: Reals3D
    log_p: Reals2D
    gradient: Reals3D
    information: Reals4D


@compiled(called_from_python=False)
def invert_3(matrix: Reals2D, inverse: Reals2D) -> float:
    """Invert a symmetric positive definite matrix (3, 3); returns its determinant."""
    a, b, c = matrix[0, 0], matrix[0, 1], matrix[0, 2]
    d, e, f = matrix[1, 1], matrix[1, 2], matrix[2, 2]
    aa, bb, cc = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = a * aa + b * bb + c * cc
    inverse[0, 0] = aa / determinant
    inverse[0, 1] = inverse[1, 0] = bb / determinant
    inverse[0, 2] = inverse[2, 0] = cc / determinant
    inverse[1, 1] = (a * f - c * c) / determinant
    inverse[1, 2] = inverse[2, 1] = (b * c - a * e) / determinant
    inverse[2, 2] = (a * d - b * b) / determinant
    return determinant


@compiled()
def solve_modes(
    prior: Gaussians, readings: Expansions, floor: Reals1D, now: Reals2D, doubt: bool, result: Gaussians
) -> None:
    """Multiply the Gaussian priors of n modes with the expanded likelihoods of k readings; fills result.

    floor: (k,) the log-density of each reading as an outlier. now: (n, 3) where the modes are. If `doubt`, a reading
    that is less likely than its floor there is one, and says nothing of the pose.
    """
    precision, of_prior, inverse = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    away, slope, step, bent = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for n in range(len(prior.log_weight)):
        from_prior = now[n] - prior.mean[n]
        prior_det = invert_3(prior.cov[n], of_prior)
        value = prior.log_weight[n]
        for i in range(3):
            slope[i] = 0.0
            for j in range(3):
                precision[i, j] = of_prior[i, j]
                slope[i] -= of_prior[i, j] * from_prior[j]
            value += slope[i] * from_prior[i] / 2
        for k in range(len(floor)):
            here = readings.log_p[n, k]
            for i in range(3):
                away[i] = now[n, i] - readings.at[n, k, i]
            for i in range(3):
                bent[i] = 0.0
                for j in range(3):
                    bent[i] += readings.information[n, k, i, j] * away[j]
                here += (readings.gradient[n, k, i] - bent[i] / 2) * away[i]
            if doubt and here < floor[k]:
                value += floor[k]
                continue
            value += here
            for i in range(3):
                slope[i] += readings.gradient[n, k, i] - bent[i]
                for j in range(3):
                    precision[i, j] += readings.information[n, k, i, j]
        determinant = invert_3(precision, inverse)
        for i in range(3):
            step[i] = 0.0
            for j in range(3):
                step[i] += inverse[i, j] * slope[j]
                result.cov[n, i, j] = inverse[i, j]
        for i in range(3):
            result.mean[n, i] = now[n, i] + step[i]
            value += slope[i] * step[i] / 2
        result.log_weight[n] = value - 0.5 * math.log(prior_det * determinant)


# How often a press is predicted anew, if in place, tilt or load it is off by so many standard deviations more than was
# taken; and at most by so many.
_PRESSES, _OFF, FARTHEST = 2, 0.7, 3.0

# Predicts the readings of the states `which` (m,), all of the letter of this number.
Predict = Callable[[int, NDArray[np.intp]], Linearised]


def pressed(
    pad: LearnedPad,
    labels: Sequence[str],
    sensor_in_object: FloatArray,
    readings: FloatArray,
    number: NDArray[np.int64],
) -> Predict:
    """Predict readings `number` (n,) of (r, taxels) kPa by presses at sensor_in_object (n, 3).

    A press is predicted as it most probably was: its place, tilt and load are searched for with the pose held
    (Laplace's approximation, by Gauss and Newton).
    """

    def predict(one: int, which: NDArray[np.intp]) -> Linearised:
        label, poses, felt = labels[one], sensor_in_object[which], readings[number[which]]
        found = pad.linearised(label, poses)
        off = np.zeros(found.nuisance.shape[:2])
        for _ in range(_PRESSES):
            likely = likeliest_press(felt, found.mean, found.nuisance, pad.noise, pad.failing)
            again = np.flatnonzero(np.abs(likely - off).max(axis=1, initial=0) > _OFF)
            if not len(again):
                break
            off[again] = likely[again].clip(-FARTHEST, FARTHEST)
            found = found.with_rows(again, pad.linearised(label, poses[again], off[again]), off[again])
        return found

    return predict


def expand(
    letter: NDArray[np.int64],
    state: FloatArray,
    sensor_in_robot: FloatArray,
    readings: FloatArray,
    number: NDArray[np.int64],
    predict: Predict,
    noise: float,
    failing: float = 0.0,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Expand readings at states T_R^O (n, 3): log p (n,), its gradient (n, 3) and its information (n, 3, 3).

    letter: (n,) numbers. sensor_in_robot: (n, 3), where they were taken. readings: (r, taxels) kPa, of which `number`
    (n,) says the one for each state. noise: kPa, standard deviation of a taxel. failing: the probability that a taxel
    reads anything.
    """
    n = len(letter)
    log_p = np.empty(n)
    gradient, information = np.empty((n, 3)), np.empty((n, 3, 3))
    for one in np.unique(letter).tolist():
        which = np.flatnonzero(letter == one)
        found = predict(one, which)
        log_p[which], gradient[which], information[which] = expand_all(
            readings, number[which], found.mean, found.by_pose, found.nuisance, noise, failing
        )
    motion = sensor_motion(state, sensor_in_robot)
    return (
        log_p,
        np.einsum("ni,nij->nj", gradient, motion),
        motion.transpose(0, 2, 1) @ information @ motion,
    )


_SETTLING = 8  # how often it is asked, at most, which taxels fail
_FAR = 1.5  # standard deviations of what is left: a taxel that is farther off may fail


@compiled(called_from_python=False)
def fit_press(
    z: Reals1D, mean: Reals1D, rows: Reals2D, noise: float, weight: Reals1D,
    factor: Reals2D, off: Reals1D, left: Reals1D,
) -> float:  # fmt: skip
    """Find how a press most probably was off in some ways, from weighted taxels; returns half the log-determinant.

    z, mean: (taxels,) kPa, what was read and is predicted. rows: (q, taxels) kPa, of one standard deviation in each
    way. factor: (q, q) becomes Cholesky's factor of 1 + rows weight rows.T / noise^2. off: (q,) standard deviations.
    left: (taxels,) what is left of the reading, over the noise.
    """
    taxels, q = len(z), len(rows)
    log_det = 0.0
    for a in range(q):
        off[a] = 0.0
        for t in range(taxels):
            off[a] += weight[t] * rows[a, t] * (z[t] - mean[t]) / noise**2
        for b in range(a + 1):
            total = 1.0 if a == b else 0.0
            for t in range(taxels):
                total += weight[t] * rows[a, t] * rows[b, t] / noise**2
            for k in range(b):
                total -= factor[a, k] * factor[b, k]
            factor[a, b] = math.sqrt(total) if a == b else total / factor[b, b]
        log_det += math.log(factor[a, a])
        for k in range(a):
            off[a] -= factor[a, k] * off[k]
        off[a] /= factor[a, a]
    for a in range(q - 1, -1, -1):
        for k in range(a + 1, q):
            off[a] -= factor[k, a] * off[k]
        off[a] /= factor[a, a]
    for t in range(taxels):
        total = z[t] - mean[t]
        for a in range(q):
            total -= off[a] * rows[a, t]
        left[t] = total / noise
    return log_det


@compiled(called_from_python=False)
def find_failing(
    z: Reals1D, mean: Reals1D, nuisance: Reals2D, noise: float, failing: float,
    factor: Reals2D, off: Reals1D, left: Reals1D, weight: Reals1D,
) -> None:  # fmt: skip
    """Find how probably each taxel of a press does not fail, weight (taxels,), by iterated least squares.

    Until that settles, one fails that is farther off than a reading of anything is less probable. At first those are
    taken that are as predicted, at a factor of 1, the last nuisance; if less than half, all, and the limit is wide.
    """
    weight[:] = 1.0
    if failing == 0:
        return
    taxels = len(z)
    span = z.max() - z.min() + 4 * noise
    limit = 2 * max(math.log((1 - failing) / failing * span / (noise * math.sqrt(2 * math.pi))), 0.0)
    for t in range(taxels):
        variance = noise**2
        for a in range(len(nuisance) - 1):
            variance += nuisance[a, t] ** 2
        weight[t] = (z[t] - mean[t]) ** 2 <= limit * variance
    if 2 * weight.sum() < taxels:
        weight[:] = 1.0
    now = limit
    for _ in range(_SETTLING):
        fit_press(z, mean, nuisance, noise, weight, factor, off, left)
        now = max(limit, _FAR**2 * (weight * left**2).sum() / max(weight.sum(), 1.0))
        inside = (left**2 <= now).astype(np.float64)
        if (inside == weight).all():
            break
        weight[:] = inside
    for t in range(taxels):
        weight[t] = 1 / (1 + math.exp(min((left[t] ** 2 - now) / 2, 700.0)))


@compiled()
def likeliest_press(
    reading: Reals2D, mean: Reals2D, nuisance: Reals3D, noise: float, failing: float
) -> Reals2D:
    """Find by how many standard deviations n presses most probably were off, (n, q), to first order.

    reading: (n, taxels) kPa. mean, nuisance: as in `Linearised`. noise, failing: as in `expand_all`.
    """
    taxels, q = mean.shape[1], nuisance.shape[1]
    off, left = np.empty((len(mean), q)), np.empty(taxels)
    factor, weight = np.empty((q, q)), np.empty(taxels)
    for n in range(len(mean)):
        find_failing(reading[n], mean[n], nuisance[n], noise, failing, factor, off[n], left, weight)
        fit_press(reading[n], mean[n], nuisance[n], noise, weight, factor, off[n], left)
    return off


@compiled()
def expand_all(
    reading: Reals2D, which: Ints1D, mean: Reals2D, by_pose: Reals3D, nuisance: Reals3D,
    noise: float, failing: float,
) -> tuple[Reals1D, Reals2D, Reals3D]:  # fmt: skip
    """Expand log N(z; mean, noise^2 1 + nuisance.T nuisance) in the pose, to second order, for n predictions.

    reading: (m, taxels) kPa, of which prediction i is compared with number which[i]. mean: (n, taxels), by_pose:
    (n, 3, taxels), nuisance: (n, q, taxels), as in `Linearised`. failing: the probability that a taxel reads anything
    in the range of the press's readings; each counts by the probability that it does not. The inverse of the covariance
    follows from a matrix q by q (Woodbury 1950), and what changes it with the pose is left out (Gauss and Newton).
    Returns log p (n,) at the pose, its gradient (n, 3) and its information (n, 3, 3).
    """
    log_p, gradient = np.empty(len(mean)), np.empty((len(mean), 3))
    information = np.empty((len(mean), 3, 3))
    taxels, q = mean.shape[1], nuisance.shape[1]
    mixed = np.empty((3, q))  # nuisance times the three derivatives
    factor, off, left, weight = np.empty((q, q)), np.empty(q), np.empty(taxels), np.empty(taxels)
    constant = math.log(1 - failing) - 0.5 * math.log(2 * math.pi * noise * noise)
    for n in range(len(mean)):
        z = reading[which[n]]
        find_failing(z, mean[n], nuisance[n], noise, failing, factor, off, left, weight)
        value = -fit_press(z, mean[n], nuisance[n], noise, weight, factor, off, left)
        for a in range(q):
            value -= off[a] ** 2 / 2
            for i in range(3):
                total = 0.0
                for t in range(taxels):
                    total += weight[t] * nuisance[n, a, t] * by_pose[n, i, t]
                total /= noise**2
                for k in range(a):
                    total -= factor[a, k] * mixed[i, k]
                mixed[i, a] = total / factor[a, a]
        failed = -math.inf if failing == 0 else math.log(failing / (z.max() - z.min() + 4 * noise))
        for t in range(taxels):
            value += np.logaddexp(constant - left[t] ** 2 / 2, failed)
        log_p[n] = value
        for i in range(3):
            total = 0.0
            for t in range(taxels):
                total += weight[t] * by_pose[n, i, t] * left[t]
            gradient[n, i] = total / noise
            for j in range(i + 1):
                total = 0.0
                for t in range(taxels):
                    total += weight[t] * by_pose[n, i, t] * by_pose[n, j, t]
                total /= noise**2
                for a in range(q):
                    total -= mixed[i, a] * mixed[j, a]
                information[n, i, j] = information[n, j, i] = total
    return log_p, gradient, information
