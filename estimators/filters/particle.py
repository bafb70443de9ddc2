"""Particle filters (paper, section III-B): as printed, and with random particles injected."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import Estimate, Options, PlaneBelief, PoseSamples, probabilities
from tactsim.estimators.field.plain_field import PlainField
from tactsim.estimators.filters.map_filter import MapFilter
from tactsim.estimators.filters.particle_kernels import draw, move, parzen_mode
from tactsim.estimators.filters.states import WeightedStates, Weights, letter_mass, shared, uniform_states
from tactsim.estimators.options import FilterOptions


class ParticleOptions(FilterOptions):
    """Options of the particle filter."""

    particles: int = Field(10_000, ge=1, le=10_000_000, description="n_P, the total over all letters")
    noise_mm: float = Field(1.0, ge=0, le=100, description="sigma of the command update in x and y, mm")
    noise_rad: float = Field(0.1, ge=0, le=10, description="sigma of the command update in the angle, rad")
    rho: float = Field(1.0, gt=0, le=3, description="rho of eq. 10, mm and rad")
    skip: bool = Field(
        True, description="leave light particles out of the density of eq. 11 where they cannot decide"
    )


@dataclass(frozen=True, eq=False)
class _Particles:
    """letter: (n,) the first of those alike. state: (3, n) T_R^O."""

    letter: NDArray[np.int64]
    state: FloatArray


class ParticleFilter(MapFilter):
    """Particle filter over letter, x, y and angle (paper, eq. 8 to 12), resampled at every reading.

    Letters whose tables are equal are one hypothesis, whose particles bear the first one's number: if each had its own,
    resampling would leave one of them by chance.
    """

    options_type: type[Options] = ParticleOptions
    budget = "particles"
    options: ParticleOptions
    fitted_options: ParticleOptions
    _rng: np.random.Generator
    _particles: _Particles
    _weights: Weights

    def __init__(self, options: ParticleOptions) -> None:
        super().__init__(options)
        self._cones = 0

    def _fit(self) -> None:
        noise = self.fitted_options
        self._noise = np.array([noise.noise_mm, noise.noise_mm, noise.noise_rad])

    def _reset(self, rng: np.random.Generator) -> None:
        """Spread the particles evenly over letters and uniformly over poses."""
        count = self.options.particles
        self._rng = rng.spawn(1)[0]
        letter = np.sort(self.field.alike[np.arange(count) % len(self.labels)])
        self._particles = _Particles(letter, uniform_states(count, self.reach, rng))
        self._weights = Weights(np.zeros(count))

    def measure(self) -> None:
        """Resample, then corrupt with noise (command update), then weigh (measurement update).

        The paper resamples last; resampling first in the next reading instead leaves the weighted
        particles of eq. 9 and 11 for the estimate.
        """
        readings, count = len(self.field), self.options.particles
        self._particles = self._draw(count) if readings > 1 else self._moved(np.arange(count))
        letter, state = self._particles.letter, self._particles.state
        log_p = self.field.log_p(letter, state, readings - 1)
        if isinstance(self.field, PlainField) and np.isneginf(log_p).all():
            self.field.ignore_last()
            log_p[:] = 0
        self._weights = Weights(log_p)
        self._evaluated += count

    def own_estimate(self) -> Estimate:
        """Sum the weights of each letter (eq. 9); find the mode (eq. 12) within the best letter."""
        alike, letter = self.field.alike, self._particles.letter
        best, mass = self.likeliest(shared(letter_mass(letter, self._weights, len(self.labels)), alike))
        of_best = np.flatnonzero(letter == alike[best])
        state, weight = self._particles.state.take(of_best, axis=1), self._weights.relative[of_best]
        mode, skipped = parzen_mode(state, weight, self.options.rho, self.options.skip)
        self._cones += skipped
        return Estimate(
            label=self.labels[best],
            probabilities=probabilities(self.labels, mass),
            robot_in_object=mode,
            samples=PoseSamples(state.T, weight / weight.sum()),
        )

    def own_states(self) -> WeightedStates:
        """Give the particles."""
        return WeightedStates(self._particles.letter, self._particles.state, self._weights)

    def _own_plane(self) -> PlaneBelief:
        """Count the weighted particles in cells of about 1 mm."""
        counted = super()._own_plane()
        return replace(counted, probability=shared(counted.probability, self.field.alike))

    @property
    def work(self) -> dict[str, Any]:
        """Count evaluations, a particle in a reading each, since the estimator was made.

        skipped: cones, of particles that could not decide the mode.
        """
        return {
            "likelihood_evaluations": self._evaluated,
            "skipped": {"cones": self._cones},
            **self._ignored(),
        }

    def _draw(self, count: int) -> _Particles:
        """Draw particles with replacement, with probability proportional to their weights, and add noise."""
        chosen = np.empty(count, dtype=np.int64)
        draw(chosen, self._weights.relative, self._rng.standard_exponential(count + 1))
        return self._moved(chosen)

    def _moved(self, chosen: NDArray[np.int64]) -> _Particles:
        """Copy the chosen particles with the noise of the command update."""
        old, count = self._particles, len(chosen)
        state, normal = np.empty((3, count)), self._rng.standard_normal((3, count))
        move(state, old.state, chosen, normal, self._noise, self.reach)
        return _Particles(old.letter[chosen], state)


class AugmentedOptions(ParticleOptions):
    """Options of augmented Monte Carlo localisation."""

    alpha_slow: float = Field(0.05, gt=0, le=1, description="decay of the long-term mean of w")
    alpha_fast: float = Field(0.5, gt=0, le=1, description="decay of the short-term mean of w")


class AugmentedFilter(ParticleFilter):
    """Augmented MCL (paper, ref. [23]): the particle filter, with random particles in the place of some.

    Each particle is replaced with probability max(0, 1 - w_fast / w_slow). w_slow and w_fast follow the mean weight,
    with the decays `alpha_slow` and `alpha_fast`; both are kept as logs.
    """

    options_type: type[Options] = AugmentedOptions
    options: AugmentedOptions

    def __init__(self, options: AugmentedOptions) -> None:
        if options.alpha_slow > options.alpha_fast:
            raise InputError(
                f"alpha_slow {options.alpha_slow} is above alpha_fast {options.alpha_fast}; "
                "the slow mean must be the slower one"
            )
        super().__init__(options)
        self._injected = 0

    def _reset(self, rng: np.random.Generator) -> None:
        super()._reset(rng)
        self._log_slow = self._log_fast = -math.inf

    def measure(self) -> None:
        """Do as the particle filter does, then move both means towards the mean weight."""
        super().measure()
        # These weights have not lost a common factor.
        self._log_slow = _mix(self._log_slow, self._weights.log_mean, self.options.alpha_slow)
        self._log_fast = _mix(self._log_fast, self._weights.log_mean, self.options.alpha_fast)

    def _draw(self, count: int) -> _Particles:
        """Draw particles, and replace some of them."""
        drawn = super()._draw(count)
        share = max(0.0, -math.expm1(min(0.0, self._log_fast - self._log_slow)))
        if share > 0:
            replaced = np.flatnonzero(self._rng.random(count) < share)
            letter = self._rng.integers(len(self.labels), size=len(replaced))
            drawn.letter[replaced] = self.field.alike[letter]
            drawn.state[:, replaced] = uniform_states(len(replaced), self.reach, self._rng)
            self._injected += len(replaced)
        return drawn

    @property
    def work(self) -> dict[str, Any]:
        """Count as the particle filter does, and `injected`: random particles that replaced others."""
        return {**super().work, "injected": self._injected}


def _mix(log_mean: float, log_value: float, share: float) -> float:
    """Move a mean by a share towards a value, both in logs; a mean of nothing has log -inf."""
    stay = math.log1p(-share) if share < 1 else -math.inf
    return float(np.logaddexp(stay + log_mean, math.log(share) + log_value))
