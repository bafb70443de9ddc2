"""Objects that may move between touches: a belief that is moved, beside a filter's own of an object that lies still."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import Estimate, PoseSamples, probabilities
from tactsim.estimators.filters.clouds import CENTRES, DRAWN, Cloud, Drawn, advance, log
from tactsim.estimators.filters.motion import Motion
from tactsim.estimators.filters.placement import mean_around
from tactsim.estimators.filters.states import (
    WeightedStates,
    Weights,
    letter_mass,
    likeliest_view,
    pose_samples,
)

if TYPE_CHECKING:
    from tactsim.estimators.filters.map_filter import MapFilter
    from tactsim.estimators.synthesis.synthesis import Synthesis

_BROAD = 5  # at the second reading, when the belief is broad, so many times as many states are drawn
_SETTING_OFF = 80  # centres of a letter's belief at rest, from which it may begin to move
_FORGOTTEN = 30.0  # a letter this many nats below the best is not followed any more
# How often a touch at rest is misplaced: then it is what it would be if the object had moved, and so may be one touch.
_MISPLACED = 0.01


class MovingBelief:
    """A belief of an object that moves between touches, from a filter's first belief on; the filter has it.

    The moving belief is a mixture of normal distributions over placements. Between readings it is widened by the
    motion. Then states are drawn from it, weighed by the last reading alone, and drawn again around the better
    ones, in rounds, as the reading is taken in little by little: adaptive importance sampling (Cappe et al. 2004;
    weights by the mixture of all rounds, Cornuet et al. 2012).

    How far the object moves is learned, if it is not given: each scale of a bank, from lying still on, has the
    probability that the readings so far give it. An object at rest may begin to move before any touch, from where the
    filter holds that it lies.
    """

    def __init__(self, filter: MapFilter | Synthesis, motion: Motion) -> None:
        self._filter, self._motion = filter, motion

    def reset(self, rng: np.random.Generator, likely: NDArray[np.bool_] | None = None) -> None:
        """Forget the sequence; all randomness until the next reset comes from `rng`.

        likely: (letters,) those that may move, of an object that has lain still so far as is known, and of which states
        are drawn as if the first belief were not broad; None: all.
        """
        self._rng, self._likely = rng, likely
        self._broad = _BROAD if likely is None else 1
        self._clouds: list[Cloud | None] = []
        self._rest = 0.0
        self._past: list[list[Cloud | None]] = []
        self._drawn: list[Drawn | None] = []

    def update(self) -> None:
        """Take in the filter's last reading: move the belief, and weigh it; the filter measures if it may lie still."""
        if not self._clouds:
            self._filter.measure()
            if self._filter.located:
                self._begin(self._filter.own_states())
            return
        at_rest = -math.inf
        if self._motion.still is not None:
            belief = self._filter.own_states()
            self._set_off(belief)
            at_rest = self._filter.foretold(belief)
        self._follow(self._filter.touches - 1, at_rest)

    def take_in(
        self, held: Sequence[Callable[[], WeightedStates]], log_p: Callable[[WeightedStates, int], float]
    ) -> None:
        """Take in the filter's readings so far: what it held after each, log p of a touch in what it held before."""
        self._begin(belief := held[0]())
        for touch in range(1, len(held)):
            self._set_off(belief)
            self._follow(touch, log_p(belief, touch))
            belief = held[touch]()

    def _follow(self, touch: int, at_rest: float) -> None:
        """Move the belief, and weigh it by a touch, whose log-likelihood is at_rest if the object lies still."""
        before = self._followed
        self._past.append(self._clouds)
        self._clouds = list(self._clouds)
        count = DRAWN * (self._broad if len(self._past) == 1 else 1)
        best = self._log_evidence.max()
        for letter, cloud in enumerate(self._clouds):
            if cloud is None or cloud.log_evidence < best - _FORGOTTEN:
                self._clouds[letter] = self._drawn[letter] = None
            else:
                log_p = partial(self._log_p_of_placed, letter, touch)
                self._clouds[letter], self._drawn[letter] = advance(
                    cloud, self._motion, log_p, count, self._rng
                )
        misplaced = math.log(_MISPLACED) + self._followed - before
        self._rest += math.log1p(-self._motion.begins)
        self._rest += float(np.logaddexp(math.log1p(-_MISPLACED) + at_rest, misplaced))

    @property
    def _log_evidence(self) -> FloatArray:
        """Give log p(readings | letter) if it moves, (letters,); -inf of one that is not followed any more."""
        return np.array([-math.inf if cloud is None else cloud.log_evidence for cloud in self._clouds])

    @property
    def _followed(self) -> float:
        """Give the log-evidence of an object that moves, whichever it is."""
        return float(np.logaddexp.reduce(self._log_evidence))

    @property
    def probability(self) -> float:
        """Give the probability that the object moves."""
        still = self._motion.still
        if still is None or not self._past:
            return 1.0
        odds = np.array([self._rest, self._followed]) + np.log([still, 1 - still])
        return float(Weights(odds).normalised[1])

    def _begin(self, belief: WeightedStates) -> None:
        """Take over what the filter holds: nothing has moved yet."""
        self._clouds = self._held(belief, self._broad * CENTRES)
        self._drawn = [
            None
            if cloud is None
            else Drawn(self._motion.state(cloud.centre), *np.zeros((2, len(cloud.centre))))
            for cloud in self._clouds
        ]

    def _set_off(self, belief: WeightedStates) -> None:
        """Let the object begin to move from where the filter's belief holds that it lies.

        So the belief that moves need not find by itself, of single readings, what all readings together say.
        """
        still = self._motion.still
        assert still is not None
        log_share = self._rest + math.log(still / (1 - still)) + math.log(self._motion.begins)
        followed = self._log_evidence.max()
        if log_share < followed - _FORGOTTEN:
            return
        for letter, begun in enumerate(self._held(belief, _SETTING_OFF)):
            if begun is None or begun.log_evidence + log_share < followed - _FORGOTTEN:
                continue
            begun, moving = replace(begun, log_evidence=begun.log_evidence + log_share), self._clouds[letter]
            self._clouds[letter] = begun if moving is None else moving.joined(begun)

    def _held(self, belief: WeightedStates, count: int) -> list[Cloud | None]:
        """Make clouds of the filter's belief, of about `count` centres each; None of a letter that holds nothing."""
        motion = self._motion
        mass = letter_mass(belief.letter, belief.weights, len(self._filter.labels))
        evidence, clouds = log(mass / mass.sum()), list[Cloud | None]()
        if self._likely is not None and mass[self._likely].any():
            mass = mass * self._likely
        for letter in range(len(self._filter.labels)):
            if not mass[letter]:
                clouds.append(None)
                continue
            of_letter = np.flatnonzero(belief.letter == letter)
            chosen = of_letter[Weights(belief.weights.log[of_letter]).systematic(count, self._rng)]
            state = belief.state[:, chosen]
            size = belief.size[:, chosen] if belief.size is not None else np.zeros_like(state)
            state = state + self._rng.uniform(-0.5, 0.5, state.shape) * size
            spread = (size[0] * size[1] * size[2] / motion.ratio) ** (2 / 3) / 12
            log_weight = np.full((len(chosen), 1), -math.log(len(chosen))) + np.log(motion.prior)
            clouds.append(Cloud(motion.placed(state), spread, log_weight, float(evidence[letter])))
        return clouds

    def _log_p_of_placed(self, letter: int, touch: int, placement: FloatArray) -> FloatArray:
        """Weigh placements (n, 3) by a reading: (n,)."""
        return self._filter.log_p(letter, self._motion.state(placement), touch)

    def estimate(self, held: Estimate | None = None) -> Estimate:
        """Sum the models for each letter; take the pose from the likelier model of the best letter.

        held: the estimate of the filter's own belief, if it was made already.
        """
        if not self._past:
            return held or self._filter.own_estimate()
        labels = self._filter.labels
        known = (held or self._filter.own_estimate()) if self._motion.still is not None else None
        models = self._models(known)
        # A letter that neither belief is about has no pose to state.
        stated = np.array(
            [
                drawn is not None or (known is not None and label == known.label)
                for label, drawn in zip(labels, self._drawn, strict=True)
            ]
        )
        mass = models.sum(axis=0)
        best = likeliest_view(mass, self._filter.same_object, stated)
        drawn, parts, poses = self._drawn[best], [], []
        if known is not None and known.label == labels[best]:
            poses.append((models[0, best], known.robot_in_object))
            parts.append((models[0, best], known.samples))
        if drawn is not None:
            state, weights, mode = drawn.heavy()
            poses.append((models[1, best], mean_around(state, weights.relative, mode)))
            parts.append((models[1, best], pose_samples(state, weights)))
        pose = max(poses, key=lambda model: model[0])[1]
        return Estimate(labels[best], probabilities(labels, mass), pose, _mixed(parts))

    def path(self, estimate: Estimate) -> FloatArray:
        """Give robot_in_object at each touch so far (n, 3), for the letter and the last pose of an estimate.

        All poses are the last one where the object is more probably still.
        """
        letter, last = self._filter.labels.index(estimate.label), estimate.robot_in_object
        if self._past and self._drawn[letter] is not None:
            at_rest, moves = self._models()[:, letter]
            if moves >= at_rest:
                return self._way(letter, last)
        return np.tile(last, (self._filter.touches, 1))

    def likeliest_way(self) -> tuple[int, FloatArray]:
        """Give the likeliest letter, and robot_in_object at each touch so far (n, 3), if the object moves."""
        letter = int(self._log_evidence.argmax())
        drawn = self._drawn[letter]
        assert drawn is not None
        state, _, mode = drawn.heavy()
        return letter, self._way(letter, state[:, mode])

    def _way(self, letter: int, last: FloatArray) -> FloatArray:
        """Find robot_in_object at each touch so far (n, 3), for the last one (3,).

        From the last pose back, each pose is the centre that explains best its own reading and the step to its
        successor.
        """
        count = self._filter.touches
        poses = np.tile(last, (count, 1))
        motion, later = self._motion, self._motion.placed(poses[-1:].T)[0]
        for touch, past in zip(range(count - 2, -1, -1), reversed(self._past), strict=False):
            cloud = past[letter]
            if cloud is None:
                break
            step = cloud.centre - later
            step[:, 2] -= motion.around * np.rint(step[:, 2] / motion.around)
            variance = np.append(motion.variance, motion.jump_variance) + cloud.spread[:, None]
            weight = np.append(np.log(1 - motion.jump) + np.zeros(len(motion.variance)), log(motion.jump))
            held = np.column_stack([cloud.log_weight, np.logaddexp.reduce(cloud.log_weight, axis=1)])
            reached = held + weight - 1.5 * np.log(variance) - 0.5 * (step**2).sum(axis=1)[:, None] / variance
            own = self._filter.log_p(letter, motion.state(cloud.centre), touch)
            later = cloud.centre[int((reached.max(axis=1) + own).argmax())]
            poses[touch] = motion.state(later[None])[:, 0]
        return poses

    def weighted_states(self) -> WeightedStates:
        """Give the states of both models."""
        if not self._past:
            return self._filter.own_states()
        models, parts = self._models(), []
        if self._motion.still is not None:
            held = self._filter.own_states()
            size = np.zeros_like(held.state) if held.size is None else held.size
            weight = held.weights.normalised * models[0].sum()
            parts.append((held.letter, held.state, weight, size))
        for letter, drawn in enumerate(self._drawn):
            if drawn is not None:
                weight = Weights(drawn.log_weight).normalised * models[1, letter]
                parts.append((np.full(len(weight), letter), drawn.state, weight, np.zeros_like(drawn.state)))
        letters, states, weights, sizes = zip(*parts, strict=True)
        return WeightedStates(
            np.concatenate(letters), np.concatenate(states, axis=1), Weights(log(np.concatenate(weights))),
            np.concatenate(sizes, axis=1),
        )  # fmt: skip

    def _models(self, known: Estimate | None = None) -> FloatArray:
        """Weigh the models, at rest and moving, and their letters: (2, letters), summing to 1.

        known: the estimate of the filter, if it was made already.

        A model counts as much as it foretold the readings one by one (Dawid 1984), each of which may be misplaced: so
        no touch alone speaks for a move by more than -log _MISPLACED. Both are asked the same, though a sequence
        counts for less in the belief of an object at rest than single readings do.
        """
        moving = Weights(self._log_evidence)
        if self._motion.still is None:
            return np.stack([np.zeros(len(self._filter.labels)), moving.normalised])
        at_rest = (known or self._filter.own_estimate()).probabilities
        moves = self.probability
        said = np.array([at_rest[label] for label in self._filter.labels])
        return np.stack([(1 - moves) * said, moves * moving.normalised])


def _mixed(parts: list[tuple[float, PoseSamples | None]]) -> PoseSamples | None:
    """Mix samples, each with the mass of its model; None if some model has none."""
    total = sum(mass for mass, _ in parts)
    known = [(mass / total, samples) for mass, samples in parts if samples is not None and total > 0]
    if len(known) < len(parts):
        return None
    return PoseSamples(
        np.concatenate([samples.poses for _, samples in known]),
        np.concatenate([mass * samples.weights for mass, samples in known]),
    )
