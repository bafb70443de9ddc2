"""Particle filters (paper, section III-B): as printed, and with random particles injected."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray
from tactsim.estimators.estimator import Estimate, Options, PlaneBelief, PoseSamples, probabilities
from tactsim.estimators.filters.kld import OccupiedBins, enough
from tactsim.estimators.filters.map_filter import MapFilter
from tactsim.estimators.filters.motion import Motion
from tactsim.estimators.filters.particle_kernels import draw, move
from tactsim.estimators.filters.parzen import parzen_mode
from tactsim.estimators.filters.states import WeightedStates, Weights, letter_mass, shared, uniform_states
from tactsim.estimators.options import FilterOptions


class ParticleOptions(FilterOptions):
    """Options of the particle filter."""

    particles: int = Field(
        10_000,
        ge=1,
        le=10_000_000,
        description="n_P, the total over all letters; the most of them with kld_error",
    )
    noise_mm: float = Field(1.0, ge=0, le=100, description="sigma of the command update in x and y, mm")
    noise_rad: float = Field(0.1, ge=0, le=10, description="sigma of the command update in the angle, rad")
    rho: float = Field(1.0, gt=0, le=3, description="rho of eq. 10, mm and rad")
    skip: bool = Field(
        True, description="leave light particles out of the density of eq. 11 where they cannot decide"
    )
    kld_error: float = Field(
        0.0,
        ge=0,
        le=10,
        description="epsilon of KLD-sampling (Fox 2003), pf_err of nav2: as many particles as it needs; 0 for always "
        "`particles`",
    )
    kld_z: float = Field(
        2.33,
        ge=0,
        le=6,
        description="upper standard normal quantile of how surely kld_error is kept: 2.33 for 99 %",
    )
    kld_mm: float = Field(1.0, ge=0.01, le=100, description="side of KLD-sampling's bins in x and y, mm")
    kld_rad: float = Field(0.2, ge=0.01, le=7, description="side of KLD-sampling's bins in the angle, rad")
    min_particles: int = Field(500, ge=1, le=10_000_000, description="the fewest particles of KLD-sampling")

    @model_validator(mode="after")
    def _bounds_are_in_order(self) -> ParticleOptions:
        if self.kld_error > 0 and self.min_particles > self.particles:
            raise ValueError(
                f"min_particles {self.min_particles} is above particles {self.particles}, which is the most"
            )
        return self


@dataclass(frozen=True, eq=False)
class _Particles:
    """letter: (n,) the first of those alike. state: (3, n) T_R^O. scale: (n,) of the motion; empty without one."""

    letter: NDArray[np.int64]
    state: FloatArray
    scale: NDArray[np.int64]

    @classmethod
    def joined(cls, parts: Sequence[_Particles]) -> _Particles:
        """Join several sets of particles."""
        return cls(
            np.concatenate([part.letter for part in parts]),
            np.concatenate([part.state for part in parts], axis=1),
            np.concatenate([part.scale for part in parts]),
        )


class ParticleFilter(MapFilter):
    """Particle filter over letter, x, y and angle (paper, eq. 8 to 12), resampled at every reading.

    Letters whose tables are equal are one hypothesis, whose particles bear the first one's number: if each had its own,
    resampling would leave one of them by chance.
    """

    options_type: type[Options] = ParticleOptions
    budget = "particles"
    moves = True
    options: ParticleOptions
    fitted_options: ParticleOptions
    _rng: np.random.Generator
    _particles: _Particles
    _weights: Weights

    def __init__(self, options: ParticleOptions) -> None:
        super().__init__(options)
        self._cones = self._spared = 0

    def _fit(self) -> None:
        noise = self.fitted_options
        self._noise = np.array([noise.noise_mm, noise.noise_mm, noise.noise_rad])

    def _reset(self, rng: np.random.Generator) -> None:
        """Spread the particles evenly over letters and uniformly over poses."""
        count = self.options.particles
        self._rng = rng.spawn(1)[0]
        letter = np.sort(self.field.alike[np.arange(count) % len(self.labels)])
        scale = np.empty(0, dtype=np.int64)
        if self.motion is not None:
            scale = rng.choice(len(self.motion.variance), size=count, p=self.motion.prior)
        self._particles = _Particles(letter, uniform_states(count, self.reach, rng), scale)
        self._weights = Weights(np.zeros(count))

    def measure(self) -> None:
        """Resample, then corrupt with noise (command update), then weigh (measurement update).

        The paper resamples last; resampling first in the next reading instead leaves the weighted
        particles of eq. 9 and 11 for the estimate.
        """
        readings = len(self.field)
        if readings > 1:
            self._particles = self._draw_enough() if self.options.kld_error > 0 else self._draw(self._most)
        elif self.motion is None:
            self._particles = self._moved(np.arange(self._most))
        letter, state = self._particles.letter, self._particles.state
        self._weights = Weights(self.field.log_p(letter, state, readings - 1))
        self._evaluated += len(letter)
        self._spared += self._most - len(letter)

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

        skipped: cones, of particles that could not decide the mode. spared_by_kld: particles fewer than the most that
        `kld_error` took.
        """
        counts: dict[str, Any] = {
            "likelihood_evaluations": self._evaluated,
            "skipped": {"cones": self._cones},
        }
        if self.options.kld_error > 0:
            counts["spared_by_kld"] = self._spared
        return counts

    @property
    def _most(self) -> int:
        return self.options.particles

    def _draw_enough(self) -> _Particles:
        """Draw as many particles as KLD-sampling wants (Fox 2003, table 1).

        Fox asks after each particle. Here many are drawn at once: those that the bins so far call for, which would be
        drawn whichever bins they fall into. So the number is the same.
        """
        chosen, parts, count = self.fitted_options, [], 0
        bins = OccupiedBins(chosen.kld_mm, chosen.kld_rad)
        wanted = chosen.min_particles
        while count < wanted:
            parts.append(self._draw(wanted - count))
            bins.add(parts[-1].letter, parts[-1].state)
            count = wanted
            wanted = min(self._most, enough(len(bins), chosen.kld_error, chosen.kld_z))
        return _Particles.joined(parts)

    def _draw(self, count: int) -> _Particles:
        """Draw particles with replacement, with probability proportional to their weights, and move them."""
        chosen = np.empty(count, dtype=np.int64)
        draw(chosen, self._weights.relative, self._rng.standard_exponential(count + 1))
        return self._moved(chosen) if self.motion is None else self._follow(self.motion, chosen)

    def _moved(self, chosen: NDArray[np.int64]) -> _Particles:
        """Copy the chosen particles with the noise of the command update."""
        old, count = self._particles, len(chosen)
        state, normal = np.empty((3, count)), self._rng.standard_normal((3, count))
        move(state, old.state, chosen, normal, self._noise, self.reach)
        return _Particles(old.letter[chosen], state, old.scale)

    def _follow(self, motion: Motion, chosen: NDArray[np.int64]) -> _Particles:
        """Move the chosen particles as the object may move, each with a scale of its own (command update).

        The noise of the command update in the paper is a random walk too, of 1 mm and 0.1 rad whatever the object
        does; the motion takes its place. A scale that moves as the object does survives the resampling.
        """
        old, count, rng = self._particles, len(chosen), self._rng
        scale = old.scale[chosen]
        anew = rng.random(count) < motion.switch
        scale[anew] = rng.choice(len(motion.variance), size=int(anew.sum()), p=motion.prior)
        variance = motion.variance[scale]
        variance[rng.random(count) < motion.jump] = motion.jump_variance
        variance += (self.fitted_options.noise_mm / len(self.field)) ** 2
        step = rng.standard_normal((count, 3)) * np.sqrt(variance)[:, None]
        state = motion.state(motion.placed(old.state.take(chosen, axis=1)) + step)
        return _Particles(old.letter[chosen], state, scale)


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
