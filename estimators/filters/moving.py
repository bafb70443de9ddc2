"""A filter around which the object may move: a belief that is moved between touches, beside the one that lies still."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import Estimate, PlaneBelief, PoseSamples
from tactsim.estimators.field.field import LikelihoodField
from tactsim.estimators.filters.map_filter import MapFilter
from tactsim.estimators.filters.mixture import add_densities
from tactsim.estimators.filters.motion import EVIDENCE, Motion
from tactsim.estimators.filters.placement import mean_around
from tactsim.estimators.filters.states import WeightedStates, plane_histogram, pose_samples, probabilities
from tactsim.estimators.filters.weights import Weights
from tactsim.estimators.filters.wrapper import Wrapper

_CENTRES = 240  # of a letter's belief that is moved, and of each round of proposals
_DRAWN = 600  # states of a letter in a round; at the second reading, when the belief is broad, _BROAD times as many
_BROAD = 5
_ROUNDS = 4
_ENOUGH = 60.0  # effective states that a round aims at
_FORGOTTEN = 30.0  # a letter this many nats below the best is not followed any more
_NEGLIGIBLE = 20.0
_JUMPING = 24  # centres from which jumps go out
_TINY = np.finfo(float).tiny
# Of the draws, beside the share that is believed: for each scale, and for jumps, which have far to look.
_LEAST_SHARE, _JUMP_SHARE = 0.1, 0.4


@dataclass(frozen=True, eq=False)
class _Cloud:
    """What is believed of one letter if it moves: weighted placements, for each scale of the motion.

    centre: (n, 3) [x, y, angle / ratio] mm of T_O^R. spread: (n,) mm^2, how far around a centre its weight lies.
    log_weight: (n, scales), log p(placement, scale | letter, readings), summing to 1.
    log_evidence: log p(readings | letter).
    """

    centre: FloatArray
    spread: FloatArray
    log_weight: FloatArray
    log_evidence: float


@dataclass(frozen=True, eq=False)
class _Drawn:
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

    centre: (n, 3) mm. spread: (n,) mm^2. weight: (n, scales + 1). variance: (scales + 1,) mm^2. around: mm, the
    length of the circle of angles.
    """

    centre: FloatArray
    spread: FloatArray
    weight: FloatArray
    variance: FloatArray
    around: float

    @classmethod
    def of(cls, cloud: _Cloud, weight: FloatArray, motion: Motion, rng: np.random.Generator) -> _Moved:
        """Move a cloud whose centres have a weight for each scale (n, scales)."""
        stay = np.column_stack([weight * (1 - motion.jump), np.zeros(len(weight))])
        variance = np.append(motion.variance, motion.jump_variance)
        if not motion.jump:
            return cls(cloud.centre, cloud.spread, stay, variance, motion.around)
        # A jump is so wide that few centres will do.
        chosen = Weights(_log(weight.sum(axis=1))).systematic(_JUMPING, rng)
        jump = np.zeros((_JUMPING, len(variance)))
        jump[:, -1] = motion.jump * weight.sum() / _JUMPING
        return cls(
            np.concatenate([cloud.centre, cloud.centre[chosen]]),
            np.concatenate([cloud.spread, cloud.spread[chosen]]),
            np.concatenate([stay, jump]), variance, motion.around,
        )  # fmt: skip

    @cached_property
    def share(self) -> FloatArray:
        """Give the part of the draws that each mixture gets: one that is hardly believed gets enough to be found."""
        held = self.weight.sum(axis=0)
        share = held / held.sum() + _LEAST_SHARE * (held > 0)
        share[-1] += _JUMP_SHARE * (held[-1] > 0)
        return np.asarray(share / share.sum(), dtype=float)

    def draw(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Draw placements (count, 3), from each mixture its share."""
        which = rng.choice(len(self.variance), size=count, p=self.share)
        centre = np.empty(count, dtype=np.int64)
        for k in np.unique(which):
            mine = np.flatnonzero(which == k)
            centre[mine] = Weights(_log(self.weight[:, k])).systematic(len(mine), rng)
        width = np.sqrt(self.variance[which] + self.spread[centre])
        return self.centre[centre] + rng.standard_normal((count, 3)) * width[:, None]

    def densities(self, place: FloatArray) -> FloatArray:
        """Give the density of each mixture at placements (n, 3): (n, mixtures), mm^-3."""
        density = np.zeros((len(place), len(self.variance)))
        add_densities(
            density, place, self.centre, np.ascontiguousarray(self.weight), self.variance,
            self.spread, self.around,
        )  # fmt: skip
        return density

    def offered(self, density: FloatArray) -> FloatArray:
        """Turn `densities` (n, mixtures) into the density (n,) with which `draw` draws."""
        held = self.weight.sum(axis=0)
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
            density, place, self.centre, np.full((count, 1), float(self.count // count)), np.array([self.width**2]),
            np.zeros(count), self.around,
        )  # fmt: skip
        return density[:, 0]


class Moving(Wrapper):
    """A filter, and beside it one for an object that moves between touches.

    The moving belief is a mixture of normal distributions over placements. Between readings it is widened by the
    motion. Then states are drawn from it, weighed by the last reading alone, and drawn again around the better
    ones, in rounds, as the reading is taken in little by little: adaptive importance sampling (Cappe et al. 2004;
    weights by the mixture of all rounds, Cornuet et al. 2012).

    How far the object moves is learned, if it is not given: each scale of a bank, from lying still on, has the
    probability that the readings so far give it.
    """

    def __init__(self, filter: MapFilter, motion: Motion) -> None:
        super().__init__(filter)
        self._motion = motion
        self._evaluated = 0

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the sequence."""
        self.filter.reset(rng)
        self._rng = rng.spawn(1)[0]
        self._clouds: list[_Cloud | None] = []
        self._past: list[list[_Cloud | None]] = []
        self._drawn: list[_Drawn | None] = []

    def update(self, reading: ArrayLike, sensor_in_robot: ArrayLike) -> None:
        """Take in one reading (taxels,) kPa at the pose sensor_in_robot [mm, mm, rad]."""
        field: LikelihoodField = self.filter.field
        if self._motion.still is None and len(field):
            self.filter.take(reading, sensor_in_robot)
        else:
            self.filter.update(reading, sensor_in_robot)
        if len(field) == 1:
            self._begin()
            return
        self._past.append(self._clouds)
        self._clouds = list(self._clouds)
        best = max(cloud.log_evidence for cloud in self._clouds if cloud is not None)
        for letter, cloud in enumerate(self._clouds):
            if cloud is None or cloud.log_evidence < best - _FORGOTTEN:
                self._clouds[letter] = self._drawn[letter] = None
            else:
                self._clouds[letter], self._drawn[letter] = self._advance(letter, cloud)

    def _begin(self) -> None:
        """Take over what the filter holds after the first reading: nothing has moved yet."""
        belief, motion = self.filter.weighted_states(), self._motion
        evidence = self.filter.log_evidence()
        self._clouds, self._drawn = [], []
        for letter in range(len(self.labels)):
            mine = np.flatnonzero(belief.letter == letter)
            if not len(mine):
                self._clouds.append(None)
                self._drawn.append(None)
                continue
            weights = Weights(belief.weights.log[mine])
            chosen = mine[weights.systematic(_BROAD * _CENTRES, self._rng)]
            state = belief.state[:, chosen]
            size = belief.size[:, chosen] if belief.size is not None else np.zeros_like(state)
            state = state + self._rng.uniform(-0.5, 0.5, state.shape) * size
            spread = (size[0] * size[1] * size[2] / motion.ratio) ** (2 / 3) / 12
            share = np.log(motion.prior) - math.log(len(chosen))
            self._clouds.append(
                _Cloud(
                    motion.placed(state), spread, np.tile(share, (len(chosen), 1)), float(evidence[letter])
                )
            )
            self._drawn.append(_Drawn(state, np.zeros(len(chosen)), np.zeros(len(chosen))))

    def _advance(self, letter: int, cloud: _Cloud) -> tuple[_Cloud, _Drawn]:
        """Move a letter's belief and take in the last reading."""
        motion = self._motion
        before = np.exp(cloud.log_weight)
        weight = (1 - motion.switch) * before + motion.switch * before.sum(
            axis=1, keepdims=True
        ) * motion.prior
        moved = _Moved.of(cloud, weight, motion, self._rng)
        count = _DRAWN * (_BROAD if len(self.filter.field) == 2 else 1)
        place = moved.draw(count, self._rng)
        density, log_p = moved.densities(place), self._log_p(letter, place)
        offered, rounds = count * moved.offered(density), []
        for number in range(_ROUNDS):
            base = _log(density.sum(axis=1)) - np.log(offered + _TINY)
            power = _next_power(base, log_p)
            if power == 1 and number > 0:
                break
            around = place[Weights(base + power * log_p).systematic(_CENTRES // 3, self._rng)]
            rounds.append(_Round(around, _spacing(around, motion.around), _DRAWN // 2, motion.around))
            fresh = rounds[-1].draw(self._rng)
            offered = np.append(offered + rounds[-1].offered(place), np.zeros(len(fresh)))
            place, log_p = np.concatenate([place, fresh]), np.append(log_p, self._log_p(letter, fresh))
            density = np.concatenate([density, moved.densities(fresh)])
            new = slice(-len(fresh), None)
            offered[new] = count * moved.offered(density[new]) + sum(one.offered(fresh) for one in rounds)
        log_density = _log(density.sum(axis=1)) + log_p
        weights = Weights(log_density - np.log(offered + _TINY))
        drawn = _Drawn(motion.state(place), weights.log, log_density)

        chosen = weights.systematic(_CENTRES, self._rng)
        scales = len(motion.variance)
        share = moved.weight.sum(axis=0)
        # What jumped has the scales that its letter has.
        by_scale = density[chosen, :scales] + density[chosen, scales:] * weight.sum(axis=0) / weight.sum()
        by_scale /= by_scale.sum(axis=1, keepdims=True) * len(chosen)
        gain = by_scale.sum(axis=0) / weight.sum(axis=0)
        log_weight = _log(by_scale) + (EVIDENCE - 1) * np.log(np.maximum(gain, _TINY))
        log_weight -= np.log(np.exp(log_weight).sum())
        evidence = cloud.log_evidence + weights.log_mean + math.log(len(weights)) - math.log(share.sum())
        return _Cloud(place[chosen], np.zeros(len(chosen)), log_weight, evidence), drawn

    def _log_p(self, letter: int, place: FloatArray) -> FloatArray:
        """Weigh placements by the last reading: (n,)."""
        self._evaluated += len(place)
        return self.filter.field.log_p(letter, self._motion.state(place), len(self.filter.field) - 1)

    def estimate(self) -> Estimate:
        """Sum the models for each letter; take the pose from the likelier model of the best letter."""
        if len(self.filter.field) < 2:
            return self.filter.estimate()
        models = self._models()
        known = self.filter.estimate() if self._motion.still is not None else None
        # A letter that neither belief is about has no pose to state.
        stated = [
            one is not None or (known is not None and label == known.label)
            for label, one in zip(self.labels, self._drawn, strict=True)
        ]
        mass = np.where(stated, models.sum(axis=0), 0.0)
        best = int(mass.argmax())
        drawn, parts, poses = self._drawn[best], [], []
        if known is not None and known.label == self.labels[best]:
            poses.append((models[0, best], known.robot_in_object))
            parts.append((models[0, best], known.samples))
        if drawn is not None:
            state, weights, mode = drawn.heavy()
            poses.append((models[1, best], mean_around(state, weights, mode)))
            parts.append((models[1, best], pose_samples(state, weights)))
        pose = max(poses, key=lambda one: one[0])[1]
        return Estimate(
            self.labels[best], probabilities(self.labels, models.sum(axis=0)), pose, _mixed(parts)
        )

    def path(self, estimate: Estimate) -> FloatArray:
        """Give robot_in_object at each touch so far (n, 3), for the letter and the last pose of an estimate.

        From the last pose back, each pose is the centre that explains best its own reading and the step to its
        successor. All poses are the last one where the object is more probably still.
        """
        letter, count = self.labels.index(estimate.label), len(self.filter.field)
        poses = np.tile(estimate.robot_in_object, (count, 1))
        if count < 2 or self._drawn[letter] is None:
            return poses
        models = self._models()
        if models[0, letter] > models[1, letter]:
            return poses
        motion, later = self._motion, self._motion.placed(poses[-1:].T)[0]
        for touch in range(count - 2, -1, -1):
            cloud = self._past[touch][letter]
            if cloud is None:
                break
            step = cloud.centre - later
            step[:, 2] -= motion.around * np.rint(step[:, 2] / motion.around)
            variance = np.append(motion.variance, motion.jump_variance) + cloud.spread[:, None]
            weight = np.append(np.log(1 - motion.jump) + np.zeros(len(motion.variance)), _log(motion.jump))
            held = np.column_stack([cloud.log_weight, np.logaddexp.reduce(cloud.log_weight, axis=1)])
            reached = held + weight - 1.5 * np.log(variance) - 0.5 * (step**2).sum(axis=1)[:, None] / variance
            own = self.filter.field.log_p(letter, motion.state(cloud.centre), touch, touch + 1)
            later = cloud.centre[int((reached.max(axis=1) + own).argmax())]
            poses[touch] = motion.state(later[None])[:, 0]
        return poses

    def weighted_states(self) -> WeightedStates:
        """Give the states of both models."""
        if len(self.filter.field) < 2:
            return self.filter.weighted_states()
        models, parts = self._models(), []
        if self._motion.still is not None:
            held = self.filter.weighted_states()
            size = np.zeros_like(held.state) if held.size is None else held.size
            weight = held.weights.normalised * models[0].sum()
            parts.append((held.letter, held.state, weight, size))
        for letter, drawn in enumerate(self._drawn):
            if drawn is not None:
                weight = Weights(drawn.log_weight).normalised * models[1, letter]
                place = np.full(len(weight), letter)
                parts.append((place, drawn.state, weight, np.zeros_like(drawn.state)))
        letters, states, weights, sizes = zip(*parts, strict=True)
        return WeightedStates(
            np.concatenate(letters), np.concatenate(states, axis=1), Weights(_log(np.concatenate(weights))),
            np.concatenate(sizes, axis=1),
        )  # fmt: skip

    def belief_over_plane(self) -> PlaneBelief:
        """Count the weighted states in cells of about 1 mm."""
        return plane_histogram(self.labels, self.weighted_states(), self.options.reach)

    def describe(self) -> str:
        """Say how the filter is set up, and that the object may move."""
        return f"{self.filter.describe()}; motion {self.options.motion}"

    @property
    def work(self) -> dict[str, Any]:
        """Count what the filter has done, and the evaluations of the moving belief."""
        work = self.filter.work
        return {**work, "likelihood_evaluations": work["likelihood_evaluations"] + self._evaluated}

    def _models(self) -> FloatArray:
        """Weigh the models, still and moving, and their letters: (2, letters), summing to 1.

        Between the models a reading's likelihood counts by the power EVIDENCE, between letters in full.
        """
        moving = np.array([-np.inf if one is None else one.log_evidence for one in self._clouds])
        still = self._motion.still
        if still is None:
            return np.stack([np.zeros(len(moving)), Weights(moving).normalised])
        models = np.stack([self.filter.log_evidence() + math.log(still), moving + math.log1p(-still)])
        total = np.logaddexp.reduce(models, axis=1)
        within = np.exp(models - total[:, None])
        return Weights(EVIDENCE * total).normalised[:, None] * within


def _mixed(parts: list[tuple[float, PoseSamples | None]]) -> PoseSamples | None:
    """Mix samples, each with the mass of its model; None if some model has none."""
    total = sum(mass for mass, _ in parts)
    known = [(mass / total, one) for mass, one in parts if one is not None and total > 0]
    if len(known) < len(parts):
        return None
    return PoseSamples(
        np.concatenate([one.poses for _, one in known]),
        np.concatenate([mass * one.weights for mass, one in known]),
    )


def _log(values: ArrayLike) -> FloatArray:
    """Take logs; that of 0 is -inf."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(values), dtype=float)


def _next_power(base: FloatArray, log_p: FloatArray) -> float:
    """Find the largest b up to 1, by bisection, that leaves enough states effective at weights of L^b."""
    if Weights(base + log_p).ess >= _ENOUGH:
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(12):
        middle = (low + high) / 2
        low, high = (middle, high) if Weights(base + middle * log_p).ess >= _ENOUGH else (low, middle)
    return low


def _spacing(place: FloatArray, around: float) -> float:
    """Say how far apart placements lie: the median distance to the fifth nearest, mm."""
    step = place[:, None] - place
    step[..., 2] -= around * np.rint(step[..., 2] / around)
    squared = np.partition((step**2).sum(axis=-1), min(5, len(place) - 1), axis=1)[:, min(5, len(place) - 1)]
    return max(float(np.sqrt(np.median(squared))), 0.02)
