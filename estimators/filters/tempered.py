"""Tempered particles: one population a letter, kept spread out by a temperature, moved by its own spread."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tactsim.core import wrap_angle
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import Estimate, Options, probabilities
from tactsim.estimators.filters.map_filter import MapFilter
from tactsim.estimators.filters.placement import mean_around
from tactsim.estimators.filters.states import (
    WeightedStates,
    Weights,
    highest_power,
    pose_samples,
    uniform_states,
)
from tactsim.estimators.options import MODELS, OpenSetOptions

# A move is the difference of two other particles of the letter times one of these factors, drawn for each
# particle: so some particles move within a mode and some between modes.
_STRIDES = np.array([0.1, 0.5, 1.0])
# A little noise is added, so that a population of copies can spread again: mm, mm, rad.
_JITTER = np.array([[0.02], [0.02], [0.002]])
# The particles of a letter whose evidence is this many nats below the best letter's are weighed but not moved:
# its probability is below exp(-60), and moving them could raise it only if the estimate of its evidence were
# wrong by nearly as much.
_HOPELESS = 60.0


class TemperedOptions(OpenSetOptions):
    """Options of the tempered particle filter."""

    likelihood: str = Field("calibrated", description=MODELS)
    particles: int = Field(
        10_000, ge=1, le=10_000_000, description="n_P over all letters together; each has an equal part"
    )
    rounds: int = Field(8, ge=1, le=100, description="the most rounds of resampling and moving at a reading")
    survivors: float = Field(
        0.5, gt=0, lt=1, description="share of a population that must stay effective: sets the temperature"
    )
    skip: bool = Field(True, description="do not move the particles of letters that cannot matter")


@dataclass(eq=False)
class _Population:
    """The particles of one letter, which stand for p(pose)^(1-b) p(pose | readings)^b.

    state: (3, n) T_R^O mm, mm, rad. log_p: (n,) log-likelihood of the whole history. weights: of mean 1.
    power: b. log_evidence: log p(readings | letter) as far as b.
    """

    rng: np.random.Generator
    state: FloatArray
    log_p: FloatArray
    weights: Weights
    power: float = 0.0
    log_evidence: float = 0.0

    @property
    def rest(self) -> Weights:
        """Give the weights for the rest of the way to b = 1."""
        return Weights(self.weights.log + (1 - self.power) * self.log_p)

    @property
    def log_total(self) -> float:
        """Give log p(readings | letter), the rest of the way to b = 1 by importance."""
        return self.log_evidence + self.rest.log_mean

    @property
    def untempered(self) -> FloatArray:
        """Give the log-weights (n,) as they would be at b = 0."""
        return self.weights.log - self.power * self.log_p


class TemperedFilter(MapFilter):
    """Sequential Monte Carlo on a static state, adaptively tempered (Chopin 2002; Del Moral et al. 2006).

    After every reading b is set as near 1 as leaves `survivors` of the letter's population effective. A
    population that b = 1 would thin out is rejuvenated by resample-move (Gilks and Berzuini 2001): it is
    resampled, and moved by a Metropolis step whose length is the difference of two other particles, the whole
    history replayed; then b is raised again, for at most `rounds` rounds. No letter can be lost to
    resampling; its evidence is the product of the mean weights on the way.

    All letters draw the same numbers. So letters that are hard to tell apart have much the same error of their
    evidence, and those whose tables are equal have the same evidence to the bit.
    """

    options_type: type[Options] = TemperedOptions
    budget = "particles"
    options: TemperedOptions

    def __init__(self, options: TemperedOptions) -> None:
        super().__init__(options)
        self._unmoved = 0

    def _fit(self) -> None:
        self._each = max(1, self.options.particles // len(self.labels))

    def _reset(self, rng: np.random.Generator) -> None:
        """Spread every letter's population over the poses, uniformly."""
        own = rng.spawn(1)[0]
        self._populations = [self._population(deepcopy(own)) for _ in self.labels]

    def _population(self, own: np.random.Generator) -> _Population:
        state = uniform_states(self._each, self.reach, own)
        return _Population(own, state, np.zeros(self._each), Weights(np.zeros(self._each)))

    def measure(self) -> None:
        """Weigh every particle and choose each letter's b; resample and move the letters that need it."""
        tired = [letter for letter in range(len(self.labels)) if self._weigh_in(letter)]
        log_total = np.array([population.log_total for population in self._populations])
        hopeless = log_total < log_total.max() - _HOPELESS
        for letter in tired:
            if hopeless[letter] and self.options.skip:
                self._unmoved += self._each * len(self.field)
                continue
            self._renew(letter)

    def own_estimate(self) -> Estimate:
        """Compare the letters' evidence; give the mean pose near the best particle of the best letter."""
        evidence = Weights(np.array([population.log_total for population in self._populations]))
        best, mass = self.likeliest(evidence.relative)
        one = self._populations[best]
        return Estimate(
            label=self.labels[best],
            probabilities=probabilities(self.labels, mass),
            robot_in_object=mean_around(one.state, one.rest.relative, int(one.log_p.argmax())),
            samples=pose_samples(one.state, one.rest),
        )

    def own_states(self) -> WeightedStates:
        """Give the particles of all letters, weighted with their letters' evidence."""
        return WeightedStates(
            np.repeat(np.arange(len(self.labels)), self._each),
            np.concatenate([population.state for population in self._populations], axis=1),
            Weights(np.concatenate([one.log_evidence + one.rest.log for one in self._populations])),
        )

    @property
    def work(self) -> dict[str, Any]:
        """Count evaluations, a particle in a reading each, made and skipped since the estimator was made."""
        skipped = {"moves": self._unmoved}
        return {"likelihood_evaluations": self._evaluated, "skipped": skipped}

    def _weigh_in(self, letter: int) -> bool:
        """Take the newest reading into a letter's weights; tells whether b = 1 would thin it out."""
        one, readings = self._populations[letter], len(self.field)
        start = one.untempered
        one.log_p = one.log_p + self.field.log_p(letter, one.state, readings - 1)
        self._evaluated += self._each
        return self._temper(one, start)

    def _temper(self, one: _Population, start: FloatArray) -> bool:
        """Set b and its weights, from the log-weights at b = 0; tells whether b = 1 would thin the population out."""
        one.power = highest_power(start, one.log_p, self.options.survivors * self._each)
        weights = Weights(start + one.power * one.log_p)
        one.log_evidence += weights.log_mean
        one.weights = Weights(weights.log - weights.log_mean)
        return one.power < 1

    def _renew(self, letter: int) -> None:
        """Resample, move and raise b again, until b = 1 thins out no more or the rounds are used up."""
        one = self._populations[letter]
        for _ in range(self.options.rounds):
            self._resample(one)
            self._move(letter)
            if not self._temper(one, one.untempered):
                break

    def _resample(self, one: _Population) -> None:
        """Draw a population anew from itself, systematically: equal weights afterwards."""
        chosen = one.weights.systematic(self._each, one.rng)
        one.state, one.log_p = one.state.take(chosen, axis=1), one.log_p[chosen]
        one.weights = Weights(np.zeros(self._each))

    def _move(self, letter: int) -> None:
        """Move a letter's particles by a Metropolis step that leaves what they stand for as it is."""
        one, count = self._populations[letter], self._each
        first, second = one.rng.integers(count, size=(2, count))
        step = one.state[:, first] - one.state[:, second]
        step[2] = wrap_angle(step[2])
        step *= one.rng.choice(_STRIDES, size=count)
        proposed = one.state + step + one.rng.standard_normal(step.shape) * _JITTER
        log_p = self.field.log_p(letter, proposed)
        self._evaluated += count * len(self.field)
        within = np.abs(proposed[:2]).max(axis=0) <= self.reach
        likelier: NDArray[np.bool_] = np.log(one.rng.random(count)) < one.power * (log_p - one.log_p)
        accepted = within & likelier
        one.state = np.where(accepted, proposed, one.state)
        one.log_p = np.where(accepted, log_p, one.log_p)
