"""A filter around which the object may move: a belief that is moved between touches, beside the one that lies still."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core import invert
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import Estimate, PlaneBelief
from tactsim.estimators.field.field import LikelihoodField
from tactsim.estimators.filters.map_filter import MapFilter
from tactsim.estimators.filters.mixture import add_densities
from tactsim.estimators.filters.motion import EVIDENCE, Motion
from tactsim.estimators.filters.placement import mean_around
from tactsim.estimators.filters.states import WeightedStates, plane_histogram, probabilities
from tactsim.estimators.filters.weights import Weights
from tactsim.estimators.filters.wrapper import Wrapper

_CENTRES = 300  # of a letter's belief that is moved, and of each round of proposals
_DRAWN = 800  # states of a letter in a round; at the second reading, when the belief is broad, _BROAD times as many
_BROAD = 4
_ROUNDS = 4
_ENOUGH = 60.0  # effective states that a round aims at
_FORGOTTEN = 30.0  # a letter this many nats below the best is not followed any more
_NEGLIGIBLE = 20.0
_TINY = np.finfo(float).tiny
import os
BETA = float(os.environ.get("BETA", "1"))


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
        motion, rng = self._motion, self._rng
        last = len(self.filter.field) - 1
        before = np.exp(cloud.log_weight)
        weight = (1 - motion.switch) * before + motion.switch * before.sum(axis=1, keepdims=True) * motion.prior
        scales = len(motion.variance)
        # The last column is where the object jumps to, whatever the scale.
        variance = np.append(motion.variance, motion.jump_variance)
        columns = np.column_stack([weight * (1 - motion.jump), weight.sum(axis=1) * motion.jump])
        offered = columns.sum(axis=0)
        # The scales that are hardly believed, and the jump, are offered often enough to be found.
        share = offered + 0.1 * (variance > 0) * (offered > 0)
        share /= share.sum()
        more = np.divide(share, offered, out=np.zeros_like(share), where=offered > 0)

        count = _DRAWN * (_BROAD if last == 1 else 1)
        which = rng.choice(scales + 1, size=count, p=share)
        centre = np.empty(count, dtype=np.int64)
        for k in range(scales + 1):
            mine = np.flatnonzero(which == k)
            if len(mine):
                with np.errstate(divide="ignore"):
                    centre[mine] = Weights(np.log(columns[:, k])).systematic(len(mine), rng)
        width = np.sqrt(variance[which] + cloud.spread[centre])
        place = cloud.centre[centre] + rng.standard_normal((count, 3)) * width[:, None]
        log_p, target = self._log_p(letter, place), self._densities(place, cloud, columns, variance)
        proposal = count * (target * more).sum(axis=1)
        rounds: list[tuple[FloatArray, float, int]] = []
        for _ in range(_ROUNDS):
            with np.errstate(divide="ignore"):
                base = np.log(target.sum(axis=1)) - np.log(proposal + _TINY)
            power = _next_power(base, log_p)
            if power == 1 and len(rounds) > 0:
                break
            around = place[Weights(base + power * log_p).systematic(_CENTRES // 3, rng)]
            width = _spacing(around, motion.around)
            again = np.repeat(around, _DRAWN // 2 // len(around), axis=0)
            again = again + rng.standard_normal(again.shape) * width
            rounds.append((around, width, len(again)))
            proposal = proposal + self._proposed(place, rounds[-1:])
            fresh = self._densities(again, cloud, columns, variance)
            proposal = np.append(
                proposal, count * (fresh * more).sum(axis=1) + self._proposed(again, rounds)
            )
            place, target = np.concatenate([place, again]), np.concatenate([target, fresh])
            log_p = np.append(log_p, self._log_p(letter, again))
        with np.errstate(divide="ignore"):
            log_density = np.log(target.sum(axis=1)) + log_p
            log_weight = log_density - np.log(proposal + _TINY)
            # What jumped has the scales that its letter has.
            by_scale = target[:, :scales] + target[:, scales:] * (offered[:scales] / offered[:scales].sum())
            by_scale = np.log(by_scale / (target.sum(axis=1, keepdims=True) + _TINY))
        weights = Weights(log_weight)
        chosen = weights.systematic(_CENTRES, rng)
        gained = float(log_weight.max() + np.log(weights.relative.sum()))
        kept = by_scale[chosen] - math.log(len(chosen))
        after = np.exp(kept).sum(axis=0)
        kept = kept + (EVIDENCE - 1) * np.log((after + _TINY) / weight.sum(axis=0))
        kept -= np.log(np.exp(kept).sum())
        moved = _Cloud(place[chosen], np.zeros(len(chosen)), kept, cloud.log_evidence + gained)
        return moved, _Drawn(motion.state(place), log_weight, log_density)

    def _log_p(self, letter: int, place: FloatArray) -> FloatArray:
        """Weigh placements by the last reading: (n,)."""
        self._evaluated += len(place)
        return BETA * self.filter.field.log_p(letter, self._motion.state(place), len(self.filter.field) - 1)

    def _densities(
        self, place: FloatArray, cloud: _Cloud, weight: FloatArray, variance: FloatArray
    ) -> FloatArray:
        density = np.zeros((len(place), weight.shape[1]))
        add_densities(
            density, place, cloud.centre, np.ascontiguousarray(weight), variance, cloud.spread, self._motion.around
        )
        return density

    def _proposed(self, place: FloatArray, rounds: list[tuple[FloatArray, float, int]]) -> FloatArray:
        density = np.zeros((len(place), 1))
        for around, width, count in rounds:
            weight = np.full((len(around), 1), count / len(around))
            add_densities(
                density, place, around, weight, np.array([width**2]), np.zeros(len(around)), self._motion.around
            )
        return density[:, 0]

    def log_models(self) -> FloatArray:
        """Give log p(readings, model | letter): (2, letters), lying still and moving."""
        moving = np.array([-np.inf if one is None else one.log_evidence for one in self._clouds])
        still = self._motion.still
        if still is None:
            return np.stack([np.full(len(moving), -np.inf), moving])
        return np.stack([self.filter.log_evidence() + math.log(still), moving + math.log1p(-still)])

    def _models(self, models: FloatArray) -> FloatArray:
        """Weigh the models and their letters: (2, letters), summing to 1."""
        tops = models.max(axis=1)
        with np.errstate(invalid="ignore"):
            within = np.exp(models - np.where(np.isfinite(tops), tops, 0)[:, None])
        sums = within.sum(axis=1)
        with np.errstate(divide="ignore"):
            total = tops + np.log(sums)
        share = np.exp(EVIDENCE * (total - total.max()))
        share /= share.sum()
        mass = share[:, None] * within / np.maximum(sums, _TINY)[:, None]
        self._still = mass[0] > mass[1]
        return mass

    def estimate(self) -> Estimate:
        """Sum the models for each letter; take the pose from the likelier model of the best letter."""
        if len(self.filter.field) < 2:
            return self.filter.estimate()
        models = self.log_models()
        mass = self._models(models)
        letters = mass.sum(axis=0)
        best = int(letters.argmax())
        mass = letters
        if self._still[best]:
            known = self.filter.estimate()
            if known.label == self.labels[best]:
                pose = known.robot_in_object
                return Estimate(self.labels[best], probabilities(self.labels, mass), pose)
        drawn = self._drawn[best]
        assert drawn is not None
        heavy = drawn.log_weight > drawn.log_weight.max() - _NEGLIGIBLE
        pose = mean_around(
            drawn.state[:, heavy], Weights(drawn.log_weight[heavy]), int(drawn.log_density[heavy].argmax())
        )
        return Estimate(self.labels[best], probabilities(self.labels, mass), pose)


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
