"""Particle filters (paper, section III-B): as printed, and with random particles injected."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import Estimate, Options, PlaneBelief
from tactsim.estimators.filters.injection import Injection
from tactsim.estimators.filters.map_filter import MapFilter
from tactsim.estimators.filters.motion import Motion, parse_motion
from tactsim.estimators.filters.multinomial import draw
from tactsim.estimators.filters.parzen import parzen_mode
from tactsim.estimators.filters.states import (
    WeightedStates,
    letter_mass,
    plane_histogram,
    pose_samples,
    probabilities,
    shared,
    uniform_states,
)
from tactsim.estimators.filters.weights import Weights
from tactsim.estimators.options import FilterOptions


class ParticleOptions(FilterOptions):
    """Options of the particle filter."""

    particles: int = Field(
        10_000, ge=1, le=10_000_000, description="n_P, the total over all letters together"
    )
    noise_mm: float = Field(1.0, ge=0, le=100, description="sigma of the command update in x and y, mm")
    noise_rad: float = Field(0.1, ge=0, le=10, description="sigma of the command update in the angle, rad")
    rho: float = Field(1.0, gt=0, le=3, description="rho of eq. 10, mm and rad")


class ParticleFilter(MapFilter):
    """Particle filter over letter, x, y and angle (paper, eq. 8 to 12), resampled at every reading.

    Letters whose tables are equal are one hypothesis, whose particles bear the first one's number: if each had its own,
    resampling would leave one of them by chance.
    injection: which particles are replaced by random ones after resampling; None for none.
    """

    options_type: type[Options] = ParticleOptions
    budget = "particles"
    moves = True
    options: ParticleOptions
    _letter: NDArray[np.int64]
    _state: FloatArray
    _weights: Weights
    _scale: NDArray[np.int64]

    def __init__(self, options: ParticleOptions, injection: Injection | None = None) -> None:
        super().__init__(options)
        self._injection = injection
        self._motion = parse_motion(options.motion)
        self._evaluated = self._injected = 0

    def _fit(self) -> None:
        pass  # the field is all that a sequence needs

    def _reset(self, rng: np.random.Generator) -> None:
        """Spread the particles evenly over letters and uniformly over poses."""
        count = self.options.particles
        self._rng = rng
        self._letter = self.field.alike[np.arange(count) % len(self.labels)]
        self._state = uniform_states(count, self.options.reach, rng)
        self._weights = Weights(np.zeros(count))
        if self._injection is not None:
            self._injection.reset()

    def _update(self) -> None:
        """Resample, then corrupt with noise (command update), then weigh (measurement update).

        The paper resamples last; resampling first in the next reading instead leaves the weighted
        particles of eq. 9 and 11 for the estimate.
        """
        chosen, readings = self.options, len(self.field)
        if readings > 1:
            self._resample()
            if self._injection is not None:
                self._inject(self._injection)
        if self._motion is not None:
            self._move(self._motion)
        else:
            noise = self._rng.standard_normal(self._state.shape)
            noise[:2] *= chosen.noise_mm
            noise[2] *= chosen.noise_rad
            self._state += noise
            np.clip(self._state[:2], -chosen.reach, chosen.reach, out=self._state[:2])
        self._weights = Weights(self.field.log_p(self._letter, self._state, readings - 1))
        self._evaluated += len(self._letter)
        if self._injection is not None:
            self._injection.follow(self._weights)

    def _estimate(self) -> Estimate:
        """Sum the weights of each letter (eq. 9); find the mode (eq. 12) within the best letter."""
        alike = self.field.alike
        mass = shared(letter_mass(self._letter, self._weights, len(self.labels)), alike)
        best = int(mass.argmax())
        mine = self._letter == alike[best]
        state, weight = self._state.compress(mine, axis=1), self._weights.relative[mine]
        return Estimate(
            label=self.labels[best],
            probabilities=probabilities(self.labels, mass),
            robot_in_object=parzen_mode(state, weight, self.options.rho),
            samples=pose_samples(state, Weights(self._weights.log[mine])),
        )

    def weighted_states(self) -> WeightedStates:
        """Give the particles."""
        return WeightedStates(self._letter, self._state, self._weights)

    def belief_over_plane(self) -> PlaneBelief:
        """Count the weighted particles in cells of about 1 mm."""
        counted = plane_histogram(self.labels, self.weighted_states(), self.options.reach)
        return replace(counted, probability=shared(counted.probability, self.field.alike))

    @property
    def work(self) -> dict[str, Any]:
        """Count evaluations, a particle in a reading each, since the estimator was made.

        injected: random particles that replaced others, if there is an injection.
        """
        counts: dict[str, Any] = {"likelihood_evaluations": self._evaluated, "skipped": {}}
        return counts if self._injection is None else {**counts, "injected": self._injected}

    def _move(self, motion: Motion) -> None:
        """Move the particles as the object may move, each with a scale of its own (command update).

        The noise of the command update in the paper is a random walk too, of 1 mm and 0.1 rad whatever the object
        does; the motion takes its place. A scale that moves as the object does survives the resampling.
        """
        count, rng = len(self._letter), self._rng
        if len(self.field) == 1:
            self._scale = rng.choice(len(motion.variance), size=count, p=motion.prior)
            return
        anew = rng.random(count) < motion.switch
        self._scale[anew] = rng.choice(len(motion.variance), size=int(anew.sum()), p=motion.prior)
        variance = motion.variance[self._scale]
        variance[rng.random(count) < motion.jump] = motion.jump_variance
        variance += (self.options.noise_mm / len(self.field)) ** 2
        step = rng.standard_normal((count, 3)) * np.sqrt(variance)[:, None]
        self._state = motion.state(motion.placed(self._state) + step)

    def _resample(self) -> None:
        """Draw n_P particles with replacement, with probability proportional to their weights."""
        chosen = np.empty(len(self._letter), dtype=np.int64)
        draw(chosen, self._weights.relative, self._rng.random(len(chosen)))
        self._letter, self._state = self._letter[chosen], self._state.take(chosen, axis=1)
        if self._motion is not None:
            self._scale = self._scale[chosen]

    def _inject(self, injection: Injection) -> None:
        """Replace the particles that the injection chooses by random ones."""
        replaced = injection.choose(len(self._letter), self._rng)
        count = int(replaced.sum())
        self._letter[replaced] = self.field.alike[self._rng.integers(len(self.labels), size=count)]
        self._state[:, replaced] = uniform_states(count, self.options.reach, self._rng)
        self._injected += count


class AugmentedOptions(ParticleOptions):
    """Options of augmented Monte Carlo localisation."""

    alpha_slow: float = Field(0.05, gt=0, le=1, description="decay of the long-term mean of w")
    alpha_fast: float = Field(0.5, gt=0, le=1, description="decay of the short-term mean of w")


class AugmentedFilter(ParticleFilter):
    """Augmented MCL (paper, ref. [23]): the particle filter with `Injection`."""

    options_type: type[Options] = AugmentedOptions

    def __init__(self, options: AugmentedOptions) -> None:
        if options.alpha_slow > options.alpha_fast:
            raise InputError(
                f"alpha_slow {options.alpha_slow} is above alpha_fast {options.alpha_fast}; "
                "the slow mean must be the slower one"
            )
        super().__init__(options, Injection(options.alpha_slow, options.alpha_fast))
